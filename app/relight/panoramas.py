"""Five lights that ship, to relight objects with: small panoramas of plain shapes (`app/relight/make_panoramas.py` works them out).

They are dedicated to the public domain (CC0 1.0).
"""

from pathlib import Path

from app.words import QT_TRANSLATE_NOOP

FOLDER = Path(__file__).parent / "panoramas"

NAMES = {
    "softboxes": QT_TRANSLATE_NOOP("relight", "Studio, two softboxes"),
    "overcast": QT_TRANSLATE_NOOP("relight", "Overcast sky"),
    "sunset": QT_TRANSLATE_NOOP("relight", "Low sun"),
    "window": QT_TRANSLATE_NOOP("relight", "One tall window"),
    "ring": QT_TRANSLATE_NOOP("relight", "Ring of coloured lamps"),
}


def file(name: str) -> Path:
    return FOLDER / f"{name}.exr"
