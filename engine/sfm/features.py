"""Make photographs fit for feature detection, detect features in the room, choose which views to match.

Source: SIFT (Lowe 2004) as in OpenCV, with RootSIFT descriptors (Arandjelovic and Zisserman 2012) as COLMAP stores them. Radiance
spans many stops: its logarithm, normalised by the local mean and spread, gives bright and dark parts of a room the same chance;
the noise of the photographs bounds how far dark parts are stretched. Pixels of *features* count on the enlarged image.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from jaxtyping import Bool, Float, Float32, Int, UInt8

from engine.color import luminance
from engine.parallel import abreast
from engine.progress import Progress
from engine.sfm.params import FeatureParams
from engine.types import Frames, Masks

_WINDOW = 1 / 16  # of the longer side: standard deviation of the local normalisation
_CONTRAST = 0.05  # log radiance; fainter texture is left faint
_BLURRED_PX = 6  # standard deviation that a blur is left with in the smaller picture it is taken of
_OCTAVE_LAYERS = 3
_COARSE = 256  # features a view that vote on which pairs to match
_FEWEST = 800  # features kept of a view, however many views share them
# Descriptors are whole numbers of length 512, so their products are exact in float32 whatever the order of
# summation; this is a cosine of 0.85, above which two may show the same point.
_SIMILAR = 0.85 * 512**2


def enlargement(width: int, height: int, params: FeatureParams) -> int:
    """Integer factor by which photographs of this size are enlarged."""
    longer = max(width, height)
    return max(1, min(params.enlarge_most, params.enlarge_below_px // longer))


def most_of_a_view(count: int, params: FeatureParams) -> int:
    """How many features are kept of each of `count` views."""
    return min(params.maximum, max(params.altogether // count, _FEWEST))


def log_floor(frames: Frames) -> float:
    """Radiance added before the logarithm, so that a dark pixel's noise stays below a tenth of a log unit."""
    shot, floor = frames.noise
    level = np.percentile(luminance(frames.radiance[:, ::4, ::4]), 10)
    # Photographs without a noise model (rendered, or linear files) still end somewhere in the dark.
    return float(max(10 * floor, 100 * shot, 0.2 * level, 1e-12))


