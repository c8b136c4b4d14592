"""What the child prepares for relighting, written and read back; relit pictures, written as EXR."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from app.inspect.runs import Run
from app.relight.relit import Light, Transfer
from engine.errors import SessionError, reason
from engine.io.formats.arrays import UNREADABLE
from engine.io.session import told

FORMAT = 1  # of the files; raised when what is written means something else


def folder(run: Run) -> Path:
    """Where what the child prepared is kept; may be removed at any time."""
    return run.session / "derived" / "relight" / run.fingerprint


def transfer_file(run: Run, full: bool = False) -> Path:
    """What the surface answers, at the preview's size, or at the photographs' own where that is another."""
    return folder(run) / f"transfer-{FORMAT}{'-full' * full}.npz"


def light_file(run: Run, view: int) -> Path:
    return folder(run) / f"light-{FORMAT}-{view:04d}.npz"


def lights_of(run: Run) -> tuple[int, ...]:
    """The views whose light is there."""
    return tuple(sorted(int(path.stem[-4:]) for path in folder(run).glob(f"light-{FORMAT}-*.npz")))


def keep(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Whole or not at all."""
    beside = path.with_name(f".{path.stem}.partial.npz")
    with told(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(beside, **arrays)  # pyrefly: ignore[bad-argument-type]
        beside.replace(path)


def load_transfer(path: Path) -> Transfer:
    """
    Raises:
        SessionError: gone or damaged.
    """
    a = _arrays(path)
    order, rows, shares = _padded(a["pixels"], a["sizes"], a["ranks"], a["weights"].astype(np.float32))
    zero = np.zeros((1, a["basis"].shape[1]), np.float32)
    basis = np.concatenate([a["basis"].astype(np.float32), zero])
    left, top, right, bottom = (int(v) for v in a["box"])
    return Transfer(
        mask=a["mask"],
        box=(left, top, right, bottom),
        albedo=a["albedo"],
        order=order,
        middles=a["middles"],
        basis=basis,
        rows=rows,
        shares=shares,
        middle=a["middle"],
        cube_index=a["cube_index"].astype(np.int32),
        cube_share=a["cube_share"].astype(np.float32),
        tile=a["tile"],
        rays=a["rays"],
    )


def load_light(path: Path) -> Light:
    """
    Raises:
        SessionError: gone or damaged.
    """
    a = _arrays(path)
    return Light(
        str(a["name"]), a["energy"], a["panorama"], a["lamp_centre"], a["lamp_radius"], a["lamp_radiance"],
        a["lamp_group"].astype(int), a["lamp_clipped"].astype(bool),
    )  # fmt: skip


def middle_of(path: Path) -> tuple[float, ...]:
    """The object's middle as a prepared surface has it."""
    return tuple(float(v) for v in _arrays(path)["middle"])


def _padded(
    pixels: Int[np.ndarray, " p"],
    sizes: Int[np.ndarray, " b"],
    ranks: Int[np.ndarray, " c"],
    weights: Float[np.ndarray, " w"],
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """`order`, `rows` and `shares` of a Transfer: blocks of all sizes brought to one.

    Args:
        ranks: rows of every block, diffuse and specular by turns.
        weights: of every block its diffuse, then its specular shares, pixel by pixel.
    """
    count, size = len(sizes), int(sizes.max())
    first = np.concatenate([[0], np.cumsum(ranks)])
    none = int(first[-1])  # the row of zeros
    rows = [np.full((count, int(ranks[kind::2].max())), none, np.int64) for kind in (0, 1)]
    shares = [np.zeros((count, size, rows[kind].shape[1]), np.float32) for kind in (0, 1)]
    order = np.empty(len(pixels), np.int64)
    at = done = 0
    for block, many in enumerate(sizes):
        order[pixels[done : done + many]] = block * size + np.arange(many)
        done += int(many)
        for kind in (0, 1):
            rank = int(ranks[2 * block + kind])
            rows[kind][block, :rank] = first[2 * block + kind] + np.arange(rank)
            shares[kind][block, :many, :rank] = weights[at : at + many * rank].reshape(many, rank)
            at += int(many) * rank
    return order, (rows[0], rows[1]), (shares[0], shares[1])


def save_exr(
    path: Path, picture: Float[np.ndarray, "h w 3"], inside: Bool[np.ndarray, "h w"], said: str
) -> None:
    """Linear radiance with the object's mask as alpha; `said` tells the light.

    Raises:
        SessionError: the file cannot be written.
    """
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {name: np.ascontiguousarray(picture[..., c], np.float32) for c, name in enumerate("RGB")}
    channels["A"] = np.ascontiguousarray(inside, np.float32)
    header["light"] = said
    header["unit"] = "radiance, linear Rec.709, the scale of the session"
    try:
        # Opened first: the library does not say why a place refuses.
        path.open("wb").close()
        with OpenEXR.File(header, channels) as file:
            file.write(str(path))
    except (OSError, RuntimeError) as error:
        raise SessionError(
            f"{path}: could not be written ({error}); choose another folder, or check the disk"
        ) from None


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except UNREADABLE as error:
        raise SessionError(f"{path}: cannot be read ({reason(error)}); remove it, it is made again") from None
