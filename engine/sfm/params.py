"""What a person may ask of the poses, and between which bounds."""

from dataclasses import dataclass, field

from engine.errors import PoseError
from engine.validation import MORE, check

FEATURE_BOUNDS = {
    "maximum": (100, MORE), "altogether": (100, MORE), "enlarge_below_px": (0, MORE), "enlarge_most": (1, 8), "doubled_below_px": (0, MORE),
    "peak_threshold": (0.0, 1.0),
    "margin": (0.0, 0.5), "neighbours": (1, MORE), "exhaustive_below": (0, MORE),
}  # fmt: skip
"""What each number that may be asked must lie between."""


@dataclass(frozen=True, slots=True)
class FeatureParams:
    """How features are found and which pairs of views are compared.

    Raises:
        PoseError: what is asked lies outside `FEATURE_BOUNDS`.
    """

    maximum: int = 2500  # per view, of each orientation; the coarsest are kept, which are the best located
    # Of all views together: poses are as good as all their features, and what comparing two views costs grows with the square.
    altogether: int = 240_000
    enlarge_below_px: int = 900  # photographs whose longer side is shorter are enlarged by an integer factor
    enlarge_most: int = 2
    # SIFT's first octave is of doubled photographs. Of larger ones the coarsest `maximum` are elsewhere already.
    doubled_below_px: int = 1000
    # Of the normalised image; COLMAP's 0.0067 is meant for contrasty photographs.
    peak_threshold: float = 0.004
    margin: float = 0.015  # of the longer side, kept free of features around the object
    neighbours: int = 20  # views each view is compared with, beside those taken just before and after it
    exhaustive_below: int = 40  # with fewer views all pairs are compared

    def __post_init__(self) -> None:
        check(self, "poses.features", PoseError, FEATURE_BOUNDS)


MAP_BOUNDS = {
    "match_ratio": (0.1, 1.0), "epipolar_px": (0.1, MORE), "reprojection_px": (0.1, MORE),
    "first_angle_deg": (0.0, 90.0), "point_angle_deg": (0.0, 90.0), "placed_inliers": (6, MORE),
    "retry_inliers": (6, MORE),
}  # fmt: skip
"""What each number that may be asked must lie between."""


@dataclass(frozen=True, slots=True)
class MapParams:
    """How views are compared and placed; pixels of the photographs (not enlarged).

    Raises:
        PoseError: what is asked lies outside `MAP_BOUNDS`.
    """

    match_ratio: float = 0.8  # Lowe's: best over second best descriptor distance
    epipolar_px: float = 1.5  # inliers of two views lie this close to each other's epipolar lines
    reprojection_px: float = 2.0  # observations further than this from their point are dropped
    first_angle_deg: float = 3.0  # least triangulation angle between the two views that start a model
    point_angle_deg: float = 0.5  # least triangulation angle of a point that is kept
    placed_inliers: int = 30  # points a view must see to be placed
    retry_inliers: int = 15  # the same in the second attempt, when the model is complete

    def __post_init__(self) -> None:
        check(self, "poses.mapping", PoseError, MAP_BOUNDS)


BOUNDS = {
    "focal_px": (0.0, MORE), "least_share": (0.0, 1.0), "trusted_share": (0.0, 1.0), "seed": (0, 2**31 - 1),
}  # fmt: skip
"""What each number that may be asked must lie between."""


@dataclass(frozen=True, slots=True)
class PoseParams:
    """What a person may ask of this stage.

    Raises:
        PoseError: what is asked lies outside `BOUNDS`, or is no board.
    """

    focal_px: float = 0.0  # first guess, refined; 0 means what pairs of views imply
    board: str = ""  # "charuco COLUMNSxROWS SQUARE_M MARKER_M DICTIONARY" or "aruco SIDE_M DICTIONARY"
    least_share: float = 0.5  # of the views must be placed
    trusted_share: float = 0.5  # of a view's matches must agree with its pose
    seed: int = 0
    features: FeatureParams = field(default_factory=FeatureParams)
    mapping: MapParams = field(default_factory=MapParams)

    def __post_init__(self) -> None:
        check(self, "poses", PoseError, BOUNDS)
        if self.board:
            from engine.sfm import scale_board  # with OpenCV, which most sessions do without here

            scale_board.parse(self.board)
