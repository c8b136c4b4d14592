"""Make photographs fit for feature detection, detect features in the room, choose which views to match.

Source: SIFT (Lowe 2004) as in COLMAP, with RootSIFT descriptors. Radiance spans many stops: its logarithm,
normalised by the local mean and spread, gives bright and dark parts of a room the same chance; the noise
of the photographs bounds how far dark parts are stretched. Pixels of *features* count on the enlarged image.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from jaxtyping import Bool, Float, Int, UInt8

from engine.color import luminance
from engine.progress import Progress
from engine.sfm.params import FeatureParams
from engine.types import Frames, Masks

_WINDOW = 1 / 16  # of the longer side: standard deviation of the local normalisation
_CONTRAST = 0.05  # log radiance; fainter texture is left faint
_BATCH = 8  # views between two looks at a cancel request
_COARSE = 256  # features a view that vote on which pairs to match
# Descriptors are whole numbers of length 512, so their products are exact in float32 whatever the order of
# summation; this is a cosine of 0.85, above which two may show the same point.
_SIMILAR = 0.85 * 512**2


def enlargement(width: int, height: int, params: FeatureParams) -> int:
    """Integer factor by which photographs of this size are enlarged."""
    longer = max(width, height)
    return max(1, min(params.enlarge_most, params.enlarge_below_px // longer))


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
    sigma = max(log.shape) * _WINDOW
    log = log - cv2.GaussianBlur(log, (0, 0), sigma)
    spread = np.sqrt(cv2.GaussianBlur(log * log, (0, 0), sigma) + _CONTRAST**2)
    return np.clip(127.5 + 40 * log / spread, 0, 255).astype(np.uint8)


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


def detect(
    frames: Frames,
    masks: Masks,
    camera: pycolmap.Camera,
    params: FeatureParams,
    folder: Path,
    progress: Progress,
) -> Path:
    """Write the tone-mapped views and a COLMAP database with their features into `folder`; its path.

    Image i of the database (from 1) is view i - 1; `camera` has the size of the enlarged photographs.
    """
    images, covers, database = folder / "images", folder / "masks", folder / "features.db"
    images.mkdir(parents=True)
    covers.mkdir()
    count, height, width = frames.radiance.shape[:3]
    factor = enlargement(width, height, params)
    floor = log_floor(frames)
    options = pycolmap.FeatureExtractionOptions()
    options.use_gpu = False
    options.sift.max_num_features = params.maximum
    options.sift.peak_threshold = params.peak_threshold
    options.sift.first_octave = -1 if factor * max(width, height) < params.doubled_below_px else 0
    reader = pycolmap.ImageReaderOptions()
    reader.mask_path = covers
    with pycolmap.Database.open(database) as opened:
        reader.existing_camera_id = _register(opened, camera, count)
    for first in range(0, count, _BATCH):
        progress.step(first / count, f"features of view {first + 1} of {count}")
        names = [view_name(i) for i in range(first, min(first + _BATCH, count))]
        for i, name in enumerate(names, start=first):
            cv2.imwrite(str(images / name), tone_mapped(frames.radiance[i], floor, factor))
            mask = room_mask(masks.object, masks.background[i], factor, params.margin)
            cv2.imwrite(str(covers / f"{name}.png"), mask)
        pycolmap.extract_features(
            database, images, names, pycolmap.CameraMode.SINGLE, reader, options, pycolmap.Device.cpu
        )
    return database


def _register(database: pycolmap.Database, camera: pycolmap.Camera, count: int) -> int:
    """Write every view before its features: COLMAP's threads would number them in the order they finish."""
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
    return camera_id


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
            scales = np.hypot(keypoints[:, 2], keypoints[:, 4]) if len(keypoints) else np.zeros(0)
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
