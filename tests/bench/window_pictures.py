"""Pictures of the real window for the README: a capture under way, processing, the 3D view, the maps.

    xvfb-run -a -s "-screen 0 1280x900x24" python -m tests.bench.window_pictures TO --session FINISHED
    QT_QPA_PLATFORM=offscreen python -m tests.bench.window_pictures TO --session FINISHED --every [PAGE ...]

FINISHED is a session with results; it is copied. What is grabbed is what the screen shows, at 1240 x 780. Fails where a
picture is blank. Look at every one before it goes into the README. With `--every`: each page (or those named) without a session
and with one, in three sizes and at twice the pixels, dark and light, for eyes that look for what is cut off, faint or covered.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from PySide6.QtGui import QImage

from app import cores
from app.views import theme
from app.views.capture.page import CapturePage
from app.views.main_window import MainWindow
from app.views.maps.page import MapsPage
from app.views.pages import PAGES
from app.views.process.page import ProcessPage
from app.views.relight.page import RelightPage
from app.views.view3d.page import View3dPage
from app.work.jobs import JobState
from tests.end_to_end import windowed
from tests.end_to_end.windowed import until

SIZE = 1240, 780
SIZES, RATIOS = ((900, 560), (1280, 720), (1600, 1000)), (1, 2)
LOOKS: tuple[theme.Theme, ...] = ("dark", "light")
MOST_BYTES = 250_000
QUALITIES = (92, 88, 84, 80, 75, 70)
SETTLED_S = 1.0  # what is drawn in a thread, and fades and scrolls, has its time
STUDIO = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "roomlight" / "studio"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("to", type=Path)
    parser.add_argument("--session", type=Path, required=True, help="with results")
    parser.add_argument("--rig", default="virtual:grbl?speed=20")
    parser.add_argument(
        "--camera", default=f"virtual:?room=parlour&object=blob&size=320x240&cache={STUDIO}",
        help="its room is baked the first time, which takes minutes",
    )  # fmt: skip
    parser.add_argument("--poses", type=int, default=48)
    parser.add_argument("--shot", type=int, default=26, help="grab the capture after so many")
    parser.add_argument("--until", type=float, default=0.3, help="share of the stage at which to grab")
    parser.add_argument("--every", nargs="*", metavar="PAGE", choices=[row.key for row in PAGES])
    args = parser.parse_args()
    if args.every is not None and "QT_SCALE_FACTOR" not in os.environ:
        words = [sys.executable, *sys.orig_argv[1:]]
        return max(
            subprocess.run(words, env={**os.environ, "QT_SCALE_FACTOR": str(ratio)}).returncode
            for ratio in RATIOS
        )
    args.to.mkdir(parents=True, exist_ok=True)
    cores.keep_kernels()  # this person's, not those of an empty cache
    blank = []
    with tempfile.TemporaryDirectory(prefix="roomlight-pictures-") as scratch:
        os.environ.update(windowed.own_places(Path(scratch) / "xdg"))
        session = Path(scratch) / "demo.session"
        shutil.copytree(args.session, session)
        with windowed.opened() as window:
            if args.every is not None:
                every(window, session, args.to, args.every or [row.key for row in PAGES])
                return 0
            window.resize(*SIZE)
            for name, image in pages(window, session, Path(scratch), args):
                to = save(image, args.to / name)
                print(f"{to}: {image.width()} x {image.height()}, {to.stat().st_size / 1000:.0f} kB")
                if windowed.is_blank(image):
                    blank.append(name)
    if blank:
        print(f"blank: {', '.join(blank)}")
    return 1 if blank else 0


def pages(
    window: MainWindow, session: Path, scratch: Path, args: argparse.Namespace
) -> Iterator[tuple[str, QImage]]:
    """Each page in a state worth looking at."""
    window.go_to_session(session)
    view = windowed.page(window, "view3d", View3dPage)
    windowed.scene_of(view)
    view.banner.hide()
    yield "view3d", grabbed(window)
    maps = windowed.page(window, "maps", MapsPage)
    for layer in ("photograph", "normal", "albedo", "depth"):
        windowed.map_of(maps, layer)
    yield "maps", grabbed(window)
    process = windowed.page(window, "process", ProcessPage)
    windowed.planned(process)
    # The surface once more, with another parameter, so that stages done and under way are seen.
    process.column.chosen.emit("surface")
    process.parameters.edited.emit("surface.gauss_newton_steps", 7)
    until(lambda: process.start.isEnabled(), "the edit is planned")
    job = windowed.begin(process)
    until(lambda: job.status.ended or job.status.fraction > args.until, "the surface is under way")
    yield "process", grabbed(window)
    process.stop.trigger()
    status = windowed.ended(job)
    if status.state is JobState.FAILED:
        raise RuntimeError(f"{status.message}\n{status.details}")
    capture = windowed.page(window, "capture", CapturePage)
    capture.new_capture()
    windowed.connect(capture, args.rig, args.camera)
    windowed.choose_plan(capture, "suited", args.poses)
    windowed.start(capture, scratch / "blob.session")
    until(lambda: windowed.taken(capture.state) >= args.shot, "the capture is under way", 3600)
    until(lambda: capture.scene.coverage.panorama.image is not None, "the light that was seen")
    yield "capture", grabbed(window)
    capture.does.end.trigger()
    windowed.finished(capture)


def every(window: MainWindow, session: Path, to: Path, keys: Sequence[str]) -> None:
    """Each page in all its looks, as PNG."""
    ratio = round(window.devicePixelRatio())
    for folder in (None, session):
        if folder is not None:
            window.go_to_session(folder)
        for key in keys:
            window.show_page(key)
            page = window.stack.currentWidget()
            if folder is not None and isinstance(page, View3dPage):
                windowed.scene_of(page)
            elif folder is not None and isinstance(page, RelightPage):
                until(lambda page=page: page.canvas.image is not None, "the object relit")
            for look in LOOKS:
                theme.choose(look)
                for size in SIZES if ratio == 1 else SIZES[:1]:
                    window.resize(*size)
                    windowed.live(SETTLED_S)
                    name = f"{key}{'' if folder else '-empty'}-{look}-{size[0]}x{size[1]}-{ratio}x.png"
                    window.grab().save(str(to / name))
                    print(to / name, flush=True)


def grabbed(window: MainWindow) -> QImage:
    """What the screen shows of the window."""
    windowed.live(SETTLED_S)
    return window.screen().grabWindow(window.winId()).toImage().convertToFormat(QImage.Format.Format_RGB888)


def save(image: QImage, stem: Path) -> Path:
    """As JPEG, as good as the size allows."""
    to = stem.with_suffix(".jpg")
    for quality in QUALITIES:
        image.save(str(to), quality=quality)
        if to.stat().st_size <= MOST_BYTES:
            return to
    raise RuntimeError(f"{to}: too large at any quality")


if __name__ == "__main__":
    sys.exit(main())
