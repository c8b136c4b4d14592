"""The picture one zooms and pans: linked with others, true to its pixels, and usable without a mouse."""

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QColor, QImage, QMouseEvent, QWheelEvent
from PySide6.QtWidgets import QApplication, QHBoxLayout, QWidget
from pytestqt.qtbot import QtBot

from app.inspect import falsecolour
from app.views.pictures.view import ImageView
from app.views.pictures.viewport import CLOSEST, Viewport

WIDTH, HEIGHT = 64, 48
BOX = (16, 12, 48, 36)


def checks() -> np.ndarray:
    """Every pixel its own colour: red by column, green by row."""
    picture = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    picture[..., 2] = 4 * np.arange(WIDTH)
    picture[..., 1] = (5 * np.arange(HEIGHT))[:, None]
    picture[..., 3] = 255
    return picture


@pytest.fixture
def view(qtbot: QtBot) -> ImageView:
    made = ImageView()
    qtbot.addWidget(made)
    made.resize(640, 480)
    made.show()
    made.viewport.show(WIDTH, HEIGHT, BOX)
    made.show_picture([checks()])
    return made


def grabbed(view: ImageView) -> QImage:
    return view.grab().toImage()


def wheel(view: ImageView, at: QPoint, notches: int) -> None:
    event = QWheelEvent(
        QPointF(at), view.mapToGlobal(QPointF(at)), QPoint(), QPoint(0, 120 * notches), Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier, Qt.ScrollPhase.NoScrollPhase, False,
    )  # fmt: skip
    QApplication.sendEvent(view, event)


def drag(view: ImageView, start: QPoint, end: QPoint, qtbot: QtBot) -> None:
    qtbot.mousePress(view, Qt.MouseButton.LeftButton, pos=start)
    move(view, end, Qt.MouseButton.LeftButton)
    qtbot.mouseRelease(view, Qt.MouseButton.LeftButton, pos=end)


def move(view: ImageView, to: QPoint, held: Qt.MouseButton = Qt.MouseButton.NoButton) -> None:
    event = QMouseEvent(
        QEvent.Type.MouseMove, QPointF(to), view.mapToGlobal(QPointF(to)), Qt.MouseButton.NoButton, held,
        Qt.KeyboardModifier.NoModifier,
    )  # fmt: skip
    QApplication.sendEvent(view, event)


def test_the_object_is_fitted_and_again_after_resizing(view: ImageView) -> None:
    assert view.viewport.centre == QPointF(0.5, 24 / WIDTH)
    assert view.viewport.scale == pytest.approx(640 / 32 / 1.08)
    view.resize(320, 480)
    assert view.viewport.scale == pytest.approx(320 / 32 / 1.08)
    view.viewport.fit("all")
    assert view.viewport.scale == pytest.approx(320 / 64 / 1.08)


def test_pixels_stand_where_the_viewport_says(view: ImageView) -> None:
    image = grabbed(view)
    for column, row in ((20, 15), (32, 24), (46, 30)):
        at = view.from_picture(QPointF((column + 0.5) / WIDTH, (row + 0.5) / WIDTH)).toPoint()
        colour = image.pixelColor(at)
        assert (colour.red(), colour.green()) == pytest.approx((4 * column, 5 * row), abs=1)


def test_the_wheel_zooms_about_the_mouse(view: ImageView) -> None:
    at = QPoint(500, 120)
    before, scale = view.to_picture(QPointF(at)), view.viewport.scale
    wheel(view, at, 2)
    after = view.to_picture(QPointF(at))
    assert view.viewport.scale == pytest.approx(1.44 * scale)
    assert (after.x(), after.y()) == pytest.approx((before.x(), before.y()))
    wheel(view, at, 60)
    assert view.viewport.scale == pytest.approx(CLOSEST)


def test_dragging_moves_the_picture_with_the_mouse(view: ImageView, qtbot: QtBot) -> None:
    held = view.to_picture(QPointF(300, 200))
    drag(view, QPoint(300, 200), QPoint(360, 170), qtbot)
    now = view.to_picture(QPointF(360, 170))
    assert (now.x(), now.y()) == pytest.approx((held.x(), held.y()))


def test_linked_views_move_and_point_together(qtbot: QtBot) -> None:
    both = QWidget()
    qtbot.addWidget(both)
    layout = QHBoxLayout(both)
    viewport = Viewport(both)
    one, other = ImageView(both, viewport), ImageView(both, viewport)
    for view in (one, other):
        layout.addWidget(view)
        view.show_picture([checks()])
    both.resize(700, 300)
    both.show()
    viewport.show(WIDTH, HEIGHT, BOX)
    wheel(one, QPoint(40, 40), 3)
    assert one.to_picture(QPointF(50, 60)) == other.to_picture(QPointF(50, 60))
    plain = grabbed(other)
    move(one, QPoint(80, 90))
    assert viewport.pixel() is not None
    assert grabbed(other) != plain  # the cursor is drawn there too


def test_the_pixel_pointed_at_is_told(view: ImageView) -> None:
    column, row = 40, 30
    move(view, view.from_picture(QPointF((column + 0.5) / WIDTH, (row + 0.5) / WIDTH)).toPoint())
    assert view.viewport.pixel() == (column, row)
    QApplication.sendEvent(view, QEvent(QEvent.Type.Leave))
    assert view.viewport.pixel() is None