def tone_mapped(
    radiance: Float[np.ndarray, "h w 3"], floor: float, factor: int
) -> UInt8[np.ndarray, "_h _w"]:
    """Log luminance, enlarged, normalised by its local mean and spread."""
    log = np.log(np.maximum(luminance(radiance), 0) + np.float32(floor)).astype(np.float32)
    if factor > 1:
        log = cv2.resize(log, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    log = log - _local_mean(log)
    spread = np.sqrt(_local_mean(log * log) + _CONTRAST**2)
    return np.clip(127.5 + 40 * log / spread, 0, 255).astype(np.uint8)


def _local_mean(picture: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Gaussian mean over `_WINDOW`, of a picture so small that it costs little: the mean is as smooth in the large one."""
    height, width = picture.shape
    sigma = max(height, width) * _WINDOW
    by = max(1.0, sigma / _BLURRED_PX)
    small = cv2.resize(
        picture, (max(1, round(width / by)), max(1, round(height / by))), interpolation=cv2.INTER_AREA
    )
    blurred = cv2.GaussianBlur(small, (0, 0), sigma / by)
    return cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR)


def room_mask(
    object_mask: Bool[np.ndarray, "h w"], background: Bool[np.ndarray, "h w"], factor: int, margin: float
) -> UInt8[np.ndarray, "_h _w"]:
    """255 where features may lie: the background, clear of the object by `margin` of the longer side."""
    radius = int(np.ceil(max(object_mask.shape) * margin))
    grown = cv2.dilate(
        object_mask.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1,) * 2)
    )
    free = (background & (grown == 0)).astype(np.uint8) * 255
    height, width = object_mask.shape
    return cv2.resize(free, (width * factor, height * factor), interpolation=cv2.INTER_NEAREST)


@dataclass(frozen=True, slots=True, eq=False)
class Sift:
    """Features of one picture."""

    keypoints: Float32[
        np.ndarray, "n 4"
    ]  # x, y, size, orientation; the first pixel's centre lies on (.5, .5); pixels, radians
    response: Float32[np.ndarray, " n"]
    descriptors: UInt8[np.ndarray, "n 128"]  # RootSIFT, of length 512


def sift(
    picture: UInt8[np.ndarray, "h w"],
    free: UInt8[np.ndarray, "h w"] | None,
    peak_threshold: float,
    most: int,
    best: Callable[[cv2.KeyPoint], float],
) -> Sift:
    """The `most` features where `free` is not 0 that are `best`; the first octave is of twice the picture's size.

    `peak_threshold`: least contrast, of a picture from 0 to 1.
    """
    detector = cv2.SIFT.create(
        0, _OCTAVE_LAYERS, _OCTAVE_LAYERS * peak_threshold, enable_precise_upscale=True
    )
    points = sorted(detector.detect(picture, free), key=best, reverse=True)[:most]
    found, raw = detector.compute(picture, points)
    if raw is None or not len(raw):
        return Sift(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), np.zeros((0, 128), np.uint8))
    # OpenCV's first pixel lies on (0, 0), and its sizes are diameters.
    rows = [(p.pt[0] + 0.5, p.pt[1] + 0.5, p.size / 2, np.radians(p.angle)) for p in found]
    root = np.sqrt(raw / np.maximum(raw.sum(axis=1, keepdims=True), 1e-9))
    return Sift(
        np.array(rows, np.float32),
        np.array([p.response for p in found], np.float32),
        np.minimum(np.rint(512 * root), 255).astype(np.uint8),
    )


def detect(
    frames: Frames,
    masks: Masks,
    camera: pycolmap.Camera,
    params: FeatureParams,
    folder: Path,
    progress: Progress,
) -> Path:
    """Write a COLMAP database with the features of all views into `folder`; its path.

    Image i of the database (from 1) is view i - 1; `camera` has the size of the enlarged photographs.
    """
    database = folder / "features.db"
    count, height, width = frames.radiance.shape[:3]
    factor, floor = enlargement(width, height, params), log_floor(frames)
    # SIFT doubles what it is given.
    by = 1 if factor * max(width, height) < params.doubled_below_px else 2
    most = most_of_a_view(count, params)

    def find(i: int) -> Sift:
        picture = tone_mapped(frames.radiance[i], floor, factor)
        free = room_mask(masks.object, masks.background[i], factor, params.margin)
        if by > 1:
            picture = cv2.resize(picture, None, fx=1 / by, fy=1 / by, interpolation=cv2.INTER_AREA)
            free = cv2.resize(free, picture.shape[::-1], interpolation=cv2.INTER_NEAREST)
        return sift(picture, free, params.peak_threshold, most, lambda point: point.size)

    with pycolmap.Database.open(database) as opened:
        _register(opened, camera, count)
        for i, found in enumerate(abreast(find, range(count))):
            progress.step(i / count, f"features of view {i + 1} of {count}")
            opened.write_keypoints(i + 1, found.keypoints * np.array([by, by, by, 1], np.float32))
            opened.write_descriptors(
                i + 1, pycolmap.FeatureDescriptors(pycolmap.FeatureExtractorType.SIFT, found.descriptors)
            )
    return database


def _register(database: pycolmap.Database, camera: pycolmap.Camera, count: int) -> None:
    """Write every view, before its features."""
    camera_id = database.write_camera(camera)
    sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera_id)
    rig = pycolmap.Rig()
    rig.add_ref_sensor(sensor)
    rig_id = database.write_rig(rig)
    for i in range(count):
        image = database.write_image(pycolmap.Image(name=view_name(i), camera_id=camera_id))
        frame = pycolmap.Frame()
        frame.rig_id = rig_id
        frame.add_data_id(pycolmap.data_t(sensor, image))
        database.write_frame(frame)


def view_name(index: int) -> str:
    """Name of view `index` inside the COLMAP database."""
    return f"{index:05d}.png"


def likely_pairs(
    database: Path, count: int, params: FeatureParams, progress: Progress
) -> list[tuple[int, int]]:
    """Pairs of views worth comparing in full, from mutual best matches among their coarsest features."""
    if count <= params.exhaustive_below:
        return [(i, j) for i in range(count) for j in range(i + 1, count)]
    coarse = []
    with pycolmap.Database.open(database) as opened:
        for image in range(1, count + 1):
            keypoints = opened.read_keypoints(image)
            data = np.asarray(opened.read_descriptors(image).data, np.float32)
            scales = keypoints[:, 2] if len(keypoints) else np.zeros(0)
            coarse.append(data[np.argsort(-scales, kind="stable")[:_COARSE]])
    votes = np.zeros((count, count), int)
    for i in range(count):
        progress.step(i / count, f"comparing view {i + 1} of {count} coarsely")
        for j in range(i + 1, count):
            votes[i, j] = votes[j, i] = mutual(coarse[i], coarse[j], _SIMILAR)
    return chosen(votes, params.neighbours)


def mutual(a: Float[np.ndarray, "m d"], b: Float[np.ndarray, "n d"], least: float) -> int:
    """How many descriptors are each other's most alike, with a product above `least`."""
    if not len(a) or not len(b):
        return 0
    similar = a @ b.T
    best = similar.argmax(1)
    both = similar.argmax(0)[best] == np.arange(len(a))
    return int((both & (similar[np.arange(len(a)), best] > least)).sum())


def chosen(votes: Int[np.ndarray, "n n"], neighbours: int) -> list[tuple[int, int]]:
    """Every view's best `neighbours`, its two predecessors and successors, each pair once, in order."""
    pairs: set[tuple[int, int]] = set()
    for i, row in enumerate(votes):
        near: Sequence[int] = [j for j in range(i - 2, i + 3) if 0 <= j < len(votes)]
        best = np.argsort(-row, kind="stable")[:neighbours].tolist()
        pairs |= {(min(i, j), max(i, j)) for j in (*near, *best) if j != i}
    return sorted(pairs)
