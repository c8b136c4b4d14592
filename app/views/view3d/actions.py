"""What a person can do on the 3D page, each thing with its keys; the sheet of shortcuts reads them here."""

from collections.abc import Callable, Mapping

from PySide6.QtCore import QCoreApplication
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QWidget

from app.views.page_actions import page_action


def make(page: QWidget, calls: Mapping[str, Callable[[], None]]) -> dict[str, QAction]:
    """By key; they work while the focus is anywhere on the page."""

    def tr(text: str) -> str:
        return QCoreApplication.translate("View3dPage", text)

    rows = (
        ("reset", tr("Reset"), tr("Reset the view"), ("R", "Home")),
        ("front", tr("Front"), tr("Look from the front"), ("1",)),
        ("back", tr("Back"), tr("Look from the back"), ("2",)),
        ("left", tr("Left"), tr("Look from the left"), ("3",)),
        ("right", tr("Right"), tr("Look from the right"), ("4",)),
        ("top", tr("Top"), tr("Look from above"), ("5",)),
        ("bottom", tr("Bottom"), tr("Look from below"), ("6",)),
        ("object", tr("Object"), tr("Fit the object"), ("F",)),
        ("everything", tr("Room"), tr("Fit the room"), ("Shift+F",)),
        ("previous", tr("Previous"), tr("Previous view"), ("[", "PgUp")),
        ("next", tr("Next"), tr("Next view"), ("]", "PgDown")),
        ("photograph", tr("Photograph"), tr("Show this view's photograph"), ("P",)),
        ("maps", tr("In Maps"), tr("Show this view in Maps"), ("M",)),
        ("through", tr("Look through"), tr("Look from where it was taken"), ("L",)),
        ("measure", tr("Measure…"), tr("Measure, set scale"), ("D",)),
        ("mark", tr("Mark"), tr("Mark the point in the middle to measure"), ("Shift+M",)),
        ("screenshot", tr("Screenshot…"), tr("Save a screenshot"), ("Ctrl+Shift+S",)),
        (
            "turntable",
            tr("Turntable…"),
            tr("Save a turn about the object, as a video or as pictures"),
            ("Ctrl+Shift+T",),
        ),
        (
            "path",
            tr("Cameras' way…"),
            tr("Save the cameras' way, as a video or as pictures"),
            ("Ctrl+Shift+W",),
        ),
        ("close", tr("Close photograph"), tr("Close the photograph"), ("Esc",)),
    )
    made = {}
    for key, text, tip, keys in rows:
        made[key] = page_action(page, tip, keys, calls[key])
        made[key].setIconText(text)  # of its button
    return made
