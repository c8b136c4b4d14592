"""Plans as the child that answers questions gives them, made here by hand."""

from collections.abc import Mapping
from typing import Any

STAGES = ("hdr", "segment", "poses", "light", "surface", "export")
PARAMETERS: Mapping[str, tuple[tuple[str, str, Any], ...]] = {
    "hdr": (("hdr.long_edge_px", "int", 2048), ("hdr.dark_sigmas", "float", 2.0)),
    "poses": (("poses.board", "str", ""), ("poses.mapping.match_ratio", "float", 0.8)),
    "light": (("light.epochs", "list", [6, 8, 6]), ("light.camera_clearance", "float?", None)),
    "surface": (("surface.directions", "int", 2048), ("surface.full_phase", "bool", True)),
    "export": (("export.normal_png", "str", "opengl"),),
}


def content(settings: Mapping[str, Any] | None = None, done: int = 0, folder: str = "/s") -> dict[str, Any]:
    """The answer to "plan" with the first `done` stages done and parameters as `settings` say."""
    asked = {"preset": "standard", "seed": 0, **(settings or {})}
    stages = []
    for number, name in enumerate(STAGES):
        parameters = []
        for dotted, kind, default in PARAMETERS.get(name, ()):
            table: Any = asked
            for part in dotted.split("."):
                table = table.get(part, {}) if isinstance(table, Mapping) else {}
            value = default if table == {} else None if table == "auto" else table
            parameters.append({"name": dotted, "kind": kind, "value": value, "default": default})
        changed = [p["name"] for p in parameters if p["value"] != p["default"]]
        stages.append(
            {
                "name": name,
                "done": number < done and not changed,
                "given": False,
                "reasons": changed or ([] if number < done else ["never ran"]),
                "folder": f"{folder}/stages/{name}/0",
                "took_s": 10.0 if number < done else None,
                "parameters": parameters,
            }
        )
    return {"settings": asked, "stages": stages}


FOLDER = {
    "kind": "raw", "files": 24, "views": 8, "exposures": 3, "camera": "Canon EOS R5", "width": 8192, "height": 5464,
    "notes": [], "shown": ["/p/a.cr3", "/p/b.cr3"],
}  # fmt: skip


class Questions:
    """Stands in for Enquiries: keeps what was asked, answers when told to."""

    def __init__(self, done: int = 0, at_once: bool = True, gpu: str = "") -> None:
        self.gpu = gpu
        self.folder: dict[str, Any] = FOLDER
        self.asked: list[dict[str, Any]] = []
        self.open: list[tuple[dict[str, Any], Any]] = []
        self.done, self.at_once = done, at_once
        self.made: dict[str, Any] = {"picture": None, "facts": {}}
        self.closed = False

    def ask(self, question: str, then: Any, **facts: Any) -> int:
        self.asked.append({"question": question, **facts})
        self.open.append((self.asked[-1], then))
        if self.at_once:
            self.answer()
        return len(self.asked)

    def answer(self, place: int = 0) -> None:
        """Answer one of the open questions as the engine would."""
        from app.work.enquiries import Answer

        asked, then = self.open.pop(place)
        if asked["question"] == "plan":
            then(Answer(content(asked.get("settings"), self.done, asked["session"])))
        elif asked["question"] == "folder":
            then(Answer(self.folder))
        elif asked["question"] == "made":
            then(Answer(self.made))
        elif asked["question"] == "gpu":
            then(Answer({"name": self.gpu}))
        else:
            then(Answer({"picture": None}))

    def fail(self, told: str) -> None:
        from app.state import trouble
        from app.work.enquiries import Answer

        self.open.pop(0)[1](Answer(None, trouble(told)))

    def close(self) -> None:
        self.closed = True
