"""What files may say of their axes: which way up a photograph stands, and the frame of its normals.

`flip` is LibRaw's: how the sensor's picture is turned to stand upright: 0 not at all, 3 by 180 degrees, 5 by 90 to the
left, 6 by 90 to the right (Exif's 1, 3, 8, 6). Apart from the turns themselves (`engine/orientation.py`), so that a session
is opened and planned without a library of arrays.
"""

from collections import Counter
from collections.abc import Sequence

from engine.errors import RawError

NORMAL_FRAMES = ("opencv", "opengl")
QUARTERS = {0: 0, 3: 2, 5: 1, 6: 3}  # of a turn to the left, as `np.rot90` counts them
WORDS = {
    0: "not at all",
    3: "by 180 degrees",
    5: "by 90 degrees to the left",
    6: "by 90 degrees to the right",
}
EXIF = {0: 1, 1: 2, 2: 4, 3: 3, 4: 5, 5: 8, 6: 6, 7: 7}  # the tag's number of each flip
LEAST_VIEWS = 8
"""Fewer determine no surface."""


def check(flip: int, name: str) -> None:
    """
    Raises:
        RawError: the tag says that the picture is in a mirror, which no turn of a camera does.
    """
    if flip not in QUARTERS:
        raise RawError(
            f"{name}: its Orientation tag ({EXIF.get(flip, flip)}) says that the picture is mirrored, which no way of"
            " holding a camera does; correct the tag (1, 3, 6 and 8 are turns) or remove it"
        )


def common(flips: Sequence[int]) -> int:
    """The most frequent one, the first of those as frequent: a session has one, so that its object stands still."""
    return Counter(flips).most_common(1)[0][0] if flips else 0


def differing(flips: Sequence[int], chosen: int) -> tuple[str, ...]:
    """A sentence where photographs were held otherwise than the session's `chosen` flip says; none where all agree."""
    others = sum(flip != chosen for flip in flips)
    if not others:
        return ()
    return (
        f"The Orientation tags of {others} of {len(flips)} photographs differ from the others': all are shown turned"
        f" {WORDS[chosen]}, for the object is where it was on the sensor.",
    )
