"""Camera XML of Agisoft Metashape: reads it.

Source: Metashape's manual, "Camera models" appendix, and files it exports. Poses are chunk_from_cam with our
camera axes, and each component of the chunk has a similarity of its own. The principal point is an offset from
the image's centre, p1 and p2 are swapped against OpenCV, b1 adds to the focal length along x.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from engine.errors import PoseError
from engine.geometry import check_rigid, inverse
from engine.io.poses.pose_list import Image, Listed, affine, folded_lens
from engine.types import Camera

UNREADABLE = (
    "not a Metashape camera file ({}); export one chunk with File > Export > Export Cameras as Agisoft XML"
)
_YES, _NO = ("true", "1"), ("false", "0")


def _numbers(element: Element | None, count: int, what: str) -> Float[np.ndarray, " n"]:
    values = np.array([float(word) for word in (element.text or "").split()] if element is not None else [])
    if len(values) != count:
        raise ValueError(f"{what} holds {len(values)} numbers, not {count}")
    return values


def _calibration(sensor: Element, path: Path) -> Element:
    """The adjusted one; of a sensor whose calibration is fixed, the one it was given."""
    by_class = {c.get("class"): c for c in sensor.findall("calibration")}
    fixed = any(p.get("name") == "fixed" and p.get("value") in _YES for p in sensor.findall("property"))
    found = by_class.get("adjusted", by_class.get("initial") if fixed else None)
    if found is None:
        raise PoseError(
            f"{path}: no calibration of class adjusted, and none that is fixed; align the photographs, then"
            " export again"
        )
    return found


def _camera(sensors: Mapping[str | None, Element], number: str | None, path: Path) -> Camera:
    if number not in sensors:
        raise ValueError(f"no sensor has the id {number}")
    sensor = sensors[number]
    calibration = _calibration(sensor, path)
    for kind in (sensor.get("type", "frame"), calibration.get("type", "frame")):
        if kind != "frame":
            raise PoseError(f"{path}: camera type {kind} is not supported; only frame cameras are")
    if calibration.find("fx") is not None:
        raise PoseError(
            f"{path}: a calibration with fx and fy, as old versions of PhotoScan wrote it, is not supported; export"
            " from Metashape"
        )
    known = {"f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4"}
    terms = {child.tag: float(child.text or "nan") for child in calibration if child.tag in known}
    resolution = calibration.find("resolution")
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


_Similarity = tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"], float | None]


def _world_from_chunk(transform: Element | None, path: Path) -> _Similarity:
    """Rotation, shift and scale; None where nothing fixes the unit."""
    if transform is None or transform.find("scale") is None:
        return np.eye(3), np.zeros(3), None
    rotation = _numbers(transform.find("rotation"), 9, "rotation").reshape(3, 3)
    shift = _numbers(transform.find("translation"), 3, "translation")
    scale = float(_numbers(transform.find("scale"), 1, "scale")[0])
    check_rigid(np.column_stack([rotation, shift]), f"{path}: the chunk's transform")
    if not 0 < scale < np.inf:
        raise ValueError(f"the chunk's scale is {scale:g}")
    return rotation, shift, scale


def _pose(element: Element, world_from_chunk: _Similarity, name: str, path: Path) -> np.ndarray:
    rotation, shift, scale = world_from_chunk
    numbers = _numbers(element.find("transform"), 16, f"the transform of {name}")
    chunk_from_cam = affine(numbers.reshape(4, 4), name)
    check_rigid(chunk_from_cam, f"{path}: {name}")
    centre = rotation @ chunk_from_cam[:, 3] * (scale or 1.0) + shift
    return inverse(np.column_stack([rotation @ chunk_from_cam[:, :3], centre]))


def _chunk(root: Element, path: Path) -> Element:
    """The only chunk, or the active one of several."""
    chunks = root.findall("chunk") or root.findall("chunks/chunk")
    active = {holder.get("active_id") for holder in (root, *root.findall("chunks"))} - {None}
    found = [c for c in chunks if c.get("id") in active] if len(chunks) > 1 else chunks
    if len(chunks) > 1 and len(found) != 1:
        raise PoseError(
            f"{path}: {len(chunks)} chunks, none of them marked as the active one; export one chunk"
        )
    if not found:
        raise ValueError("it has no chunk")
    return found[0]


def _components(chunk: Element, path: Path) -> tuple[Element | None, Mapping[str, str | None]]:
    """The active component, if there is any, and the component of each camera that a component lists."""
    components = chunk.findall("components/component")
    listed = {
        camera: component.get("id")
        for component in components
        for ids in component.iter("camera_ids")
        for camera in (ids.text or "").split()
    }
    holder = chunk.find("components")
    number = holder.get("active_id") if holder is not None else None
    active = [c for c in components if c.get("id") == number] if len(components) > 1 else components
    if components and len(active) != 1:
        raise PoseError(
            f"{path}: {len(components)} components, none of them marked as the active one; activate one, or align"
            " them to each other, and export again"
        )
    return (active[0] if active else None), listed


def read(path: Path) -> Listed:
    """World is the frame of the active component after its transform (which has the scale); without one it is
    arbitrary. Components are not aligned to one another: cameras of the others have no pose."""
    chunk = _chunk(ElementTree.parse(path).getroot(), path)
    sensors = {s.get("id"): s for s in chunk.findall("sensors/sensor")}
    active, component_of = _components(chunk, path)
    # Old versions put the transform on the chunk, newer ones on its components.
    transform = active.find("transform") if active is not None else None
    world_from_chunk = _world_from_chunk(chunk.find("transform") if transform is None else transform, path)

    def unplaced(element: Element) -> str:
        component = element.get("component_id", component_of.get(element.get("id", "")))
        if element.find("transform") is None:
            return "not aligned"
        if element.get("enabled") in _NO:
            return "disabled"
        if active is not None and component not in (None, active.get("id")):
            return f"component {component} is not the active one"
        return ""

    images = []
    for element in chunk.findall("cameras//camera"):
        name = element.get("label")
        if name is not None and element.get("master_id") is None:
            images.append(
                Image(
                    name,
                    partial(_camera, sensors, element.get("sensor_id"), path),
                    partial(_pose, element, world_from_chunk, name, path),
                    unplaced(element),
                )
            )
    unit = "unknown" if world_from_chunk[2] is None else "given"
    return Listed(tuple(images), np.zeros((0, 3)), unit)
