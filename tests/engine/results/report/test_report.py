"""The page stands alone, says what is missing, and its numbers are those of the records."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from engine.color import relative_error
from engine.hdr.merge import HdrReport, Step
from engine.io.ground_truth import Truth
from engine.pipeline.artifacts import plain
from engine.results.report import report
from engine.results.report.report import Contents, StageRun, cautions
from engine.surface.lighting.distance_search import Distance
from engine.types import Poses, ValidationRenders
from tests.engine.ball import CAMERA, ball
from tests.engine.results.test_export import gaussians, grounds, panorama
from tests.engine.results.test_metrics import ring

VOID = {"meta", "img", "br", "circle", "path", "polyline"}


class Reader(HTMLParser):
    """Collects text and links, and checks that tags close in order (table rows may leave th open)."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.text: list[str] = []
        self.headings: list[str] = []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        self.links += [value for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag):
        if tag in VOID:
            return
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)
        if self.open[-1:] == ["h2"]:
            self.headings.append(data)


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    assert reader.open == []
    return reader


def poses(lost: int = 2) -> Poses:
    cam_from_world = ring(8)
    cam_from_world[:lost] = np.nan
    registered = np.arange(8) >= lost
    points = np.random.default_rng(1).normal(size=(50, 3))
    return Poses(CAMERA, cam_from_world, registered, points, "unknown", 0.4)


def full() -> Contents:
    surface = ball()
    photographs = np.where(surface.mask[..., None], surface.albedo + 0.1, 0.5)[None]
    hdr = HdrReport(
        views=8, exposures=3, steps=(Step(3.0, 2.5, 0.004, 0.03, "v7"),), suspect=("v1",), unfitted=(),
        gain_counts=1.0, read_counts=2.0, white_share=0.99, share_clipped=0.021, share_dark=0.0,
        most_clipped="v4", most_clipped_share=0.3, scale=1.0, reduced_by=1,
    )  # fmt: skip
    return Contents(
        title="lion & <lamb>",
        when="1 May 2025",
        names=tuple(f"v{k}" for k in range(8)),
        photograph=photographs[0],
        surface=surface,
        renders=ValidationRenders((5,), (1.1 * photographs * surface.mask[..., None]).astype(np.float32)),
        held_out=photographs,
        panorama=panorama(),
        grounds=grounds(),
        poses=poses(),
        gaussians=gaussians(),
        hdr=hdr,
        stages=(StageRun("surface", 75.0, "cpu", {"directions": 2048}, {"residual": 0.03125}),),
        exported=("maps.exr", "surface.glb"),
        notes=("A note of the caller.",),
        software={"numpy": "2.4"},
    )


def test_the_page_is_well_formed_and_asks_nothing_of_the_network():
    page = report.html(full())
    reader = read(page)
    assert reader.links
    assert all(link.startswith("data:image/") for link in reader.links)
    assert not re.search(r"https?://|url\(|@import|<script", page)


def test_every_section_is_there_with_units():
    reader = read(report.html(full()))
    assert reader.headings == [
        "Maps", "How sure", "To be careful about", "Re-rendered views", "The light", "The path", "Exposures",
        "Time", "Files", "Parameters, reports and versions",
    ]  # fmt: skip
    text = " ".join(reader.text)
    for unit in ("degrees", "EV", "scene units", "min", "%"):
        assert unit in text


def test_names_are_text_not_markup():
    page = report.html(full())
    assert "lion &amp; &lt;lamb&gt;" in page
    assert "<lamb>" not in page


@pytest.mark.parametrize("doubtful", [True, False])
@pytest.mark.parametrize(
    ("expected", "words"), [(264.0, "264 px were expected"), (None, "other lenses fit as well")]
)
def test_a_lens_far_from_the_expected_one_is_warned_of(doubtful: bool, expected: float | None, words: str):
    facts = {"lens_doubtful": doubtful, "focal_px": 187.2, "focal_expected_px": expected}
    stage = StageRun("poses", 9.0, "cpu", {}, facts)
    text = " ".join(cautions(replace(full(), stages=(stage,))))
    assert (f"found to be 187 px where {words}" in text) == doubtful


@pytest.mark.parametrize("doubtful", [True, False])
def test_a_rig_that_was_elsewhere_is_warned_of(doubtful: bool):
    stage = StageRun("poses", 9.0, "cpu", {}, {"rig_doubtful": doubtful, "rig_position_m": 0.0621})
    text = " ".join(cautions(replace(full(), stages=(stage,))))
    assert ("the photographs put the camera 62 mm apart" in text) == doubtful


def test_poses_that_the_photographs_contradict_are_warned_of():
    facts = {"judged": 52, "off": ("IMG_3", "IMG_8"), "off_deg": 1.873, "told_deg": 0.0631}
    text = " ".join(
        read(report.html(replace(full(), stages=(StageRun("poses", 9.0, "cpu", {}, facts),)))).text
    )
    assert "The poses of 2 of 52 views are not what the photographs show: IMG_3, IMG_8." in text
    assert "1.9 degrees from where the poses put it; photographs like these tell 0.06." in text


