"""Words in modules without Qt: marked for translators, who get them where the window shows them; put as sentences."""


def QT_TRANSLATE_NOOP(context: str, text: str) -> str:
    """`text` itself; lupdate finds the call by its name and files the text under `context`."""
    return text


def sentence(text: str) -> str:
    """With a capital letter first: the house's errors say "cause; remedy" without."""
    return text[:1].upper() + text[1:]
