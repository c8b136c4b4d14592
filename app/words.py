"""Marks text for translators in modules without Qt; the window translates it where it shows it."""


def QT_TRANSLATE_NOOP(context: str, text: str) -> str:
    """`text` itself; lupdate finds the call by its name and files the text under `context`."""
    return text
