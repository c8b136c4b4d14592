"""Words in modules without Qt: marked for translators, who get them where the window shows them; put as sentences."""

import re


def QT_TRANSLATE_NOOP(context: str, text: str) -> str:
    """`text` itself; lupdate finds the call by its name and files the text under `context`."""
    return text


IN_WINDOW = (
    (r"`roomlight import`", "File > Import photographs…"),
    (r"see `roomlight rig list`", "choose one of the list on the Capture page"),
    (r"`roomlight rig list` lists the ports", "the Capture page lists the ports"),
    (r"`roomlight capture --resume [^`]*`", "the Capture page"),
    (r"run `roomlight process [^`]*` first", "process the session first (Process page)"),
    (r"`roomlight process[^`]*`", "the Process page"),
    (r"use --device cpu", "choose the device cpu on the Process page"),
    (r"--device cuda", "Device cuda"),
    (r"\(--mask\)", "(Mask page)"),
    (r"\(--without [^)]*\)", "(Photographs page)"),
    (r"import with --poses", "import it with poses"),
    (r"with --bracket N", "under Exposures a view"),
    (r"with --at-zero", "and say so on the Capture page"),
    (r"--place", "Place"),
    (r"--material", "Material"),
    (r"--turn", "Turn"),
    (r"--object-size", "Size"),
    (r"--motion", "Motion"),
    (r"--noise", "Noise left"),
    (r"`?--set ([\w.]+)=[^\s`]*`?", r"the parameter \1 on the Process page"),
)
"""What an error says for the command line, and what the window says instead."""


def in_window(text: str) -> str:
    """An error's words without those of the command line."""
    for pattern, instead in IN_WINDOW:
        text = re.sub(pattern, instead, text)
    return text


def sentence(text: str) -> str:
    """With a capital letter first: the house's errors say "cause; remedy" without."""
    return text[:1].upper() + text[1:]
