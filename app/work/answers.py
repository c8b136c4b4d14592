"""The child that answers the window's quick questions, so that no engine room is ever loaded by the window.

Questions come as `{"command": "ask", "id": 7, "question": "plan", ...}` and are answered, the urgent first, by
`{"event": "data", "kind": "answer", "id": 7, "answer": {...}}` or with `fault`, a one-line error, in its place.
"""

import dataclasses
import queue
import traceback
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from app.work import photograph
from app.work.worker import Link
from engine.errors import Cancelled, RoomlightError

# Lower comes first: a plan shows at once, pictures can wait, and torch takes seconds to load.
URGENCY = {
    "plan": 0,
    "folder": 0,
    "look": 1,
    "photograph": 1,
    "preview": 1,
    "thumbnail": 1,
    "made": 1,
    "exported": 1,
    "gpu": 2,
}


def serve(request: Mapping[str, Any], link: Link) -> None:
    """Answer until cancelled. Request: nothing."""
    asked: queue.PriorityQueue[tuple[int, int, Mapping[str, Any]]] = queue.PriorityQueue()

    def hear(content: Mapping[str, Any]) -> None:
        asked.put((URGENCY.get(content.get("question", ""), 0), int(content["id"]), content))

    link.hear("ask", hear)
    while not link.cancelled():
        try:
            _, number, content = asked.get(timeout=0.2)
        except queue.Empty:
            continue
        answer_one(number, content, link)
    raise Cancelled("no more questions")


def answer_one(number: int, content: Mapping[str, Any], link: Link) -> None:
    """One question; whatever goes wrong is its answer, and the next is heard all the same."""
    answers = {
        "plan": plan, "folder": folder, "look": photograph.look, "photograph": photograph.show, "preview": preview,
        "thumbnail": thumbnail, "made": made, "exported": exported, "gpu": gpu,
    }  # fmt: skip
    try:
        answer = answers[content["question"]](content)
    except RoomlightError as error:
        fault = " ".join(str(error).split())
        link.emit("data", kind="answer", id=number, fault=fault, details="")
    except Exception as error:
        # This loop is a runner of jobs: a question that fails must not take the others with it.
        fault = f"a fault in Roomlight itself ({type(error).__name__}: {error}); send the details"
        link.emit("data", kind="answer", id=number, fault=fault, details=traceback.format_exc())
    else:
        link.emit("data", kind="answer", id=number, answer=answer)


def plan(content: Mapping[str, Any]) -> dict[str, Any]:
    """What each stage would do, with all its parameters, and the settings that decided it.

    Question: session; settings (as params.toml; None: what it holds); keep (write them there first).
    """
    from app.quality import quality_of
    from engine.io import session as sessions
    from engine.pipeline import settings as asked
    from engine.pipeline import stage_table, stages

    session = sessions.open_session(Path(content["session"]))
    written = sessions.read_params(session)
    wanted = content.get("settings")
    settings = asked.from_toml(written if wanted is None else wanted)
    rows = stage_table.stages(settings.solver)
    steps = stages.plan(session, rows, settings)
    if content.get("keep") and asked.to_toml(settings) != written:
        sessions.write_params(session, asked.to_toml(settings))
    defaults = {step.stage.name: _defaults(step.stage, settings.preset) for step in steps}
    verdict = quality_of({step.stage.name: step.folder for step in steps if step.done})
    return {
        "settings": asked.to_toml(settings),
        "notes": list(settings.notes),
        "quality": None if verdict is None else dataclasses.asdict(verdict),
        "stages": [
            {
                "name": step.stage.name,
                "done": step.done,
                "given": step.given,
                "reasons": list(step.reasons),
                "folder": str(step.folder),
                "took_s": _took(step.folder.parent),
                "parameters": _parameters(step.stage.name, step.params, defaults[step.stage.name]),
            }
            for step in steps
        ],
    }


def _defaults(stage: Any, preset: str) -> Any:
    from engine.pipeline import settings as asked

    return asked.resolve(stage.name, stage.defaults, stage.presets.get(preset, {}), {})


def _parameters(path: str, params: Any, defaults: Any) -> list[dict[str, Any]]:
    """Every single parameter with its dotted name, kind, value and the preset's default."""
    hints = typing.get_type_hints(type(params))
    found = []
    for item in dataclasses.fields(params):
        name, value, default = f"{path}.{item.name}", getattr(params, item.name), getattr(defaults, item.name)
        if dataclasses.is_dataclass(value):
            found += _parameters(name, value, default)
        else:
            hint = hints[item.name]
            found.append(
                {
                    "name": name,
                    "kind": _kind(hint),
                    "choices": _choices(hint),
                    "value": value,
                    "default": default,
                }
            )
    return found