@pytest.mark.parametrize(
    "facts",
    [{"judged": 52, "off": (), "off_deg": None, "told_deg": 0.06}, {"agreement": 0.73, "doubtful": True}],
)
def test_right_poses_are_not_warned_of_nor_what_an_older_version_doubted(facts: dict[str, object]):
    text = " ".join(cautions(replace(full(), stages=(StageRun("poses", 9.0, "cpu", {}, facts),))))
    assert "photographs show" not in text


def test_the_drawing_of_the_path_tells_of_light_that_is_beyond_it_and_of_none_before_there_is_any():
    whole = full()
    assert whole.gaussians is not None
    away = replace(whole.gaussians, means=whole.gaussians.means + 1e4)
    assert "strongest Gaussians lie beyond" in report.html(replace(whole, gaussians=away))
    assert "strongest Gaussians" not in report.html(replace(whole, gaussians=None))


@pytest.mark.parametrize("share", [2.5e-7, 0.02])
def test_pixels_below_noise_are_told_where_they_are_more_than_a_handful(share: float):
    whole = full()
    assert whole.hdr is not None
    lines = " ".join(cautions(replace(whole, hdr=replace(whole.hdr, share_dark=share))))
    assert ("2 % of all pixels are below noise" in lines) == (share > 0.01)
    assert ("below noise" in lines) == (share > 0.01)


@pytest.mark.parametrize("score", [3.16, 7.2])
def test_an_outline_that_hardly_stands_out_is_warned_of(score: float):
    stage = StageRun("segment", 9.0, "cpu", {}, {"stands_out": score})
    lines = " ".join(cautions(replace(full(), stages=(stage,))))
    assert ("outline hardly stands out from the room (contrast 3.2; 4 or more is clear)" in lines) == (
        score < 4
    )


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        ((0.97,), None),
        ((0.64, 0.33), "into 2 parts (64 %, 33 % of the pixels)"),
        (
            (0.4, 0.2, 0.1, 0.08, 0.05, 0.02),
            "into 6 parts (40 %, 20 %, 10 %, 8 % and 2 smaller of the pixels)",
        ),
    ],
)
def test_parts_of_the_depth_that_no_shading_joins_are_told(parts: tuple[float, ...], told: str | None):
    stage = StageRun("surface", 9.0, "cpu", {}, {"depth_parts": parts})
    lines = " ".join(cautions(replace(full(), stages=(stage,))))
    assert ("The offsets between them are not determined." in lines) == (told is not None)
    assert told is None or told in lines


def test_how_far_parts_stand_behind_one_another_is_told_as_well_as_it_is_known():
    facts = {"depth_parts": (0.6, 0.2, 0.1), "part_stderr_px": (2.0, 64.0, 6.2)}
    lines = " ".join(cautions(replace(full(), stages=(StageRun("surface", 9.0, "cpu", {}, facts),))))
    assert "The offsets of 2 of them are known to 6 pixel widths or better." in lines


@pytest.mark.parametrize("share", [0.56, 0.01])
def test_light_that_only_the_shading_told_is_warned_of(share: float):
    stage = StageRun("surface", 9.0, "cpu", {}, {"unseen_light": share})
    lines = " ".join(cautions(replace(full(), stages=(stage,))))
    assert ("56 % of the light on the object comes from directions that no photograph shows" in lines) == (
        share > 0.5
    )
    assert ("Turn camera and object about a second axis" in lines) == (share > 0.5)


@pytest.mark.parametrize(
    ("stderr", "source", "scale", "number", "why"),
    [
        (0.013, "light", "rig", "0.7321 m ± 0.013", "standard error"),
        (0.013, "light", "given", "0.7321 units of the given poses ± 0.013", "standard error"),
        (0.013, "light", "unknown", "not known", "scale is unknown (0.7321 ± 0.013 scene units)"),
        (float("inf"), "light", "rig", "not known", "the light does not tell it"),
        (float("nan"), "light", "rig", "not known", "the light does not tell it"),
        (0.0, "given", "rig", "0.7321 m", "(given)"),
    ],
)
def test_the_distance_is_told_with_its_error_or_as_not_known(
    stderr: float, source: str, scale: str, number: str, why: str
):
    found = plain(Distance(0.73214, stderr, source))  # as the stage stores it
    stage = StageRun("surface", 9.0, "cpu", {}, {"distance": found})
    text = read(report.html(replace(full(), poses=replace(poses(), scale=scale), stages=(stage,)))).text
    assert number in text
    (said,) = [words for words in text if words.startswith("from the camera to the object")]
    assert why in said


def test_no_distance_is_told_before_a_surface_has_found_it():
    assert "from the camera to the object" not in " ".join(read(report.html(full())).text)


