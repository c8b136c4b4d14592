"""Painting: what brush, eraser and polygon cover, and that every change is taken back exactly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app import masking
from app.masking import ADD, EXACT, NOTHING, TAKE, Editor, Painting

H, W = 30, 41  # a width whose rows must be padded


@pytest.fixture
def painting() -> Painting:
    return Painting(np.zeros((H, W), np.uint8))


@pytest.fixture
def editor(painting: Painting) -> Editor:
    made = Editor()
    made.show(painting)
    made.resize(7)
    return made


def test_a_dab_covers_the_pixels_whose_centre_is_within_the_brush(painting: Painting) -> None:
    painting.line((12.5, 10.5), (12.5, 10.5), 7, ADD)
    y, x = np.mgrid[:H, :W]
    np.testing.assert_array_equal(painting.labels == ADD, (x - 12) ** 2 + (y - 10) ** 2 <= 3.5**2)


def test_a_line_is_as_wide_as_the_brush_all_along(painting: Painting) -> None:
    painting.line((5.5, 10.5), (30.5, 10.5), 5, TAKE)
    assert ((painting.labels[:, 5:31] == TAKE).sum(axis=0) == 5).all()
    assert painting.labels[10].nonzero()[0].tolist() == list(range(3, 33))


def test_the_finest_brush_paints_the_pixel_it_is_in(painting: Painting) -> None:
    painting.line((3.02, 4.98), (3.02, 4.98), 1, ADD)
    assert np.argwhere(painting.labels).tolist() == [[4, 3]]


@pytest.mark.parametrize("place", [(-3.0, -2.0), (W + 2.0, H + 3.0), (-500.0, 9.0)])
def test_strokes_may_leave_the_picture(painting: Painting, place: tuple[float, float]) -> None:
    painting.line((20.5, 15.5), place, 6, ADD)
    painting.line(place, place, 6, ADD)
    assert painting.labels[15, 20] == ADD
    painting.polygon([(-9, -9), (W + 9, -9), (W + 9, H + 9), (-9, H + 9)], TAKE)
    assert (painting.labels == TAKE).all()


def test_a_polygon_holds_the_pixels_whose_centre_is_inside(painting: Painting) -> None:
    painting.polygon([(4, 3), (9, 3), (9, 7), (4, 7)], ADD)
    expected = np.zeros((H, W), bool)
    expected[3:7, 4:9] = True
    np.testing.assert_array_equal(painting.labels == ADD, expected)


@given(st.lists(st.tuples(st.floats(-5, W + 5), st.floats(-5, H + 5)), min_size=3, max_size=7))
def test_polygons_agree_with_the_parity_of_crossings(corners: list[tuple[float, float]]) -> None:
    inside = masking.enclosed(np.array(corners), slice(0, H), slice(0, W))
    for y, x in ((0, 0), (14, 20), (H - 1, W - 1), (7, 33)):
        px, py, crossings = x + 0.5, y + 0.5, 0
        for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
            crossings += (y0 > py) != (y1 > py) and x0 + (py - y0) / (y1 - y0) * (x1 - x0) <= px
        assert inside[y, x] == bool(crossings % 2)


places = st.tuples(st.floats(-3, W + 3), st.floats(-3, H + 3))


@given(
    st.lists(
        st.tuples(st.sampled_from(masking.TOOLS), st.booleans(), st.lists(places, min_size=1, max_size=5))
    )
)
def test_whatever_was_painted_is_taken_back_and_made_again(strokes: list) -> None:
    editor = Editor()
    painting = Painting(np.zeros((H, W), np.uint8))
    editor.show(painting)
    states, patches = [painting.labels.copy()], []
    for tool, adds, way in strokes:
        editor.choose(tool)
        editor.adds = adds
        if tool == "polygon":
            for at in way:
                editor.corner(at)
            patch = editor.close()
        else:
            editor.press(way[0])
            for at in way[1:]:
                editor.drag(at, 0.5)
            patch = editor.release()
        if patch is not None:
            patches.append(patch)
            states.append(painting.labels.copy())
    for patch, state in zip(reversed(patches), reversed(states[:-1]), strict=True):
        painting.apply(patch, back=True)
        np.testing.assert_array_equal(painting.labels, state)
    for patch, state in zip(patches, states[1:], strict=True):
        painting.apply(patch, back=False)
        np.testing.assert_array_equal(painting.labels, state)


def test_what_changes_nothing_is_no_change(editor: Editor) -> None:
    editor.choose("eraser")
    editor.press((9, 9))
    assert editor.release() is None
    assert editor.clear() is None
    editor.choose("polygon")
    editor.corner((1, 1))
    editor.corner((9, 9))
    editor.corner((9, 9))
    assert editor.corners == [(1, 1), (9, 9)]
    assert editor.close() is None


def test_adding_taking_and_rubbing_out(editor: Editor, painting: Painting) -> None:
    for adds, exact, label in ((True, False, ADD), (False, False, TAKE), (False, True, TAKE + EXACT)):
        editor.adds, editor.exact = adds, exact
        editor.press((9, 9))
        editor.release()
        assert painting.labels[9, 9] == label
    editor.choose("eraser")
    editor.press((9, 9))
    editor.release()
    assert painting.labels[9, 9] == NOTHING


def test_clearing_is_one_change_that_is_taken_back(editor: Editor, painting: Painting) -> None:
    editor.press((9, 9))
    editor.release()
    before = painting.labels.copy()
    patch = editor.clear()
    assert patch is not None
    assert painting.empty
    painting.apply(patch, back=True)
    np.testing.assert_array_equal(painting.labels, before)


def test_a_light_touch_paints_finer(editor: Editor, painting: Painting) -> None:
    editor.resize(21)
    counts = []
    for pressure in (0.0, 0.5, 1.0):
        editor.press((20, 15), pressure)
        patch = editor.release()
        counts.append(int((painting.labels > 0).sum()))
        assert patch is not None
        painting.apply(patch, back=True)
    assert counts[0] < 20 < counts[1] < counts[2]


def test_taking_back_during_a_stroke_leaves_the_stroke_its_own(editor: Editor, painting: Painting) -> None:
    editor.press((5, 5))
    first = editor.release()
    assert first is not None
    editor.press((30, 20))
    painting.apply(first, back=True)
    second = editor.release()
    assert second is not None
    painting.apply(second, back=True)
    assert painting.empty


def test_the_outline_runs_along_the_edges_of_the_pixels() -> None:
    mask = np.zeros((4, 5), bool)
    mask[1:3, 1:4] = True
    pieces = {tuple(piece) for piece in masking.outline(mask).tolist()}
    assert pieces == {(1, 1, 4, 1), (1, 3, 4, 3), (1, 1, 1, 3), (4, 1, 4, 3)}
    assert len(masking.outline(np.ones((4, 5), bool))) == 4
    assert len(masking.outline(np.zeros((4, 5), bool))) == 0


def test_rows_begin_at_whole_words_of_memory(painting: Painting) -> None:
    assert painting.labels.shape == (H, W)
    assert painting.labels.strides[0] % 4 == 0
