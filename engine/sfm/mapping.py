"""Compare views, and grow a model of cameras and points from what they have in common.

Source: global structure from motion as in GLOMAP (Pan, Barath, Pollefeys, Schoenberger 2024), which places all views at once, and
incremental structure from motion as in COLMAP (Schoenberger and Frahm 2016), which places one after the other, both by pycolmap.
Pixels here are those of the images in the database. The world frame and its unit are COLMAP's, arbitrary.
"""

import shutil
import tempfile
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import pycolmap
from jaxtyping import Float, UInt32

from engine.errors import Cancelled
from engine.parallel import abreast
from engine.progress import Progress
from engine.sfm import epipolar
from engine.sfm import rig_alignment as rigs
from engine.sfm.features import view_name
from engine.sfm.params import MapParams

Mapper = Literal["global", "incremental", "straight"]
"""All views at once; one after the other; the same under a lens that bends as much as to begin with until all are placed."""
_BATCHES = 16  # looks at a cancel request while matches are checked
ATTEMPTS = 3  # models grown at most
_BEYOND = 1.3  # times a focal length: where a lens that slid starts anew
_SPANS = (0.0, 0.8, 0.9, 1.0)  # of the progress: most often the first is good
_TRACKS = 150  # of points that a view shows, from which all views are placed at once; four times as many take three times as long
_POLL_S = 0.2
AGREED = (
    0.97  # share of the verified matches that a right model agrees with: 0.99 and more, a wrong one's 0.92
)
_BEGINNINGS = (0.5, 0.7, 1.0, 1.4)  # times the guess of a focal length
_ALIKE = 0.02  # of a focal length: what ends as near is one
_LENS_OFF = 0.1  # of a focal length: right models stay within a hundredth of what pairs of views imply
_CLEARLY = 0.8  # of the reprojection error under another lens: right ones had .5 to .63 of what slid ones had
LOG_OFF = (
    0.02  # of the path, between it and the rig's log: a right one had .004, that of a lens that slid .24
)
_AS_GOOD = 0.01  # of the matches: what agrees with two models alike tells nothing between them
_FARTHEST = 0.7  # radians between descriptors, above which two never show the same point


def match(
    database: Path,
    pairs: Sequence[tuple[int, int]],
    factor: int,
    params: MapParams,
    seed: int,
    progress: Progress,
) -> None:
    """Match features of `pairs` of views and keep what agrees with one epipolar geometry."""
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.max_error = params.epipolar_px * factor
    verification.ransac.random_seed = seed
    verification.detect_watermark = False
    listing = database.parent / "pairs.txt"
    with pycolmap.Database.open(database) as opened:
        views = sorted({i for pair in pairs for i in pair})
        descriptors = {i: np.asarray(opened.read_descriptors(i + 1).data, np.float32) for i in views}

        def compare(pair: tuple[int, int]) -> UInt32[np.ndarray, "k 2"]:
            i, j = pair
            return best_of_both(descriptors[i], descriptors[j], params.match_ratio)

        for k, ((i, j), matches) in enumerate(zip(pairs, abreast(compare, pairs), strict=True)):
            progress.step(0.6 * k / len(pairs), f"matching {len(pairs)} pairs of views")
            opened.write_matches(i + 1, j + 1, matches)
    for batch, part in enumerate(np.array_split(np.array(pairs), _BATCHES)):
        progress.step(0.6 + 0.4 * batch / _BATCHES, f"checking {len(pairs)} pairs of views")
        if len(part):
            lines = [f"{view_name(int(i))} {view_name(int(j))}\n" for i, j in part]
            listing.write_text("".join(lines))
            pycolmap.verify_matches(database, listing, verification)


def best_of_both(
    a: Float[np.ndarray, "m d"], b: Float[np.ndarray, "n d"], ratio: float
) -> UInt32[np.ndarray, "k 2"]:
    """Rows of `a` and `b` that are each other's nearest, clearly nearer than the second nearest (Lowe 2004).

    All pairs are compared. Descriptors are whole numbers of length 512, so their products are exact in
    float32 and a repeated run finds the same; COLMAP's own matcher on CPUs searches approximately, by chance.
    """
    none = np.zeros((0, 2), np.uint32)
    if len(a) < 2 or len(b) < 2:
        return none
    alike = a @ b.T
    forward = alike.argmax(1)
    best = alike[np.arange(len(a)), forward]
    rows = np.flatnonzero(best == alike.max(0)[forward])
    columns = forward[rows]
    alike[rows, columns] = -1
    second = np.maximum(alike.max(1)[rows], alike.max(0)[columns])
    nearest, second = (np.arccos(np.clip(x / 512**2, 0, 1)) for x in (best[rows], second))
    clear = (nearest < _FARTHEST) & (nearest < ratio * second)
    return np.stack([rows[clear], columns[clear]], 1).astype(np.uint32)