@pytest.mark.parametrize("drift", [-0.075, 0.03])
def test_light_that_differs_from_the_backgrounds_is_warned_of(drift: float):
    stage = StageRun("surface", 9.0, "cpu", {}, {"exposure_drift": [0.0, drift, 0.01]})
    lines = " ".join(cautions(replace(full(), stages=(stage,))))
    assert ("7.8 % brighter or darker than the background" in lines) == (drift < -0.05)


def test_the_iterations_of_the_surface_are_told_with_what_they_gained():
    one = {
        "phase": "fine", "passes": ["solve_pixels", "trace_visibility"], "pixels": 900, "residual": 1.25,
        "turned_deg": None, "validation_error": 0.034, "kept": False,
    }  # fmt: skip
    stage = StageRun("surface", 9.0, "cpu", {}, {"history": [one]})
    text = " ".join(read(report.html(replace(full(), stages=(stage,)))).text)
    assert "solve pixels, trace visibility" in text
    assert "1.25" in text
    assert "3.40%" in text
    assert "undone" in text
    assert "Iterations of the surface" not in " ".join(read(report.html(full())).text)


def test_the_parts_of_the_model_are_told_with_what_they_are_worth():
    worths = [
        {"part": "gloss", "gain": 0.034, "stderr": 0.01},
        {"part": "visibility", "gain": 0.001, "stderr": 0.002},
        {"part": "interreflection", "gain": 0.0004, "stderr": 0.0001},  # sure, but next to nothing
    ]
    facts = {"held_out_error": 0.05, "part_worths": worths, "probes": [2, 3, 1], "directions": 512}
    text = " ".join(
        read(report.html(replace(full(), stages=(StageRun("surface", 9.0, "cpu", {}, facts),)))).text
    )
    assert "gloss +3.40% 1.00% no" in text
    assert "visibility +0.10% 0.20% yes" in text
    assert "interreflection +0.04% 0.01% yes" in text
    assert "2 x 3 x 1 probes in 512 directions" in text


def test_what_was_clipped_lost_or_guessed_is_listed():
    text = " ".join(read(report.html(full())).text)
    assert "2.1 % of all pixels are clipped" in text
    assert "most in v4: 30 %" in text
    assert "EXIF contradicts the pixels in v1" in text
    assert "2 of 8 views have no pose and were not used: v0, v1." in text
    assert "unit is unknown" in text
    assert "12.5 % of the light on the object is a guess, 6.2 % is a lower bound." in text
    assert "No photograph shows 50 % of the light's sphere" in text
    assert "A note of the caller." in text


def test_the_exposure_residual_is_pixels_less_exif():
    text = " ".join(read(report.html(full())).text)
    assert "-0.5000" in text
    assert "+2.5000" in text


def test_what_has_not_run_is_said_and_nothing_is_claimed():
    reader = read(report.html(Contents("new", "today", ("a", "b"))))
    text = " ".join(reader.text)
    for said in ("surface is not solved yet", "light is not reconstructed yet", "poses are not known",
                 "not merged yet", "not written out yet", "Not known before the stages"):  # fmt: skip
        assert said in text
    assert "Nothing was clipped" not in text


def test_the_difference_is_relative_to_the_photograph():
    photographed = np.full((2, 2, 3), 0.5)
    rendered = photographed * np.array([[1.0, 1.1], [0.8, 1.0]])[..., None]
    error = relative_error(photographed, rendered, np.ones((2, 2), bool))
    assert error == pytest.approx(np.array([[0, 0.1], [-0.2, 0]]))
    text = " ".join(read(report.html(full())).text)
    assert "median size 10.0 %" in text


def test_errors_against_a_truth_are_drawn_and_scored():
    assert "Against the truth" not in read(report.html(full())).headings
    surface = ball()
    c, s = np.cos(np.radians(3.0)), np.sin(np.radians(3.0))
    # A turn about x by 3 deg moves every normal by at most 3 deg.
    true = Truth(
        surface.normal @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), surface.albedo * 0.9,
        surface.roughness, surface.depth, surface.mask,
    )  # fmt: skip
    reader = read(report.html(replace(full(), truth=true, evaluation={"surface coverage": 1.0})))
    assert "Against the truth" in reader.headings
    text = " ".join(reader.text)
    told = float(re.search(r"Error of the normal , degrees\. Mean ([\d.]+)", text)[1])
    assert 2.0 < told < 3.0
    assert "surface coverage" in text


@pytest.mark.parametrize(("error", "words"), [(0.5, "Quality: not to be trusted"), (0.02, "Quality: good")])
def test_the_verdict_stands_before_the_maps(error: float, words: str):
    stage = StageRun("surface", 9.0, "cpu", {}, {"held_out_error": error, "stderr_normal_deg": 1.0})
    page = report.html(replace(full(), stages=(stage,)))
    assert page.index(words) < page.index("How sure")
    assert "Quality:" not in report.html(replace(full(), stages=()))
