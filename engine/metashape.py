"""Camera XML of Agisoft Metashape: reads it.

Source: Metashape's manual, "Camera models" appendix, and files it exports. Poses are chunk_from_cam with our
camera axes, and the chunk has a similarity of its own. The principal point is an offset from the image's
centre, p1 and p2 are swapped against OpenCV, b1 adds to the focal length along x.
"""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
from jaxtyping import Float

from engine.errors import PoseError
from engine.geometry import check_rigid, inverse
from engine.poselist import Listed, folded_lens
from engine.types import Camera


def _numbers(element: ElementTree.Element | None, count: int, what: str) -> Float[np.ndarray, " n"]:
    values = np.array([float(word) for word in (element.text or "").split()] if element is not None else [])
    if len(values) != count:
        raise ValueError(f"{what} holds {len(values)} numbers, not {count}")
    return values


def _metashape_camera(sensor: ElementTree.Element, path: Path) -> Camera:
    adjusted = [c for c in sensor.findall("calibration") if c.get("class") == "adjusted"]
    if not adjusted:
        raise PoseError(f"{path}: no calibration of class adjusted; align the photographs, then export again")
    kind = adjusted[0].get("type", sensor.get("type", "frame"))
    if kind != "frame":
        raise PoseError(f"{path}: camera type {kind} is not supported; only frame cameras are")
    terms = {child.tag: float(child.text or "nan") for child in adjusted[0] if child.tag != "resolution"}
    resolution = adjusted[0].find("resolution")
    resolution = sensor.find("resolution") if resolution is None else resolution
    if resolution is None or "f" not in terms:
        raise ValueError("the calibration has no resolution or no f")
    if terms.get("p3") or terms.get("p4"):
        raise PoseError(f"{path}: tangential terms p3, p4 are not supported; calibrate without them")
    width, height = int(resolution.attrib["width"]), int(resolution.attrib["height"])
    fx, fy = terms["f"] + terms.get("b1", 0.0), terms["f"]
    if not np.isfinite(list(terms.values())).all():
        raise ValueError("a term of the calibration is not finite")
    if not (fx > 0 and fy > 0 and width > 0 and height > 0):
        raise ValueError("a focal length or size is not positive")
    camera = Camera(
        width, height, fx, fy,
        width / 2 + terms.get("cx", 0.0), height / 2 + terms.get("cy", 0.0),
        p1=terms.get("p2", 0.0), p2=terms.get("p1", 0.0),
    )  # fmt: skip
    radial = [terms.get(f"k{i}", 0.0) for i in (1, 2, 3, 4)]
    return folded_lens(camera, radial, terms.get("b2", 0.0), str(path))


def read(path: Path) -> Listed:
    """World is the chunk's frame after its transform (which has the scale); without one it is arbitrary."""
    try:
        chunks = ElementTree.parse(path).getroot().findall("chunk")
        if len(chunks) != 1:
            raise ValueError(f"{len(chunks)} chunks")
        sensors = {s.get("id"): s for s in chunks[0].iter("sensor")}
        own = [c for c in chunks[0].iter("camera") if c.get("master_id") is None]
        aligned = [c for c in own if c.find("transform") is not None]
        used = {c.get("sensor_id") for c in aligned}
        if len(used) != 1:
            raise PoseError(
                f"{path}: {len(used)} sensors have aligned cameras; a session is photographed with one camera"
            )
        camera = _metashape_camera(sensors[used.pop()], path)
        rotation, shift, scale = np.eye(3), np.zeros(3), None
        # Old versions put the transform on the chunk, newer ones on its component; both never differ.
        whole = chunks[0].find("transform")
        whole = chunks[0].find("components/component/transform") if whole is None else whole
        if whole is not None and whole.find("scale") is not None:
            rotation = _numbers(whole.find("rotation"), 9, "rotation").reshape(3, 3)
            shift = _numbers(whole.find("translation"), 3, "translation")
            scale = float(_numbers(whole.find("scale"), 1, "scale")[0])
        poses: dict[str, np.ndarray | None] = {str(c.get("label")): None for c in own}
        if len(poses) < len(own):
            raise PoseError(f"{path}: two cameras have one label; rename one of the photographs")
        for element in aligned:
            label = str(element.get("label"))
            numbers = _numbers(element.find("transform"), 16, f"transform of {label}")
            chunk_from_cam = numbers.reshape(4, 4)[:3]
            check_rigid(chunk_from_cam, f"{path}: {label}")
            centre = rotation @ chunk_from_cam[:, 3] * (scale or 1.0) + shift
            poses[label] = inverse(np.column_stack([rotation @ chunk_from_cam[:, :3], centre]))
    except (OSError, ValueError, KeyError, TypeError, ElementTree.ParseError) as error:
        raise PoseError(
            f"{path}: not a Metashape camera file ({type(error).__name__}: {error}); export one chunk with"
            " File > Export > Export Cameras as Agisoft XML"
        ) from error
    unit = "unknown" if scale is None else "given"
    return Listed(camera, poses, True, np.zeros((0, 3)), unit, ())
