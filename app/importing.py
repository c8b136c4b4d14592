"""What the import dialog asks for, without Qt, and what it proposes by looking at the folder's names."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class Request:
    """One import."""

    folder: Path
    session: Path
    poses: Path | None = None
    mask: Path | None = None
    bracket: int | None = None  # exposures a view; None finds out

    def content(self) -> Mapping[str, Any]:
        """For the task "import"."""
        return {
            "folder": str(self.folder.expanduser()),
            "session": str(self.session.expanduser()),
            "poses": str(self.poses.expanduser()) if self.poses else None,
            "mask": str(self.mask.expanduser()) if self.mask else None,
            "bracket": self.bracket,
        }


# Folders that say what is in them and not of what: the folder above does.
PLAIN_NAMES = frozenset(
    (
        "dcim",
        "dng",
        "exr",
        "hdr",
        "image",
        "images",
        "input",
        "photographs",
        "photos",
        "pictures",
        "raw",
        "renders",
    )
)


def proposed(folder: Path) -> Path:
    """A name for the session beside the photographs that is not taken yet."""
    plain = folder.name.lower() in PLAIN_NAMES and folder.parent.name
    name = folder.parent.name if plain else folder.name
    place = folder.parent / f"{name}.session"
    number = 2
    while place.exists():
        place = folder.parent / f"{name}-{number}.session"
        number += 1
    return place


def suggest_mask(folder: Path) -> Path | None:
    """A mask that lies in the folder, or beside it, under its usual name."""
    return next((path for path in (folder / "mask.png", folder.parent / "mask.png") if path.is_file()), None)


def suggest_poses(folder: Path) -> Path | None:
    """Poses that lie in the folder, or beside it, under their usual names."""
    for place in (folder, folder.parent):
        if (place / "transforms.json").is_file():
            return place / "transforms.json"
        for model in (place / "sparse" / "0", place / "sparse", place):
            if (model / "cameras.bin").is_file() or (model / "cameras.txt").is_file():
                return model
    return None