def calibrate(database: Path, seed: int) -> float | None:
    """Let the model start from the focal length that the pairs' fundamental matrices imply: that, if they imply one.

    Source: Fetzer, Reis, Stricker, "Stable Intrinsic Auto-Calibration from Fundamental Matrices of Devices with
    Uncorrelated Camera Parameters", WACV 2020, as in COLMAP's view graph calibration. It goes downhill from where it begins, and
    now and then gets stuck there: so it begins several times, and where most end is what is implied. What has to be refined anyway
    is rounded, so that the last digits of a sum over threads decide nothing.
    """
    trial = database.with_name("calibrated.db")
    with pycolmap.Database.open(database) as opened:
        lens = opened.read_all_cameras()[0]
    options = pycolmap.ViewGraphCalibrationOptions()
    options.random_seed = seed
    options.reestimate_relative_pose = False
    ends: list[float] = []
    for share in _BEGINNINGS:
        shutil.copyfile(database, trial)
        _begin_with(trial, (share * lens.mean_focal_length(), *_straight(lens)), known=False)
        told = pycolmap.calibrate_view_graph(trial, options)
        with pycolmap.Database.open(trial) as opened:
            found = opened.read_all_cameras()[0]
        trial.unlink()
        if told and found.has_prior_focal_length:
            ends.append(found.mean_focal_length())
    alike = [[end for end in ends if abs(end / other - 1) < _ALIKE] for other in ends]
    most = max(alike, key=len, default=[])
    if len(most) < 2:
        return None
    focal = float(round(float(np.median(most))))
    _begin_with(database, (focal, *_straight(lens)))
    return focal


@dataclass(frozen=True, slots=True, eq=False)
class Grown:
    """A model and how well it explains what views have in common."""

    model: pycolmap.Reconstruction
    sizes: tuple[int, ...]  # of all the models that were found at first
    agreement: float  # share of the verified matches between its views that agree with its poses
    support: Float[np.ndarray, " n"]  # the same of each view, NaN where it is not placed
    reprojection: float  # mean over all observations, pixels
    lens_doubtful: bool  # not the expected one, and under another points fit nearly as well
    log_off: float  # share of the path by which it and the rig's log disagree; 0 without a log
    attempts: int  # models that were grown until one was good enough, or there were no more

    def better_than(self, other: "Grown") -> bool:
        """More of the matches agree; where as many do, its path is the one that the rig logged, or its points lie nearer to where
        they were seen."""
        count = len(self.support)
        mine, its = (g.agreement * g.model.num_reg_images() / count for g in (self, other))
        if abs(mine - its) > _AS_GOOD:
            return mine > its
        if max(self.log_off, other.log_off) > LOG_OFF and min(self.log_off, other.log_off) <= LOG_OFF:
            return self.log_off < other.log_off
        return self.reprojection < other.reprojection


