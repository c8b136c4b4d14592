"""What an error says for the command line reads in the window as what a person can do there."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.words import in_window
from tests.app.calls import ROOT

OF_THE_COMMAND_LINE = re.compile(r"(?<![\w-])--[a-z]|`roomlight")
ASKED_THERE_ALONE = ("engine/pipeline/settings.py", "engine/io/bundle.py")  # what the command line alone does


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("/a: not a session (no session.json); make one with `roomlight import`",
         "/a: not a session (no session.json); make one with File > Import photographs…"),
        ("take more views, or import with --poses", "take more views, or import it with poses"),
        ("Give it with `--set poses.focal_px=…`, or add views.",
         "Give it with the parameter poses.focal_px on the Process page, or add views."),
        ("stage light will run; run `roomlight process /a b` first", "stage light will run; process the session first (Process page)"),
        ("too little memory; close what else uses it, or use --device cpu",
         "too little memory; close what else uses it, or choose the device cpu on the Process page"),
        ("nothing of it: A--B stays", "nothing of it: A--B stays"),
    ],
)  # fmt: skip
def test_words_of_the_command_line_become_those_of_the_window(said: str, shown: str) -> None:
    assert in_window(said) == shown


def messages() -> Iterator[tuple[str, str]]:
    """(file, text) of what is raised or kept to be told, X where a value stands."""
    for folder in ("engine", "hardware"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            tree = ast.parse(path.read_text())
            # Docstrings are for readers of the code; pieces of a message are told with it.
            inside = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
            inside |= {
                id(v) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for v in node.values
            }
            for node in ast.walk(tree):
                if isinstance(node, ast.JoinedStr):
                    yield (
                        name,
                        "".join(str(v.value) if isinstance(v, ast.Constant) else "X" for v in node.values),
                    )
                elif (
                    isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside
                ):
                    yield name, node.value


def test_no_message_of_the_engine_or_the_rigs_sends_a_person_from_the_window_to_the_command_line() -> None:
    left = {
        (name, text)
        for name, text in messages()
        if name not in ASKED_THERE_ALONE and OF_THE_COMMAND_LINE.search(in_window(text))
    }
    shown = {
        (name, text) for name, text in left if Path(name).parts[:2] != ("engine", "results")
    }  # the report is a page
    assert not shown, shown
