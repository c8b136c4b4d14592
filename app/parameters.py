"""What every parameter of the stages means to a person: its name in words, unit, sense, and sensible range.

The one table of it; `tests/app/test_parameters.py` holds it against the stages' parameter dataclasses. Values,
defaults and presets are the engine's and are not repeated here. The range is what the window offers; what
`params.toml` holds beyond it is shown and kept.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from app.words import QT_TRANSLATE_NOOP


@dataclass(frozen=True, slots=True)
class Meaning:
    """One parameter; texts are translated in the context "parameters"."""

    label: str
    unit: str  # "" for counts and plain numbers
    sense: str  # the tooltip
    low: float = 0.0
    high: float = 1e6
    nothing: str = ""  # what the lowest value, or no value, stands for; "" where it stands for itself
    choices: tuple[str, ...] = ()
    advanced: bool = True  # folded away unless asked for


PX, SHARE, DEGREE = (
    QT_TRANSLATE_NOOP("parameters", "px"),
    QT_TRANSLATE_NOOP("parameters", "share"),
    QT_TRANSLATE_NOOP("parameters", "°"),
)
VIEWS = QT_TRANSLATE_NOOP("parameters", "views")
SCENE = QT_TRANSLATE_NOOP("parameters", "scene units")

# fmt: off
_TABLE: tuple[tuple[str, Meaning], ...] = (
    ("hdr.long_edge_px", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Longest edge"), PX,
        QT_TRANSLATE_NOOP("parameters", "Larger photographs are averaged down by a whole factor."),
        64, 16384, advanced=False)),
    ("hdr.saturation_share", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Saturated above"), SHARE,
        QT_TRANSLATE_NOOP("parameters", "Sensor sites above this share of the way from black to white count as saturated."),
        0.5, 1)),
    ("hdr.dark_sigmas", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Dark below"), QT_TRANSLATE_NOOP("parameters", "times the noise"),
        QT_TRANSLATE_NOOP("parameters", "Pixels whose luminance is less than so many noise floors count as dark."),
        0, 100)),
    ("hdr.ratio_tolerance", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Exposure mismatch"), SHARE,
        QT_TRANSLATE_NOOP("parameters", "A view is called suspect when its exposure steps differ by more between pixels and file facts."),
        0, 1)),
    ("hdr.hopeless_share", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Reject a photograph above"), SHARE,
        QT_TRANSLATE_NOOP("parameters", "A view is refused when more of it than this is clipped, or dark, in every exposure."),
        0, 1)),
    ("hdr.learning_views", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Views to learn the sensor from"), VIEWS,
        QT_TRANSLATE_NOOP("parameters", "How many views tell the sensor's noise and the usual exposure steps."),
        1, 1000)),

    ("segment.margin_px", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Margin around the object"), PX,
        QT_TRANSLATE_NOOP("parameters", "Kept clear of room pixels around the object, for lens blur and demosaicing."),
        0, 200, advanced=False)),
    ("segment.smoothness", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Smooth outline"), "",
        QT_TRANSLATE_NOOP("parameters", "Smoothness term of the graph cut: largest cost of separating like neighbours. Higher is smoother."),
        0, 100, advanced=False)),
    ("segment.fewest_views", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Fewest views"), VIEWS,
        QT_TRANSLATE_NOOP("parameters", "With fewer views the change from view to view tells nothing, and the stage refuses."),
        2, 1000)),
    ("segment.most_views", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Most views"), VIEWS,
        QT_TRANSLATE_NOOP("parameters", "Views looked at, evenly chosen; more add time, not certainty."),
        2, 10000)),
    ("segment.search_edge_px", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Longest edge of first guesses"), PX,
        QT_TRANSLATE_NOOP("parameters", "Size at which first guesses of the object are compared."),
        32, 4096)),
    ("segment.search_rounds", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Search rounds"), "",
        QT_TRANSLATE_NOOP("parameters", "Rounds of learning what object and room look like, and cutting, on the small size."),
        1, 50)),
    ("segment.refine_rounds", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Refining rounds"), "",
        QT_TRANSLATE_NOOP("parameters", "The same at full size."),
        0, 50)),
    ("segment.rank", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Patterns of light"), "",
        QT_TRANSLATE_NOOP("parameters", "Rank of the low-rank model of the object's shading over the views."),
        1, 64)),
    ("segment.unary_limit", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Weight of one pixel"), "",
        QT_TRANSLATE_NOOP("parameters", "Upper limit of one pixel's data term in the graph cut."),
        0, 100)),
    ("segment.unary_weight", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Evidence that counts"), SHARE,
        QT_TRANSLATE_NOOP("parameters", "Weight of a pixel's log odds; below 1, for neighbouring pixels are not independent."),
        0, 1)),
    ("segment.border_penalty", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Penalty at the border"), "",
        QT_TRANSLATE_NOOP("parameters", "Against guesses that run along the border of the picture."),
        0, 1000)),
    ("segment.min_contrast", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Least contrast"), QT_TRANSLATE_NOOP("parameters", "log"),
        QT_TRANSLATE_NOOP("parameters", "How much more has to change across the outline than within and outside, or nothing is found."),
        0, 100)),
    ("segment.same_share", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Same guess above"), SHARE,
        QT_TRANSLATE_NOOP("parameters", "A guess that shares so much with an earlier answer is not followed up."),
        0, 1)),
    ("segment.speck_share", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Specks below"), SHARE,
        QT_TRANSLATE_NOOP("parameters", "Islands and holes smaller than this share of the picture are noise."),
        0, 0.1)),

    ("poses.focal_px", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Focal length, first guess"), PX,
        QT_TRANSLATE_NOOP("parameters", "Refined from the photographs. 0: what pairs of views imply."),
        0, 1e6, nothing=QT_TRANSLATE_NOOP("parameters", "from pairs of views"), advanced=False)),
    ("poses.board", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Board of known size"), "",
        QT_TRANSLATE_NOOP("parameters", 'Fixes the scale: "charuco COLUMNSxROWS SQUARE_M MARKER_M DICTIONARY" or "aruco SIDE_M DICTIONARY".'),
        nothing=QT_TRANSLATE_NOOP("parameters", "none"), advanced=False)),
    ("poses.least_share", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Views to be placed, at least"), SHARE,
        QT_TRANSLATE_NOOP("parameters", "The stage refuses when fewer of the views could be placed."),
        0, 1)),
    ("poses.trusted_share", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Matches that must agree"), SHARE,
        QT_TRANSLATE_NOOP("parameters", "A view's pose is dropped when fewer of its matches agree with it."),
        0, 1)),
    ("poses.seed", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Seed"), "",
        QT_TRANSLATE_NOOP("parameters", "Start of the random numbers used in matching."),
        0, 2**31 - 1)),
    ("poses.features.maximum", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Features of a view, at most"), "",
        QT_TRANSLATE_NOOP("parameters", "The coarsest are kept, which are the best located."),
        100, 100000)),
    ("poses.features.altogether", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Features of all views"), "",
        QT_TRANSLATE_NOOP("parameters", "How many features all views may have together: where there are many views, each needs fewer."),
        100, 100_000_000)),
    ("poses.features.enlarge_below_px", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Enlarge photographs below"), PX,
        QT_TRANSLATE_NOOP("parameters", "Photographs whose longer side is shorter are enlarged by a whole factor before features are sought."),
        0, 16384)),
    ("poses.features.enlarge_most", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Enlarge at most"), QT_TRANSLATE_NOOP("parameters", "times"),
        QT_TRANSLATE_NOOP("parameters", "Largest factor of that."),
        1, 8)),
    ("poses.features.doubled_below_px", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Double photographs below"), PX,
        QT_TRANSLATE_NOOP("parameters", "The finest features are sought in photographs of twice the size, where their longer side is shorter."),
        0, 16384)),
    ("poses.features.peak_threshold", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Least contrast of a feature"), "",
        QT_TRANSLATE_NOOP("parameters", "Of the normalised picture; lower finds more features, and worse ones."),
        0, 1)),
    ("poses.features.margin", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Margin without features"), QT_TRANSLATE_NOOP("parameters", "of the longer side"),
        QT_TRANSLATE_NOOP("parameters", "Kept free of features around the object, which moves with the camera."),
        0, 0.5)),
    ("poses.features.neighbours", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Views to compare with"), VIEWS,
        QT_TRANSLATE_NOOP("parameters", "Each view is compared with so many others, beside those taken just before and after it."),
        1, 10000)),
    ("poses.features.exhaustive_below", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Compare all pairs below"), VIEWS,
        QT_TRANSLATE_NOOP("parameters", "With fewer views every pair is compared."),
        0, 10000)),
    ("poses.mapping.match_ratio", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Match ratio"), "",
        QT_TRANSLATE_NOOP("parameters", "Best over second best distance of two features (Lowe); lower is stricter."),
        0.1, 1)),
    ("poses.mapping.epipolar_px", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Epipolar distance"), PX,
        QT_TRANSLATE_NOOP("parameters", "Matches of two views lie this close to each other's epipolar lines."),
        0.1, 100)),
    ("poses.mapping.reprojection_px", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Reprojection error"), PX,
        QT_TRANSLATE_NOOP("parameters", "Observations further than this from their point are dropped."),
        0.1, 100)),
    ("poses.mapping.first_angle_deg", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Angle of the first two views"), DEGREE,
        QT_TRANSLATE_NOOP("parameters", "Least triangulation angle between the two views that start a model."),
        0, 90)),
    ("poses.mapping.point_angle_deg", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Angle of a point"), DEGREE,
        QT_TRANSLATE_NOOP("parameters", "Least triangulation angle of a point that is kept."),
        0, 90)),
    ("poses.mapping.placed_inliers", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Points to place a view"), "",
        QT_TRANSLATE_NOOP("parameters", "Points a view must see to be placed."),
        6, 10000)),
    ("poses.mapping.retry_inliers", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Points in the second attempt"), "",
        QT_TRANSLATE_NOOP("parameters", "The same when the model is complete and views are left over."),
        6, 10000)),

    ("light.max_gaussians", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Gaussians, at most"), "",
        QT_TRANSLATE_NOOP("parameters", "How many 3D Gaussians make up the room's light."),
        1, 1_000_000, advanced=False)),
    ("light.max_image_width", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Widest training picture"), PX,
        QT_TRANSLATE_NOOP("parameters", "Width of the largest pictures the light is fitted to."),
        32, 8192, advanced=False)),
    ("light.epochs", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Passes per size"), "",
        QT_TRANSLATE_NOOP("parameters", "Passes over the views at each picture size, coarse to fine, each twice as wide as the last."),
        advanced=False)),
    ("light.epoch_views", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Views per pass"), "",
        QT_TRANSLATE_NOOP("parameters", "How many views, drawn anew, each pass is over at most."),
        1, 100_000)),
    ("light.validation_every", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Hold out every n-th view"), "",
        QT_TRANSLATE_NOOP("parameters", "Every so many-th view only judges the fit. 0: none."),
        0, 1000, nothing=QT_TRANSLATE_NOOP("parameters", "none"))),
    ("light.camera_clearance", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Clear around the cameras"), SCENE,
        QT_TRANSLATE_NOOP("parameters", "Radius around each camera's place without Gaussians. Automatic: derived from the poses."),
        0, 1e6, nothing=QT_TRANSLATE_NOOP("parameters", "automatic"))),
    ("light.opacity_weight", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Weight of gaps"), QT_TRANSLATE_NOOP("parameters", "log radiance"),
        QT_TRANSLATE_NOOP("parameters", "Penalty on light that passes through all Gaussians: higher closes gaps in the walls."),
        0, 100)),

    ("surface.directions", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Directions of light"), "",
        QT_TRANSLATE_NOOP("parameters", "Cells on the sphere of incident directions: more resolve smaller lights, and take time in proportion."),
        0, 65536, nothing=QT_TRANSLATE_NOOP("parameters", "automatic"), advanced=False)),
    ("surface.object_distance", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Distance of the object"), SCENE,
        QT_TRANSLATE_NOOP("parameters", "From camera to object along the optical axis, where it is known. 0: found from the near light."),
        0, 1e6, nothing=QT_TRANSLATE_NOOP("parameters", "automatic"), advanced=False)),
    ("surface.tile_above_pixels", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Tiles above"), PX,
        QT_TRANSLATE_NOOP("parameters", "Of a larger object a smaller picture is solved first, then every pixel in tiles: memory stays bounded."),
        100, 10**8)),
    ("surface.coarse_iterations", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Coarse iterations"), "",
        QT_TRANSLATE_NOOP("parameters", "At half resolution: solve pixels, integrate depth, trace visibility, calibrate the light; how often."),
        0, 50, advanced=False)),
    ("surface.coarse_views", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Views of coarse iterations"), VIEWS,
        QT_TRANSLATE_NOOP("parameters", "Views, spread evenly, that serve at half resolution."),
        8, 100000)),
    ("surface.full_phase", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Calibrate at full size"), "",
        QT_TRANSLATE_NOOP("parameters", "Calibrate the light once more at full resolution; it helps steep walls and recesses."))),
    ("surface.views", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Views of fine iterations"), VIEWS,
        QT_TRANSLATE_NOOP("parameters", "Views, spread evenly, that serve on all pixels. 0: all."),
        0, 100000, nothing=QT_TRANSLATE_NOOP("parameters", "all"))),
    ("surface.fine_iterations", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Fine iterations"), "",
        QT_TRANSLATE_NOOP("parameters", "On all pixels, until they stand still: solve, integrate the depth, trace visibility; how often at most."),
        1, 50, advanced=False)),
    ("surface.gauss_newton_steps", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Gauss-Newton steps"), "",
        QT_TRANSLATE_NOOP("parameters", "Evaluations of every pixel in each iteration."),
        1, 100, advanced=False)),
    ("surface.solves", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Solves"), "",
        QT_TRANSLATE_NOOP("parameters", "From three on, each calibrates the light by other pixels, and every pixel takes the answer nearest to all."),
        1, 9, advanced=False)),
    ("surface.diffuse", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Diffuse lobe"), "",
        QT_TRANSLATE_NOOP("parameters", "disney: with retro-reflection, as renderers have it. lambert: as in the paper."),
        choices=("disney", "lambert"))),
    ("surface.without", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Leave out"), "",
        QT_TRANSLATE_NOOP("parameters", "Parts of the model and passes to do without, by name, to see what they are worth."),
        nothing=QT_TRANSLATE_NOOP("parameters", "nothing"))),
    ("surface.light_groups", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Groups of Gaussians"), "",
        QT_TRANSLATE_NOOP("parameters", "Groups whose brightness is refined, besides the lamps."),
        1, 1000)),
    ("surface.light_gain_sigma", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Uncertainty of the light"), QT_TRANSLATE_NOOP("parameters", "log brightness"),
        QT_TRANSLATE_NOOP("parameters", "Prior standard deviation of a group's log brightness: larger lets shading correct more."),
        0.001, 10)),
    ("surface.model_error", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Misfit of a good model"), SHARE,
        QT_TRANSLATE_NOOP("parameters", "Relative residual expected of a right model; no pixel's noise counts as less."),
        0.001, 1)),
    ("surface.probe_grid_xy", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Probe grid, across"), "",
        QT_TRANSLATE_NOOP("parameters", "Points along each image axis of the object's box at which the light is gathered."),
        0, 20, nothing=QT_TRANSLATE_NOOP("parameters", "automatic"))),
    ("surface.probe_grid_z", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Probe grid, in depth"), "",
        QT_TRANSLATE_NOOP("parameters", "The same along the viewing axis."),
        0, 20, nothing=QT_TRANSLATE_NOOP("parameters", "automatic"))),
    ("surface.probe_resolution", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Resolution of a probe"), PX,
        QT_TRANSLATE_NOOP("parameters", "Resolution of one face of each probe's cube."),
        8, 1024)),
    ("surface.normal_candidates", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Normal candidates"), "",
        QT_TRANSLATE_NOOP("parameters", "Normals tried at each pixel by the global search that starts the solve."),
        10, 10000)),
    ("surface.initial_normals", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Initial normals"), "",
        QT_TRANSLATE_NOOP("parameters", "A file of normals made elsewhere (.exr, .png, .npy, .npz), in place of the global search. Empty: none."))),
    ("surface.initial_roughness", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Initial roughness"), "",
        QT_TRANSLATE_NOOP("parameters", "The same for roughness. Empty: what explains the photographs best."))),
    ("surface.normals_frame", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Axes of those normals"), "",
        QT_TRANSLATE_NOOP("parameters", "opencv: y down, z ahead. opengl: y up, z towards the camera, as most networks write."),
        choices=("opencv", "opengl"))),
    ("surface.validation_views", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Validation views"), VIEWS,
        QT_TRANSLATE_NOOP("parameters", "Views kept out of the fit and rendered again, to judge it."),
        0, 1000)),

    ("export.normal_png", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Green of normal maps"), "",
        QT_TRANSLATE_NOOP("parameters", "opengl: green up (Blender, glTF). directx: green down (Unreal)."),
        choices=("opengl", "directx"), advanced=False)),
    ("export.cut_footprints", Meaning(
        QT_TRANSLATE_NOOP("parameters", "Cut the mesh above"), QT_TRANSLATE_NOOP("parameters", "pixel widths"),
        QT_TRANSLATE_NOOP("parameters", "A step in depth that neither normal explains, in widths of a pixel; both limits must be passed."),
        0, 1000, advanced=False)),
    ("export.cut_share", Meaning(
        QT_TRANSLATE_NOOP("parameters", "and above this share"), QT_TRANSLATE_NOOP("parameters", "of the step predicted"),
        QT_TRANSLATE_NOOP("parameters", "The same step as a share of the one that the normal predicts."),
        0, 1000, advanced=False)),
)
# fmt: on

MEANINGS: Mapping[str, Meaning] = dict(_TABLE)

STAGES: Mapping[str, tuple[str, str]] = {
    # stage -> its title and what it does, translated in the context "parameters"
    "hdr": (
        QT_TRANSLATE_NOOP("parameters", "Merge brackets"),
        QT_TRANSLATE_NOOP("parameters", "Merge brackets to linear radiance"),
    ),
    "segment": (
        QT_TRANSLATE_NOOP("parameters", "Mask"),
        QT_TRANSLATE_NOOP("parameters", "Tell the object from the room"),
    ),
    "poses": (
        QT_TRANSLATE_NOOP("parameters", "Poses"),
        QT_TRANSLATE_NOOP("parameters", "Find where the camera was"),
    ),
    "light": (
        QT_TRANSLATE_NOOP("parameters", "Light"),
        QT_TRANSLATE_NOOP("parameters", "Rebuild the room's light as Gaussians"),
    ),
    "surface": (
        QT_TRANSLATE_NOOP("parameters", "Surface"),
        QT_TRANSLATE_NOOP("parameters", "Solve normals, albedo, roughness, depth"),
    ),
    "export": (
        QT_TRANSLATE_NOOP("parameters", "Files"),
        QT_TRANSLATE_NOOP("parameters", "Write maps, meshes and the light"),
    ),
}