def best_grown(
    database: Path,
    factor: int,
    count: int,
    focal: float | None,
    logged: Float[np.ndarray, "n 3 4"] | None,
    params: MapParams,
    seed: int,
    progress: Progress,
) -> Grown | None:
    """The model that the matches agree with best; None when no two views fit. `focal`: what is expected, in pixels; `logged`:
    where a rig says the camera was.

    All views are placed at once first, where their lens is about known: that is quicker, and no unlucky beginning leads it astray.
    A model grown from an unlucky pair of views under a wrong lens may hold together and yet be wrong by a tenth of the
    path; its matches know. It is grown anew then, from the lens that was found and with other chances.
    Or its lens slides off, the path and the points with it, and all matches still agree: a wide lens that bends stands
    in for a narrow one. That shows beside the expected focal length, or the path that the rig logged. Others grow then, one under a
    lens that must not bend until all views are placed, and one from beyond the expected focal length; the one whose points fit
    best is kept. Where they fit as well under another lens, the lens is in doubt. With nothing expected and no log, the one held
    straight is what the first is compared with.
    """
    best: Grown | None = None
    ends: list[tuple[float, float]] = []  # focal length and reprojection error of every model
    mapper: Mapper = "incremental" if focal is None else "global"
    for attempt in range(ATTEMPTS):
        span = progress.part(_SPANS[attempt], _SPANS[attempt + 1])
        grown = grow(database, factor, params, seed + attempt, span, mapper)
        tried, mapper = mapper, "incremental"
        if grown is None:
            continue
        model, sizes = grown
        lens, poses = camera_of(model), placed(model, count)
        length, fits = lens.mean_focal_length(), float(model.compute_mean_reprojection_error())
        pairs = epipolar.verified(database, lens, poses)
        support, agreement = epipolar.support(pairs, poses, length, 2 * params.epipolar_px * factor)
        found_anew = any(not _apart(length, other) for other, _ in ends)
        ends.append((length, fits))
        slid = focal is not None and _apart(length, focal)
        log_off = _off(logged, model, count)
        found = Grown(model, sizes, agreement, support, fits, False, log_off or 0.0, attempt + 1)
        if best is None or found.better_than(best):
            best = found
        # Two ways to one lens are proof enough that it is the log's geometry that is off.
        vouched = found_anew or (focal is not None if log_off is None else log_off <= LOG_OFF)
        whole = tried != "global" or model.num_reg_images() == count
        if agreement >= AGREED and vouched and not slid and whole:
            break
        if slid or not vouched:
            mapper = "straight" if attempt == 0 else "incremental"
            expected = focal or ends[0][0]
            beyond = _BEYOND if expected >= ends[0][0] else 1 / _BEYOND
            _begin_with(database, (expected if attempt == 0 else expected * beyond, *_straight(lens)))
        else:
            _begin_with(database, camera_of(best.model).params)
    if best is None:
        return None
    kept = camera_of(best.model).mean_focal_length()
    others = [fits for length, fits in ends if _apart(length, kept)]
    as_good = any(_CLEARLY * fits < best.reprojection for fits in others)
    return replace(best, lens_doubtful=as_good and (focal is None or _apart(kept, focal)))


def _off(
    logged: Float[np.ndarray, "n 3 4"] | None, model: pycolmap.Reconstruction, count: int
) -> float | None:
    """Share of the path by which a model and a rig's log disagree; None without a log that says it."""
    fitted = None if logged is None else rigs.fit(logged, placed(model, count))
    return None if fitted is None else fitted.position_share


def _straight(lens: pycolmap.Camera) -> tuple[float, float, float]:
    """All but the focal length of a lens that does not bend."""
    return lens.principal_point_x, lens.principal_point_y, 0.0


def _apart(focal: float, other: float) -> bool:
    return abs(focal / other - 1) > _LENS_OFF


def camera_of(model: pycolmap.Reconstruction) -> pycolmap.Camera:
    """The one camera of all views."""
    return next(iter(model.cameras.values()))


def _begin_with(database: Path, lens: Iterable[float], known: bool = True) -> None:
    """Let the next model start from this lens."""
    with pycolmap.Database.open(database) as opened:
        camera = opened.read_all_cameras()[0]
        camera.params = [float(x) for x in lens]
        camera.has_prior_focal_length = known
        opened.update_camera(camera)


def grow(
    database: Path, factor: int, params: MapParams, seed: int, progress: Progress, mapper: Mapper
) -> tuple[pycolmap.Reconstruction, tuple[int, ...]] | None:
    """The largest model, refined, and the sizes of all that were found; None when no two views fit."""
    folder = Path(tempfile.mkdtemp(prefix="models-", dir=database.parent))
    options = options_of(factor, params, seed)
    options.ba_refine_extra_params = mapper != "straight"
    if mapper == "global":
        models = _place_all(database, seed, progress.part(0.0, 0.8))
    else:
        models = _place_each(database, folder, options, None, progress.part(0.0, 0.8))
    if not models:
        return None
    sizes = tuple(sorted((model.num_reg_images() for model in models), reverse=True))
    best = max(models, key=lambda model: (model.num_reg_images(), model.num_points3D()))
    start = folder / "best"
    start.mkdir()
    best.write_binary(str(start))
    # What was hard to place early often is easy in the complete model, with points all around.
    options.multiple_models = False
    options.mapper.abs_pose_min_num_inliers = params.retry_inliers
    options.mapper.abs_pose_min_inlier_ratio = 0.15
    again = folder / "again"
    again.mkdir()
    with pycolmap.Database.open(database) as opened:
        complete = best.num_reg_images() == opened.num_images()
    grown = [] if complete else _place_each(database, again, options, start, progress.part(0.8, 0.95))
    best = max([best, *grown], key=lambda model: model.num_reg_images())
    progress.step(0.95, "refining all views together")
    refine(best, factor, params)
    return best, sizes


