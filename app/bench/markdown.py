"""Tables as Markdown, wide enough to be read as they are."""

from collections.abc import Sequence


def shown(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def markdown(lines: Sequence[Sequence[str]]) -> str:
    """A table whose first line is the heading; the first column leans left, the others right."""
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    told = [
        "| "
        + " | ".join(
            c.ljust(w) if k == 0 else c.rjust(w) for k, (c, w) in enumerate(zip(line, widths, strict=True))
        )
        + " |"
        for line in lines
    ]
    rule = "|" + "|".join("-" * (w + 1) + ("-" if k == 0 else ":") for k, w in enumerate(widths)) + "|"
    return "\n".join([told[0], rule, *told[1:]])
