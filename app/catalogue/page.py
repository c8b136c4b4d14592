"""The catalogue as one page that needs no server: its rows stand in it as JSON, its pictures beside it.

The page draws as many cards as have been scrolled to; `?search=lion&sort=-processed` sets its form. Names, folders and reasons
reach it as text, never as markup.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from html import escape

from app.catalogue.rows import PICTURES, Row
from engine.results.report.style import CSS

SORTS = {
    "name": "name", "-processed": "latest result first", "-photographed": "latest photographs first",
    "stderr_normal_deg": "smallest error first", "-stderr_normal_deg": "largest error first",
    "-megabytes": "largest first", "standing": "standing",
}  # fmt: skip
"""A row's field, with a minus from high to low, and what the page calls that."""

STYLE = """
main { max-width:1500px; }
form { display:flex; flex-wrap:wrap; gap:.6rem 1rem; align-items:end; margin:1.2rem 0; position:sticky; top:0;
  background:var(--page); padding:.6rem 0; z-index:1; border-bottom:1px solid var(--line); }
label { font-size:.82rem; color:var(--soft); display:grid; gap:.2rem; }
input,select { font:inherit; color:var(--ink); background:var(--card); border:1px solid var(--line); border-radius:6px;
  padding:.35rem .5rem; min-width:9rem; }
:focus-visible { outline:2px solid var(--accent); outline-offset:2px; }
#cards { display:grid; gap:1.1rem; grid-template-columns:repeat(auto-fill,minmax(330px,1fr)); }
article { background:var(--card); border:1px solid var(--line); border-radius:10px; padding:.8rem .9rem; min-width:0;
  content-visibility:auto; contain-intrinsic-size:330px 330px; }
article h2 { font-size:1.02rem; margin:.6rem 0 .1rem; padding:0; border:0; overflow-wrap:anywhere; }
article p { margin:.15rem 0; font-size:.85rem; line-height:1.4; overflow-wrap:anywhere; }
article .pictures { display:grid; grid-template-columns:repeat(3,1fr); gap:.3rem; }
article .pictures a { aspect-ratio:1; background:#808080; border-radius:6px; overflow:hidden; display:block; }
article img { width:100%; height:100%; object-fit:contain; display:block; }
.soft { color:var(--soft); }
.chip { display:inline-block; border:1px solid var(--line); border-radius:99px; padding:0 .55em; margin-right:.4em;
  font-size:.8rem; }
.chip.warn { color:var(--warn); background:var(--warn-page); border-color:transparent; }
"""