def test_outside_the_picture_there_is_no_pixel(view: ImageView) -> None:
    view.viewport.fit("all")
    move(view, QPoint(1, 1))
    assert view.viewport.pixel() is None


def test_everything_goes_with_keys(view: ImageView, qtbot: QtBot) -> None:
    view.setFocus()
    key = Qt.Key
    qtbot.keyClick(view, key.Key_Right)
    assert view.viewport.pixel() == (33, 24)
    qtbot.keyClick(view, key.Key_Down, Qt.KeyboardModifier.ShiftModifier)
    assert view.viewport.pixel() == (33, 34)
    scale = view.viewport.scale
    qtbot.keyClick(view, key.Key_Plus)
    assert view.viewport.scale > scale
    qtbot.keyClick(view, key.Key_Minus)
    assert view.viewport.scale == pytest.approx(scale)
    centre = view.viewport.centre
    qtbot.keyClick(view, key.Key_Left, Qt.KeyboardModifier.ControlModifier)
    assert view.viewport.centre.x() < centre.x()
    qtbot.keyClick(view, key.Key_1)
    assert view.viewport.scale * view.devicePixelRatioF() == pytest.approx(1)
    qtbot.keyClick(view, key.Key_F)
    assert view.viewport.scale == pytest.approx(scale)


def test_the_cursor_is_followed_out_of_sight(view: ImageView, qtbot: QtBot) -> None:
    for _ in range(3):
        qtbot.keyClick(view, Qt.Key.Key_Right, Qt.KeyboardModifier.ShiftModifier)
    assert view.viewport.pixel() == (62, 24)
    at = view.from_picture(QPointF(62.5 / WIDTH, 24.5 / WIDTH))
    assert 0 <= at.x() <= view.width()


def test_a_grid_shows_from_afar_no_more(view: ImageView) -> None:
    view.viewport.zoom(2)
    close = grabbed(view)
    edge = view.from_picture(QPointF(30 / WIDTH, 20.5 / WIDTH)).toPoint()
    inside = view.from_picture(QPointF(30.5 / WIDTH, 20.5 / WIDTH)).toPoint()
    lines = [close.pixelColor(edge.x() + x, edge.y()) for x in (-1, 0, 1)]
    assert any(abs(colour.blue() - close.pixelColor(inside).blue()) > 20 for colour in lines)
    view.viewport.zoom(0.1)
    far = grabbed(view)
    assert all(far.pixelColor(x, far.height() // 2).blue() < 10 for x in range(300, 340))


def test_values_stand_in_large_pixels(view: ImageView) -> None:
    asked: list[tuple[int, int]] = []
    view.pixel_text = lambda x, y: asked.append((x, y)) or "0.5"
    grabbed(view)
    assert not asked
    view.viewport.zoom(100)
    grabbed(view)
    assert asked
    assert len(asked) < 200  # only what is seen


def test_a_swipe_parts_two_pictures(view: ImageView, qtbot: QtBot) -> None:
    other = checks()
    other[..., 0] = 200
    view.show_picture([checks()], [other])
    view.set_split(0.25)
    image = grabbed(view)
    assert image.pixelColor(100, 300).blue() == 0
    assert image.pixelColor(250, 300).blue() == 200
    drag(view, QPoint(160, 100), QPoint(480, 100), qtbot)
    assert view.split == pytest.approx(0.75)
    assert grabbed(view).pixelColor(250, 300).blue() == 0
    qtbot.keyClick(view, Qt.Key.Key_Comma)
    assert view.split == pytest.approx(0.73)
    qtbot.mouseDClick(view, Qt.MouseButton.LeftButton, pos=QPoint(round(0.73 * 640), 50))
    assert view.split == 0.5


def test_a_double_click_beside_the_swipe_is_the_owners(view: ImageView, qtbot: QtBot) -> None:
    with qtbot.waitSignal(view.activated, timeout=1000):
        qtbot.mouseDClick(view, Qt.MouseButton.LeftButton, pos=QPoint(100, 100))


def test_words_stand_in_place_of_a_picture(view: ImageView) -> None:
    view.show_picture(None, message="not computed yet")
    image = grabbed(view)
    ground = image.pixelColor(5, 5)
    assert any(image.pixelColor(x, 240) != ground for x in range(250, 390))
    assert view.full is None


def test_small_levels_serve_small_pictures(view: ImageView) -> None:
    """A level of another colour shows which one was drawn."""
    grey = np.full((HEIGHT // 2, WIDTH // 2, 4), 255, np.uint8)
    view.show_picture([checks(), grey])
    view.viewport.natural(view.devicePixelRatioF())
    middle = QColor(grabbed(view).pixelColor(320, 240))
    assert middle.blue() < 50
    view.viewport.zoom(0.3)
    assert grabbed(view).pixelColor(320, 240).blue() == 255


def test_pictures_outlive_their_arrays(view: ImageView) -> None:
    levels = falsecolour.halves(checks())
    view.show_picture(levels)
    first = grabbed(view)
    del levels
    np.full((HEIGHT, WIDTH, 4), 7, np.uint8)  # would take the freed memory's place
    assert grabbed(view) == first
