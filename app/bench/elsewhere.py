"""Rows of maps that were computed elsewhere, by a network say: a folder for the method, in it one for every set.

NAME=FOLDER, and FOLDER/ROOM-OBJECT/normal.exr (or .png, .npy, .npz), with albedo and roughness beside it if the
method gives them. How long it took is not known. Its albedo has no scale that a photograph could tell it.
"""

import math
from dataclasses import dataclass
from pathlib import Path

from app.bench.baselines.maps import MapFiles, read_maps
from app.bench.record import BenchError
from app.bench.rows import Answer, Method
from app.bench.stored import Stored
from engine.io.session import file_sha256
from engine.progress import Progress

KINDS = (".exr", ".png", ".npy", ".npz")


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """One method's maps of every set."""

    name: str
    folder: Path
    frame: str  # of its normals: "opengl" | "opencv"

    def files(self, on: str) -> MapFiles:
        """The maps of the set ROOM-OBJECT.

        Raises:
            BenchError: there are no normals of it.
        """
        normal = self._file(on, "normal")
        if normal is None:
            raise BenchError(
                f"{self.folder / on}: holds no normal{'|'.join(KINDS)}; put the maps of {self.name} for {on} there, or"
                " name other --rooms and --objects"
            )
        return MapFiles(normal, self._file(on, "albedo"), self._file(on, "roughness"), self.frame)

    def row(self, on: str) -> Method:
        """The method's row on the set ROOM-OBJECT."""
        files = self.files(on)

        def run(stored: Stored, device: str, seed: int, progress: Progress) -> Answer:
            # The depth is not compared, so that any distance does.
            surface = read_maps(files, stored.poses.camera, stored.masks.object, 1.0, progress)
            return Answer(surface, math.nan)

        paths = (files.normal, files.albedo, files.roughness)
        facts = {path.name: file_sha256(path) for path in paths if path is not None}
        key = self.name.replace(" ", "_")
        return Method(key, self.name, "maps", run, facts | {"frame": self.frame}, matched=True)

    def _file(self, on: str, what: str) -> Path | None:
        places = [self.folder / on / f"{what}{kind}" for kind in KINDS]
        return next((place for place in places if place.is_file()), None)


def named(said: str, frame: str) -> Elsewhere:
    """What `--maps NAME=FOLDER` means.

    Raises:
        BenchError: it is not of that form, or there is no such folder.
    """
    name, equals, folder = said.partition("=")
    if not (name and equals and Path(folder).is_dir()):
        raise BenchError(f"--maps {said}: give NAME=FOLDER, a folder that is there, as sdm-unips=maps/sdm")
    return Elsewhere(name, Path(folder), frame)