def _kind(hint: Any) -> str:
    """ "int", "float", "bool", "str", "list" of whole numbers, "words"; with "?" where it may be left to the stage."""
    if typing.get_origin(hint) is tuple:
        return "words" if str in typing.get_args(hint) else "list"
    if choices := _choices(hint):
        return type(choices[0]).__name__
    args = [arg for arg in typing.get_args(hint) if arg is not type(None)]
    return f"{args[0].__name__}?" if args else hint.__name__


def _choices(hint: Any) -> list[Any]:
    """The values that may be chosen; none where any value of the kind may."""
    return list(typing.get_args(hint)) if typing.get_origin(hint) is typing.Literal else []


def _took(folder: Path) -> float | None:
    """Seconds of the stage's latest finished run in this session."""
    from app.costs import latest_run

    run = latest_run(folder)
    return float(run[1]["seconds"]) if run else None


def gpu(content: Mapping[str, Any]) -> dict[str, Any]:
    """The name of the CUDA device; "" where torch finds none. Question: nothing."""
    from engine.pipeline.run import has_cuda

    if not has_cuda():
        return {"name": ""}
    import torch

    return {"name": torch.cuda.get_device_name(0)}


def made(content: Mapping[str, Any]) -> dict[str, Any]:
    """What a stage made, as a picture and numbers. Question: session, stage."""
    from app.work import stage_picture

    return stage_picture.show(content)


def exported(content: Mapping[str, Any]) -> dict[str, Any]:
    """A picture of one format of a finished export. Question: folder, format."""
    from app.work import exported as drawn

    return drawn.show(content)


def folder(content: Mapping[str, Any]) -> dict[str, Any]:
    """What an import of a folder would begin with. Question: folder, bracket (exposures a view; None finds out).

    Answer: kind, files, views, exposures (of a view), camera, width, height, notes, and shown: some files, spread evenly.
    """
    from engine import importing

    found = importing.survey(Path(content["folder"]), content.get("bracket"))
    middles = [str(files[len(files) // 2]) for files in found.views]
    few = min(len(middles), int(content["shown"]))
    return {
        "kind": found.kind,
        "files": sum(len(files) for files in found.views),
        "views": len(found.views),
        "exposures": len(found.views[0]),
        "camera": found.camera["model"],
        "width": found.camera["width"],
        "height": found.camera["height"],
        "notes": list(found.notes),
        "shown": [middles[i * (len(middles) - 1) // max(few - 1, 1)] for i in range(few)],
    }


def preview(content: Mapping[str, Any]) -> dict[str, Any]:
    """A small picture of a file, kept in `to` as PNG. Question: file, edge_px, to."""
    return {"picture": _small(Path(content["file"]), None, int(content["edge_px"]), Path(content["to"]))}


def thumbnail(content: Mapping[str, Any]) -> dict[str, Any]:
    """A small picture of a session, kept in `to` as PNG. Question: session, edge_px, to."""
    from engine.io import session as sessions

    session = sessions.open_session(Path(content["session"]))
    views = sessions.shots(session)
    if not views:
        return {"picture": None}
    files = views[len(views) // 2].files
    edge_px, to = int(content["edge_px"]), Path(content["to"])
    return {"picture": _small(files[len(files) // 2], session.orientation, edge_px, to)}


def _small(file: Path, flip: int | None, edge_px: int, to: Path) -> str:
    """A file as a small PNG in `to`; RAW turned by LibRaw's `flip`, None: as it says itself."""
    import cv2
    import numpy as np

    from engine.color import luminance
    from engine.io import images
    from engine.io import session as sessions
    from engine.io.suffixes import LINEAR_SUFFIXES

    linear = file.suffix.lower() in LINEAR_SUFFIXES
    radiance = images.read_radiance(file) if linear else _developed(file, flip)
    by = max(1, min(radiance.shape[:2]) // edge_px)
    small = cv2.resize(radiance, None, fx=1 / by, fy=1 / by, interpolation=cv2.INTER_AREA)
    middle = float(np.median(luminance(small))) or 1e-6
    toned = images.tone_map(np.ascontiguousarray(small, np.float32), middle)
    to.parent.mkdir(parents=True, exist_ok=True)
    coded = cv2.imencode(".png", np.ascontiguousarray(toned[..., ::-1]))[1]
    sessions.write_atomic(to, coded.tobytes())
    return str(to)


def _developed(path: Path, flip: int | None) -> Any:
    """A RAW file at half size, linear, for the eye."""
    import numpy as np
    import rawpy

    from engine.errors import RawError

    try:
        with rawpy.imread(str(path)) as raw:
            image = raw.postprocess(
                half_size=True,
                gamma=(1, 1),
                no_auto_bright=True,
                output_bps=16,
                use_camera_wb=True,
                user_flip=flip,
            )
    except rawpy.LibRawError as error:
        raise RawError(f"{path}: cannot be developed ({error}); look at it in another program") from error
    return image.astype(np.float32) / 65535