def options_of(factor: int, params: MapParams, seed: int) -> pycolmap.IncrementalPipelineOptions:
    """COLMAP's, for photographs enlarged by `factor`."""
    options = pycolmap.IncrementalPipelineOptions()
    # The sums of several threads end in another last digit each time; a repeated run must not.
    options.num_threads = options.mapper.num_threads = 1
    options.random_seed = seed
    options.extract_colors = False
    # COLMAP's own adjustments go on while they gain anything, at every tenth view more; what all views end at is the same.
    options.ba_local_function_tolerance, options.ba_global_function_tolerance = 1e-4, 1e-5
    options.ba_global_frames_ratio = options.ba_global_points_ratio = 1.3
    options.ba_global_max_refinements = 2
    options.ba_refine_principal_point = False
    options.mapper.init_min_tri_angle = params.first_angle_deg
    options.mapper.init_min_num_inliers = 2 * params.placed_inliers
    options.mapper.abs_pose_min_num_inliers = params.placed_inliers
    options.mapper.abs_pose_max_error = 3 * params.reprojection_px * factor
    options.mapper.filter_max_reproj_error = params.reprojection_px * factor
    options.mapper.filter_min_tri_angle = params.point_angle_deg
    options.triangulation.min_angle = params.point_angle_deg
    options.triangulation.complete_max_reproj_error = params.reprojection_px * factor
    options.triangulation.merge_max_reproj_error = params.reprojection_px * factor
    return options


def _place_all(database: Path, seed: int, progress: Progress) -> list[pycolmap.Reconstruction]:
    """COLMAP's global mapper: it can't be told to stop, and is left behind."""
    options = pycolmap.GlobalPipelineOptions()
    # One thread, as in `options_of`.
    options.num_threads = options.mapper.num_threads = 1
    options.random_seed = options.mapper.random_seed = seed
    options.mapper.track_required_tracks_per_view = _TRACKS
    options.mapper.global_positioning.use_gpu = options.mapper.bundle_adjustment.ceres.use_gpu = False
    found, failed = pycolmap.ReconstructionManager(), list[Exception]()

    def run() -> None:
        try:
            with pycolmap.Database.open(database) as opened:
                pycolmap.GlobalPipeline(options, opened, found).run()
        except Exception as error:
            failed.append(error)

    running = threading.Thread(target=run, daemon=True)
    running.start()
    while running.is_alive():
        progress.step(0.0, "placing all views at once")
        running.join(_POLL_S)
    if failed:
        raise failed[0]
    return [found.get(index) for index in range(found.size())]


def _place_each(
    database: Path,
    folder: Path,
    options: pycolmap.IncrementalPipelineOptions,
    start: Path | None,
    progress: Progress,
) -> list[pycolmap.Reconstruction]:
    """COLMAP's mapper, which can be told to stop but must not see our exception pass through it."""
    token = pycolmap.CancellationToken()
    stopped: list[Cancelled] = []
    with pycolmap.Database.open(database) as opened:
        count = opened.num_images()
    placed = 0

    def report() -> None:
        nonlocal placed
        placed += 1
        try:
            progress.step(min(placed / count, 1.0), f"placing views: {min(placed, count)} of {count}")
        except Cancelled as stop:
            stopped.append(stop)
            token.cancel()

    callback: Callable[[], None] = report
    try:
        models = pycolmap.incremental_mapping(
            database, database.parent, folder, options, str(start) if start else "",
            lambda: None, callback, token,
        )  # fmt: skip
    except InterruptedError:
        if not stopped:
            raise
        raise stopped[0] from None
    return list(models.values())


def refine(model: pycolmap.Reconstruction, factor: int, params: MapParams) -> None:
    """Robust bundle adjustment of everything, then again without the observations that do not fit."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_principal_point = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    options.ceres.loss_function_scale = 0.5 * factor
    options.ceres.solver_options.num_threads = 1  # as in `options_of`
    # COLMAP's own goes on while it gains anything: six times as long, for a ten-thousandth of a degree.
    options.ceres.solver_options.function_tolerance = 1e-6
    for _ in range(2):
        config = pycolmap.BundleAdjustmentConfig()
        for image in model.reg_image_ids():
            config.add_image(image)
        config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
        pycolmap.create_default_bundle_adjuster(options, config, model).solve()
        manager = pycolmap.ObservationManager(model)
        manager.filter_all_points3D(params.reprojection_px * factor, params.point_angle_deg)


def placed(model: pycolmap.Reconstruction, count: int) -> Float[np.ndarray, "n 3 4"]:
    """cam_from_world per view, NaN where a view is not in the model."""
    poses = np.full((count, 3, 4), np.nan)
    rows = {view_name(i): i for i in range(count)}
    for image in model.images.values():
        if image.has_pose:
            poses[rows[image.name]] = image.cam_from_world().matrix()
    return poses
