"""A finished run's maps: what is drawn of them, and what stands under a pixel."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.inspect import maps, readings, runs
from app.inspect.maps import LAYERS, Look, Maps
from engine.orientation import turn_picture, turn_vectors
from tests.app import furnace

MIDDLE = (20, 15)  # column, row: on the ball
OUTSIDE = (1, 1)


@pytest.fixture
def shown(tmp_path: Path) -> Maps:
    return maps.load(runs.runs_of(furnace.finished(tmp_path))[0])


def under(
    shown: Maps, at: tuple[int, int], view: int = 0, frame: str = "opengl"
) -> dict[str, readings.Reading]:
    return {reading.title: reading for reading in readings.under(shown, *at, view, frame)}


def test_every_layer_is_drawn_at_the_photographs_size(shown: Maps) -> None:
    for key in LAYERS:
        picture = maps.picture(shown, Look(key, furnace.HELD_OUT[0]))
        assert picture is not None, key
        assert picture.levels[0].shape == (furnace.CAMERA.height, furnace.CAMERA.width, 4)
        assert picture.levels[0][MIDDLE[1], MIDDLE[0], 3] == 255
        if key not in ("photograph", "mask"):
            assert picture.levels[0][OUTSIDE[1], OUTSIDE[0], 3] == 0, key
        assert picture.scale is None or picture.scale.unit, key


def test_a_view_that_was_not_re_rendered_is_not_invented(shown: Maps) -> None:
    assert maps.picture(shown, Look("rerendered", 0)) is None
    assert maps.picture(shown, Look("difference", 0)) is None
    assert maps.picture(shown, Look("photograph", 0)) is not None


def test_a_re_rendering_made_later_is_found_and_a_damaged_one_is_not(shown: Maps) -> None:
    count = int(shown.surface.mask.sum())
    shown.rerendered.mkdir(parents=True)
    np.save(shown.rerendered / "0000.npy", np.full((count, 3), 0.25, np.float32))
    made = maps.rendering(shown, 0)
    assert made is not None
    assert made[MIDDLE[1], MIDDLE[0]] == pytest.approx(0.25)
    assert made[OUTSIDE[1], OUTSIDE[0]] == pytest.approx(0)
    np.save(shown.rerendered / "0001.npy", np.zeros((count + 1, 3), np.float32))  # of another mask
    (shown.rerendered / "0003.npy").write_bytes(b"half a file")
    assert maps.rendering(shown, 1) is None
    assert maps.rendering(shown, 3) is None


def test_the_difference_is_relative_to_the_photograph() -> None:
    mask = np.array([[True, True, True, False]])
    true = np.array([[1.0, 2.0, 4.0, 9.0]])[..., None] * np.ones(3)
    made = true * np.array([[1.1, 1.0, 0.5, 7.0]])[..., None]
    error = maps.relative_error(true.astype(np.float32), made.astype(np.float32), mask)
    assert error[0, :3] == pytest.approx([0.1, 0.0, -0.5], abs=1e-5)
    assert np.isnan(error[0, 3])


def test_what_the_object_is_made_of_is_a_map_also_where_all_of_it_is_paint(shown: Maps) -> None:
    inside = shown.surface.mask
    assert shown.surface.material is None
    assert np.unique(maps.values(shown, "specular")[inside]) == [0.5]
    assert np.unique(maps.values(shown, "metalness")[inside]) == [0.0]
    made = np.zeros((*inside.shape, 2), np.float32)
    made[MIDDLE[1], MIDDLE[0]] = 0.75, 1.0
    gilded = replace(shown, surface=replace(shown.surface, material=made))
    for key, value in (("specular", 0.75), ("metalness", 1.0)):
        assert maps.values(gilded, key)[MIDDLE[1], MIDDLE[0]] == value
        scale = maps.scale_of(gilded, key)
        assert (scale.low, scale.high) == (0, 1)


def test_units_follow_what_fixed_the_scale() -> None:
    assert maps.unit_of("board") == ("mm", 1000.0)
    assert maps.unit_of("unknown") == ("scene units", 1.0)
    assert maps.unit_of("given")[0] == "units of the given poses"


def test_values_carry_units_and_standard_errors(shown: Maps) -> None:
    found = under(shown, MIDDLE, furnace.HELD_OUT[0])
    assert found["Normal"].error == "1.1°"  # 0.02 rad
    assert found["Roughness"].error == "0.03"
    assert found["Depth"].unit == "scene units"
    assert found["Rendering error"] == readings.Reading("Rendering error", "5", "%")
    assert found["Flags"].text == "none"
    assert found["Photograph"].unit == "session radiance"
    assert [float(v) for v in found["Re-rendered"].text.split()] == pytest.approx(
        [1.1 * float(v) for v in found["Photograph"].text.split()], rel=0.01
    )


def test_a_depth_of_several_parts_says_in_which_one_a_pixel_is(shown: Maps) -> None:
    part = np.where(shown.surface.mask, 2, 0).astype(np.int16)
    part[MIDDLE[1], MIDDLE[0]] = 1
    split = replace(shown, surface=replace(shown.surface, part=part))
    assert under(split, MIDDLE)["Depth"].unit == "scene units, part 1 of 2"
    small = replace(split, surface=replace(split.surface, part=np.where(part == 1, 0, part).astype(np.int16)))
    assert under(small, MIDDLE)["Depth"].unit == "scene units, a small part"
    picture = maps.picture(split, Look("part", 0))
    assert picture is not None
    assert "less certain" in picture.note
    colours = picture.levels[0][shown.surface.mask]
    assert len(np.unique(colours, axis=0)) == 2


def test_maps_of_errors_are_in_the_unit_their_legend_says(shown: Maps) -> None:
    assert maps.values(shown, "stderr_normal")[MIDDLE[1], MIDDLE[0]] == pytest.approx(np.degrees(0.02))
    assert maps.scale_of(shown, "stderr_normal").unit == "degrees"
    assert maps.values(shown, "residual")[MIDDLE[1], MIDDLE[0]] == pytest.approx(5)
    assert maps.scale_of(shown, "residual").unit.startswith("%")
    assert maps.scale_of(shown, "roughness").high == 1


def test_a_normal_is_read_in_the_frame_it_is_shown_in(shown: Maps) -> None:
    normal = shown.surface.normal[MIDDLE[1], MIDDLE[0]]

    def numbers(frame: str) -> list[float]:
        text = under(shown, MIDDLE, 0, frame)["Normal"].text
        return [float(part.replace("\u2212", "-")) for part in text.split()]

    assert numbers("camera") == pytest.approx(normal, abs=6e-4)
    assert numbers("opengl") == pytest.approx(normal * [1, -1, -1], abs=6e-4)
    assert numbers("opengl")[2] > 0  # towards the viewer


def test_depth_is_in_millimetres_where_the_scale_is_known(shown: Maps) -> None:
    metric = replace(shown, unit="mm", unit_factor=1000.0)
    depth = float(shown.surface.depth[MIDDLE[1], MIDDLE[0]])
    assert float(under(metric, MIDDLE)["Depth"].text) == pytest.approx(1000 * depth, rel=1e-4)
    assert maps.scale_of(metric, "depth").high == pytest.approx(1000 * maps.scale_of(shown, "depth").high)


def test_outside_the_object_only_the_photograph_has_a_value(shown: Maps) -> None:
    assert list(under(shown, OUTSIDE)) == ["Photograph"]
    assert readings.under(shown, -1, 3, 0, "opengl") == ()
    assert readings.under(shown, 3, 9999, 0, "opengl") == ()


def test_clipped_and_dark_pixels_say_so(shown: Maps) -> None:
    assert shown.frames is not None
    clipped = np.zeros_like(shown.frames.clipped)
    clipped[0, MIDDLE[1], MIDDLE[0]] = True
    marked = replace(shown, frames=replace(shown.frames, clipped=clipped))
    assert under(marked, MIDDLE)["Photograph"].text.endswith("clipped")
    assert not under(marked, MIDDLE, 1)["Photograph"].text.endswith("clipped")


def test_one_exposure_serves_all_views(shown: Maps) -> None:
    brightest = furnace.GLOW * float(shown.surface.albedo.max())
    assert shown.white == pytest.approx(brightest, rel=0.1)


def test_maps_are_there_without_the_photographs(tmp_path: Path) -> None:
    session = furnace.finished(tmp_path)
    for path in (session / "stages" / "hdr" / "hhhh").iterdir():
        path.unlink()
    shown = maps.load(runs.runs_of(session)[0])
    assert shown.frames is None
    assert maps.picture(shown, Look("normal")) is not None
    assert maps.picture(shown, Look("photograph")) is None
    assert "Photograph" not in under(shown, MIDDLE)


def test_the_object_lies_in_its_box(shown: Maps) -> None:
    box = maps.object_box(shown)
    assert box is not None
    left, top, right, bottom = box
    assert shown.surface.mask[top:bottom, left:right].sum() == shown.surface.mask.sum()
    assert shown.surface.mask[top].any()
    assert shown.surface.mask[:, right - 1].any()


# ---- photographs taken on the side


@pytest.mark.parametrize("flip", [3, 5, 6])
def test_maps_stand_upright_and_say_the_same_of_the_same_place(tmp_path: Path, flip: int) -> None:
    plain, upright = (
        maps.load(runs.runs_of(furnace.finished(tmp_path / str(one), flip=one))[0]) for one in (0, flip)
    )
    for run in (plain, upright):
        count = int(run.surface.mask.sum())
        run.rerendered.mkdir(parents=True)
        np.save(run.rerendered / "0000.npy", np.linspace(0, 1, 3 * count, dtype=np.float32).reshape(count, 3))
    for key in LAYERS:
        before, after = (maps.picture(run, Look(key, 0)) for run in (plain, upright))
        assert before is not None, key
        assert after is not None, key
        if key != "normal":
            np.testing.assert_array_equal(after.levels[0], turn_picture(before.levels[0], flip), err_msg=key)
    x, y = 17, 11  # above the ball's middle and left of it
    there = {3: (39 - x, 29 - y), 5: (y, 39 - x), 6: (29 - y, x)}[flip]
    before, after = under(plain, (x, y), 0, "camera"), under(upright, there, 0, "camera")
    assert before.keys() == after.keys()
    assert {name for name in before if before[name] != after[name]} == {"Normal"}
    turned = turn_vectors(plain.surface.normal[y, x].astype(float), flip)
    assert [float(v.replace("\u2212", "-")) for v in after["Normal"].text.split()] == pytest.approx(
        turned, abs=1e-3
    )