SCRIPT = """
const rows = JSON.parse(document.getElementById("rows").textContent);
const form = document.querySelector("form"), cards = document.getElementById("cards");
const count = document.getElementById("count"), end = document.getElementById("end");
const STEP = 60;
const texts = rows.map(row => [row.name, row.folder, row.camera, row.version, row.stale, row.reason].join(" ").toLowerCase());
let shown = [], drawn = 0;

function element(kind, text, name) {
  const made = document.createElement(kind);
  if (text) made.textContent = text;
  if (name) made.className = name;
  return made;
}
function card(row) {
  const made = element("article"), pictures = element("div", "", "pictures");
  for (const kind of row.pictures) {
    const link = element("a"), image = element("img");
    link.href = `images/${row.key}/${row.export_fingerprint}/${kind}-1000.jpg`;
    image.src = `images/${row.key}/${row.export_fingerprint}/${kind}-150.jpg`;
    image.srcset = `${image.src} 150w, images/${row.key}/${row.export_fingerprint}/${kind}-400.jpg 400w`;
    image.sizes = "110px";
    image.alt = `${row.name}: ${kind}`;
    image.loading = "lazy";
    image.decoding = "async";
    link.append(image);
    pictures.append(link);
  }
  made.append(pictures, element("h2", row.name));
  const chips = element("p");
  chips.append(element("span", row.standing, row.standing === "done" ? "chip" : "chip warn"));
  if (row.verdict) chips.append(element("span", row.verdict, row.verdict === "good" ? "chip" : "chip warn"));
  made.append(chips);
  if (row.verdict && row.verdict !== "good") made.append(element("p", row.reason));
  if (row.stale) made.append(element("p", `Stale: ${row.stale}`));
  const facts = [`${row.views} views of ${row.width} x ${row.height}, ${row.megabytes} MB`, row.camera,
    row.photographed && `photographed ${row.photographed}`, row.processed && `processed ${row.processed}`,
    row.version && `Roomlight ${row.version}`,
    row.stderr_normal_deg !== null && `stated error of the normals ${row.stderr_normal_deg.toPrecision(2)} deg`,
    row.held_out_error !== null && `validation views ${(100 * row.held_out_error).toPrecision(2)} % off`];
  made.append(element("p", facts.filter(Boolean).join(" · "), "soft"));
  const place = element("p", "", "soft");
  if (row.report_link) {
    const link = element("a", "report");
    link.href = row.report_link;
    place.append(link, " · ");
  }
  place.append(row.folder);
  made.append(place);
  return made;
}
function more() {
  const next = shown.slice(drawn, drawn + STEP);
  drawn += next.length;
  cards.append(...next.map(i => card(rows[i])));
  end.hidden = drawn >= shown.length;
}
function compare(field, sign) {
  return (a, b) => {
    const x = rows[a][field], y = rows[b][field], xNone = x === null || x === "", yNone = y === null || y === "";
    if (xNone || yNone) return xNone - yNone || a - b;
    return sign * (typeof x === "number" ? x - y : x.localeCompare(y, undefined, {numeric: true})) || a - b;
  };
}
function update() {
  const words = form.search.value.toLowerCase().split(/\\s+/).filter(Boolean);
  const standing = form.standing.value, verdict = form.verdict.value, sort = form.sort.value;
  shown = rows.map((_, i) => i).filter(i => words.every(word => texts[i].includes(word))
    && (!standing || rows[i].standing === standing) && (!verdict || (rows[i].verdict || "none") === verdict));
  shown.sort(compare(sort.replace("-", ""), sort[0] === "-" ? -1 : 1));
  count.textContent = `${shown.length} of ${rows.length} sessions`;
  cards.replaceChildren();
  drawn = 0;
  more();
}
// index.html?search=lion&sort=-processed shows that.
for (const [name, value] of new URLSearchParams(location.search)) if (form[name]) form[name].value = value;
form.addEventListener("input", update);
form.addEventListener("submit", event => event.preventDefault());
new IntersectionObserver(seen => seen[0].isIntersecting && more(), {rootMargin: "1500px"}).observe(end);
update();
"""


def html(rows: Sequence[Row], report_links: Sequence[str | None], title: str, when: str) -> str:
    """The page; `report_links` lead from it to each session's report."""
    content = [
        asdict(row) | {"report_link": link, "pictures": list(PICTURES) if row.export else []}
        for row, link in zip(rows, report_links, strict=True)
    ]
    # What could end the script or start markup stands as an escape, which JSON knows.
    data = json.dumps(content, ensure_ascii=True, allow_nan=False).replace("<", "\\u003c")
    standings, verdicts = (
        sorted({getattr(row, name) or "none" for row in rows}) for name in ("standing", "verdict")
    )
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>{CSS}{STYLE}</style></head><body><main><h1>{escape(title)}</h1>"
        f'<p class="lead"><span id="count" role="status">{len(rows)} sessions</span> · {escape(when)} · '
        '<a href="catalogue.csv">CSV</a> · <a href="catalogue.json">JSON</a></p>'
        '<form><label>Search<input name="search" type="search" autofocus></label>'
        + _choice("standing", "Standing", {"": "any", **{name: name for name in standings}})
        + _choice("verdict", "Verdict", {"": "any", **{name: name for name in verdicts}})
        + _choice("sort", "Sort", SORTS)
        + '</form><noscript><p class="missing">This page needs JavaScript; the same is in catalogue.csv.</p></noscript>'
        f'<div id="cards"></div><div id="end" style="height:1px"></div></main>'
        f'<script type="application/json" id="rows">{data}</script><script>{SCRIPT}</script></body></html>\n'
    )


def _choice(name: str, title: str, options: dict[str, str]) -> str:
    listed = "".join(
        f'<option value="{escape(value)}">{escape(text)}</option>' for value, text in options.items()
    )
    return f'<label>{title}<select name="{name}">{listed}</select></label>'
