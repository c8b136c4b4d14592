"""The pieces a page of the report is built from: sections, figures, colour bars, tables."""

from collections.abc import Sequence
from html import escape

from engine.results.report import embedded_images
from engine.results.report.style import CSS


def page(title: str, sections: Sequence[str]) -> str:
    """The whole document; nothing in it points outside."""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>{CSS}</style></head><body><main>"
        + "\n".join(sections)
        + "</main></body></html>\n"
    )


def section(title: str, text: str, figures: Sequence[str] = (), after: str = "") -> str:
    """A titled part of the page: text, a grid of figures, and what follows."""
    grid = f"<div class=grid>{''.join(figures)}</div>" if figures else ""
    return f"<section><h2>{escape(title)}</h2>{text}{grid}{after}</section>"


def figure(picture: str, caption: str, kind: str = "map") -> str:
    """A picture (a data URI) with its caption (HTML); kind "map" keeps pixels sharp."""
    return f'<figure><img class="{kind}" src="{picture}" alt=""><figcaption>{caption}</figcaption></figure>'


def bar(colours: str, low: str, high: str) -> str:
    """The colour bar of a map, with the values of its ends."""
    return f'<span class=bar>{low}<img src="{embedded_images.bar(colours)}" alt="">{high}</span>'


def missing(what: str, command: str) -> str:
    """Why a section is empty, and the command that fills it."""
    return f'<p class="missing">{escape(what)}: run <code>roomlight {command} SESSION</code>.</p>'


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] | range = ()) -> str:
    """A table; `numbers` are the columns set to the right."""
    head = "".join(
        f"<th{' class=n' if column in numbers else ''}>{escape(name)}</th>"
        for column, name in enumerate(heads)
    )
    body = "".join(
        "<tr>"
        + "".join(
            f"<td{' class=n' if column in numbers else ''}>{escape(str(cell))}</td>"
            for column, cell in enumerate(row)
        )
        + "</tr>"
        for row in rows
    )
    return f"<div class=scroll><table><tr>{head}</tr>{body}</table></div>"


def duration(seconds: float) -> str:
    """Seconds as a person says them."""
    if seconds < 60:
        return f"{seconds:.1f}\u00a0s"
    return f"{int(seconds // 60)}\u00a0min {int(seconds % 60):02d}\u00a0s"


def brief(value: object) -> str:
    """A value on one line, cut where it is long."""
    if isinstance(value, float):
        return f"{value:.4g}"
    text = str(value)
    return text if len(text) <= 300 else text[:297] + "..."
