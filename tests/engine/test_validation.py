"""What no stage could work with is refused as it is asked, in one line that says what may be."""

import math
from dataclasses import replace
from typing import Any

import pytest

from engine.errors import RoomlightError
from engine.hdr import params as hdr
from engine.light.fitting import params as light
from engine.reference import params as reference
from engine.results import params as export
from engine.segmentation import params as segment
from engine.sfm import params as poses
from engine.validation import MORE

BOUNDED = (
    ("hdr", hdr.HdrParams(), hdr.BOUNDS),
    ("segment", segment.SegmentParams(), segment.BOUNDS),
    ("poses", poses.PoseParams(), poses.BOUNDS),
    ("poses.features", poses.FeatureParams(), poses.FEATURE_BOUNDS),
    ("poses.mapping", poses.MapParams(), poses.MAP_BOUNDS),
    ("light", light.LightParams(), light.BOUNDS),
    ("surface", reference.ReferenceParams(), reference.BOUNDS),
    ("export", export.ExportParams(), export.BOUNDS),
)
EACH = [
    pytest.param(stage, params, name, *bounds, id=f"{stage}.{name}")
    for stage, params, table in BOUNDED
    for name, bounds in table.items()
]


@pytest.mark.parametrize(("stage", "params", "name", "least", "most"), EACH)
def test_bounds_are_met_and_not_passed(stage: str, params: Any, name: str, least: float, most: float) -> None:
    many = isinstance(getattr(params, name), tuple)

    def asked(number: float) -> Any:
        return replace(params, **{name: (3, number) if many else number})

    asked(least)
    beyond = [least - 1] if most == MORE else [least - 1, most + 1]
    for number in beyond:
        with pytest.raises(
            RoomlightError, match=rf"^{stage}\.{name} is .*{number:.10g}.*; give .*{least:.10g} "
        ):
            asked(number)
    if most != MORE:
        asked(most)
    if isinstance(getattr(params, name), float | None):
        for number in (math.nan, math.inf):
            with pytest.raises(RoomlightError, match=rf"^{stage}\.{name} is {number}; give"):
                asked(number)


@pytest.mark.parametrize(
    ("params", "changes", "told"),
    [
        (light.LightParams(), {"epochs": ()}, r"light\.epochs is \[\]; give one number or more, each of 1 or more"),
        (export.ExportParams(), {"normal_png": "foo"}, r'export\.normal_png is "foo"; give opengl or directx'),
        (reference.ReferenceParams(), {"normals_frame": "foo"}, r'surface\.normals_frame is "foo"; give opencv or opengl'),
        (poses.PoseParams(), {"board": "chess 5x7"}, r'board "chess 5x7": .*; write "charuco'),
    ],
)  # fmt: skip
def test_what_is_no_choice_is_refused_with_those_that_are(params: Any, changes: dict, told: str) -> None:
    with pytest.raises(RoomlightError, match=told):
        replace(params, **changes)


def test_what_is_left_to_the_stage_passes() -> None:
    assert replace(light.LightParams(camera_clearance=0.3), camera_clearance=None).camera_clearance is None
