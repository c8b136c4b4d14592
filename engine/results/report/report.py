"""One page about one result: every map with its error, the light, the path, and what to be careful about.

`html` is pure: records in, one self-contained page out (pictures inside, no network, no script). What has
not been computed yet is said in its place. Units stand in every caption.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from jaxtyping import Float

from engine.geometry import rays
from engine.hdr.merge import HdrReport
from engine.io.ground_truth import Truth
from engine.results.quality import is_needed, quality
from engine.results.report import distance, embedded_images, html_page, maps, path_drawing
from engine.types import Gaussians, LightProvenance, Panorama, Poses, Surface, ValidationRenders


@dataclass(frozen=True, slots=True)
class StageRun:
    """One finished stage: how long, with what, and the numbers it reported."""

    name: str
    seconds: float
    device: str
    params: Mapping[str, object]
    facts: Mapping[str, object]


@dataclass(frozen=True, slots=True, eq=False)
class Contents:
    """What a report is made of; None or empty where it does not exist yet."""

    title: str
    when: str  # date of the report, as text
    names: tuple[str, ...]  # of all views
    photograph: Float[np.ndarray, "h w 3"] | None = None  # radiance of one view
    surface: Surface | None = None
    renders: ValidationRenders | None = None
    held_out: Float[np.ndarray, "k h w 3"] | None = None  # photographs of the re-rendered views
    panorama: Panorama | None = None
    grounds: LightProvenance | None = None  # of the panorama's light
    poses: Poses | None = None
    gaussians: Gaussians | None = None
    hdr: HdrReport | None = None
    stages: tuple[StageRun, ...] = ()
    evaluation: Mapping[str, object] | None = None  # scores against a truth, by name
    truth: Truth | None = None  # to draw the errors
    exported: tuple[str, ...] = ()  # files
    left_out: frozenset[str] = frozenset()  # views that a person left out
    per_unit: float = (
        1.0  # of the lengths in the stages' own reports; those of the records here are in the poses' unit
    )
    notes: tuple[str, ...] = ()  # what a person should know beyond what is found here
    software: Mapping[str, str] | None = None


def html(contents: Contents) -> str:
    """The page."""
    sections = [
        _head(contents),
        _verdict(contents),
        maps.maps(contents.photograph, contents.surface, _unit(contents.poses)),
        maps.confidence(contents.surface),
        _care(contents),
        maps.renders(contents.surface, contents.renders, contents.held_out, contents.names),
        maps.against(contents.surface, contents.truth, contents.evaluation),
        _light(contents),
        _path(contents),
        _exposures(contents),
        _iterations(contents),
        _model_parts(contents),
        _times(contents),
        _exports(contents),
        _parameters(contents),
    ]
    return html_page.page(f"{contents.title} · Roomlight", sections)


def _head(c: Contents) -> str:
    numbers = [(f"{len(c.names)}", "photographs (views)")]
    if c.poses is not None:
        used = len(c.names) - len(c.left_out)
        numbers.append((f"{int(c.poses.registered.sum())} / {used}", "views with a pose"))
    if c.surface is not None and c.surface.mask.any():
        stderr = np.degrees(c.surface.stderr_normal[c.surface.mask])
        numbers.append((f"{int(c.surface.mask.sum()):,}".replace(",", "\u202f"), "surface pixels"))
        numbers.append((f"± {np.median(stderr):.2g}°", "standard error of the normal, median (estimated)"))
    scaled = c.poses is not None and c.poses.scale != "unknown"
    numbers += distance.told(_facts(c, "surface").get("distance"), _unit(c.poses), scaled, c.per_unit)
    if c.panorama is not None:
        numbers.append(
            (
                f"{100 * embedded_images.seen_share(c.panorama):.0f} %",
                "of the light's sphere was photographed",
            )
        )
    if c.stages:
        numbers.append((html_page.duration(sum(run.seconds for run in c.stages)), "for all stages"))
    cells = "".join(
        f"<div><b>{escape(value)}</b><span>{escape(what)}</span></div>" for value, what in numbers
    )
    return (
        f"<h1>{escape(c.title)}</h1><p class=lead>Shape and reflectance from the light of the room ·"
        f" {escape(c.when)}</p><div class=numbers>{cells}</div>"
    )


def _verdict(c: Contents) -> str:
    """Whether the result can be trusted, before anything that it shows."""
    found = quality({run.name: run.facts for run in c.stages})
    if found is None:
        return ""
    kind = "verdict" if found.good else "verdict doubted"
    text = escape(f"{found.reason[:1].upper()}{found.reason[1:]} {found.remedy}")
    return f'<p class="{kind}"><b>Quality: {escape(found.grade)}</b><br>{text}</p>'


def _light(c: Contents) -> str:
    if c.panorama is None:
        return html_page.section(
            "The light", html_page.missing("The light is not reconstructed yet", "process")
        )
    share = 100 * embedded_images.seen_share(c.panorama)
    caption = (
        f"<b>What arrives at the object</b> in view {escape(c.panorama.view)}, compressed so that"
        " lamps and walls both show. Left to right: from behind the camera over its left, ahead (middle) and"
        " right; top is up in the photograph."
        f" {share:.0f} % of the sphere was photographed; what is hatched is a guess."
    )
    return html_page.section(
        "The light", "", (), html_page.figure(embedded_images.panorama(c.panorama), caption, "")
    )


def _path(c: Contents) -> str:
    if c.poses is None:
        return html_page.section("The path", html_page.missing("The poses are not known yet", "process"))
    plan = path_drawing.survey(c.poses, c.gaussians, _object_middle(c))
    if plan is None:
        return html_page.section("The path", '<p class="missing">No view has a pose.</p>')
    unit = _unit(c.poses)
    keys = (
        ("accent", "camera and where it looks"),
        ("object", "object"),
        ("lamp", _lamps(plan)),
    )
    key = "".join(
        f'<span class=key style="background:var(--{colour})"></span>{what}' for colour, what in keys if what
    )
    figures = "".join(
        f"<figure>{path_drawing.draw(plan, above, unit)}<figcaption><b>{title}</b></figcaption></figure>"
        for above, title in ((True, "From above"), (False, "From the side"))
    )
    return html_page.section("The path", f"<p class=note>{key}<br>Scale bar in {escape(unit)}.</p>") + (
        f"<div class=pair>{figures}</div>"
    )


def _lamps(plan: path_drawing.Plan) -> str:
    """What the drawing's lamps are; nothing where there is no light yet."""
    if not len(plan.lamps):
        return f"the {plan.lamps_beyond} strongest Gaussians lie beyond" if plan.lamps_beyond else ""
    share = f"{100 * plan.lamp_shares.sum():.0f} % of the light's emission"
    beyond = f"; {plan.lamps_beyond} more lie beyond" if plan.lamps_beyond else ""
    return f"the {len(plan.lamps)} strongest Gaussians, {share}{beyond}"


PLAIN = 4.0
"""How much an outline stands out, in logs, from which on it needs no second look: knots of tubes a few pixels wide have 3, rooms
without any object 1."""
DRIFTED = 0.05
"""A view's factor from which on it is told: in rooms whose light is right the largest of 48 is .02 or .03."""
DARK = 0.0005  # share of the pixels below noise from which on they are told
MOST_PARTS = 4  # of the depth that are told with their shares
UNKNOWN_PX = 20.0  # standard error, in widths of a pixel, from which on nobody knows where a part stands
UNSEEN = 0.05
"""Share of the light from where no photograph looked, from which on the normals' errors are more than they say: 0.56 of it
left 5 degrees where 2.3 were stated."""


def cautions(c: Contents) -> tuple[str, ...]:
    """Whatever was clipped, unregistered, guessed or flagged, in sentences."""
    lines = list(c.notes)
    if c.left_out:
        them = [name for name in c.names if name in c.left_out]
        lines.append(f"{len(them)} of {len(c.names)} photographs are left out by hand: {_some(them)}.")
    if c.hdr is not None:
        if c.hdr.share_clipped > 0:
            lines.append(
                f"{100 * c.hdr.share_clipped:.2g} % of all pixels are clipped in every exposure (most in"
                f" {c.hdr.most_clipped}: {100 * c.hdr.most_clipped_share:.2g} %); their radiance is a"
                " lower bound."
            )
        if c.hdr.share_dark >= DARK:
            lines.append(f"{100 * c.hdr.share_dark:.2g} % of all pixels are below noise in every exposure.")
        if c.hdr.suspect:
            lines.append(f"EXIF contradicts the pixels in {_some(c.hdr.suspect)}; the pixels were believed.")
    outline = _facts(c, "segment").get("stands_out")
    if isinstance(outline, float) and outline < PLAIN:
        lines.append(
            f"The object's outline hardly stands out from the room (contrast {outline:.1f}; {PLAIN:.0f} or more is clear): look at the mask, and"
            " paint what is wrong in it."
        )
    if c.poses is not None:
        pairs = zip(c.names, c.poses.registered, strict=True)
        lost = [name for name, seen in pairs if not seen and name not in c.left_out]
        if lost:
            lines.append(
                f"{len(lost)} of {len(c.names) - len(c.left_out)} views have no pose and were not used: {_some(lost)}."
            )
        found = _facts(c, "poses")
        off, off_deg = found.get("off"), found.get("off_deg")
        if off and isinstance(off, list | tuple) and isinstance(off_deg, float):
            lines.append(
                f"The poses of {len(off)} of {found['judged']} views are not what the photographs show: {_some(off)}. What these"
                f" share with other views lies {off_deg:.2g} degrees from where the poses put it; photographs like these tell"
                f" {found['told_deg']:.1g}. Light and surface may be wrong with them: check that poses and lens are of"
                " these photographs, add views, or import other poses."
            )
        if found.get("lens_doubtful"):
            expected = found["focal_expected_px"]
            where = "other lenses fit as well" if expected is None else f"{expected:.0f} px were expected"
            lines.append(
                f"The focal length was found to be {found['focal_px']:.0f} px where {where}: the lens may be wrong, and with it"
                " all lengths. Give it with `--set poses.focal_px=…`, add views that roll and step aside, or import other poses."
            )
        apart = found.get("rig_position_m")
        if found.get("rig_doubtful") and isinstance(apart, float):
            lines.append(
                f"The rig's log and the photographs put the camera {1000 * apart:.0f} mm apart: the rig's geometry"
                " is not what session.json says, or the lens is wrong, and with it all lengths. Measure the rig's axes again, or"
                " give the focal length with `--set poses.focal_px=…`."
            )
        if c.poses.scale == "unknown":
            lines.append(
                "The length of one scene unit is unknown: depth and light are right up to one factor. The true distance of two points"
                " of the object fixes it: *Set scale* in Maps, or `--scale`."
            )
    if c.panorama is not None and embedded_images.seen_share(c.panorama) < 0.995:
        guessed = 100 * (1 - embedded_images.seen_share(c.panorama))
        lines.append(
            f"No photograph shows {guessed:.0f} % of the light's sphere; what comes from there is a guess."
        )
    if c.grounds is not None and c.grounds.guessed + c.grounds.lower_bound >= 0.0005:
        lines.append(
            f"{100 * c.grounds.guessed:.1f} % of the light on the object is a guess,"
            f" {100 * c.grounds.lower_bound:.1f} % is a lower bound."
        )
    unseen = _facts(c, "surface").get("unseen_light")
    if isinstance(unseen, float) and unseen > UNSEEN:
        lines.append(
            f"{100 * unseen:.0f} % of the light on the object comes from directions that no photograph shows; its brightness was"
            " inferred from the object's shading. The stated errors of the normals are too small here. Turn camera and object"
            " about a second axis as well, or add views that look up and down."
        )
    parts = _facts(c, "surface").get("depth_parts")
    if isinstance(parts, list | tuple) and len(parts) > 1:
        shares = ", ".join(f"{100 * share:.0f} %" for share in parts[:MOST_PARTS])
        more = len(parts) - MOST_PARTS
        shares += f" and {more} smaller" if more > 0 else ""
        errors = _facts(c, "surface").get("part_stderr_px")
        errors = [one for one in errors if one < UNKNOWN_PX] if isinstance(errors, list | tuple) else []
        known = "The offsets between them are not determined."
        if errors:
            known = (
                f"The offsets of {len(errors)} of them are known to {max(errors):.0f} pixel widths or better."
            )
        lines.append(
            f"Jumps divide the depth into {len(parts)} parts ({shares} of the pixels). Within a part it follows from the normals. {known}"
            " `maps.exr` holds the parts and this standard error."
        )
    drift = _facts(c, "surface").get("exposure_drift")
    if isinstance(drift, list | tuple) and drift and max(map(abs, drift)) > np.log1p(DRIFTED):
        lines.append(
            f"In one view the light on the object is {100 * np.expm1(max(map(abs, drift))):.1f} % brighter or darker than the background"
            " says. The surface was solved without this difference. Where most light is sky through windows some percent are usual;"
            " else fix shutter, aperture and ISO, and let lamps and camera warm up."
        )
    unknown = [
        what
        for what, known in (("clipping", c.hdr), ("poses", c.poses), ("unseen light", c.panorama))
        if known is None
    ]
    if unknown:
        lines.append(f"Not known before the stages have run: {', '.join(unknown)}.")
    return tuple(lines)


def _facts(c: Contents, stage: str) -> Mapping[str, object]:
    return next((run.facts for run in c.stages if run.name == stage), {})


def _care(c: Contents) -> str:
    lines = cautions(c)
    if not lines:
        return html_page.section("To be careful about", "<p>Nothing was clipped, lost or guessed.</p>")
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return html_page.section("To be careful about", f"<ul class=care>{items}</ul>")


def _exposures(c: Contents) -> str:
    if c.hdr is None:
        return html_page.section(
            "Exposures", html_page.missing("The exposures are not merged yet", "process")
        )
    if not c.hdr.steps:
        return html_page.section("Exposures", "<p>One exposure a view: there are no ratios to check.</p>")
    rows = [
        (
            f"{k + 1} → {k + 2}", f"{step.exif_ev:+.3f}", f"{step.fitted_ev:+.4f}",
            f"{step.fitted_ev - step.exif_ev:+.4f}", f"{step.spread_ev:.4f}",
            f"{step.worst_ev:.4f}", step.worst_view,
        )
        for k, step in enumerate(c.hdr.steps)
    ]  # fmt: skip
    heads = ("step", "EXIF, EV", "pixels, EV", "residual, EV", "spread, EV", "worst, EV", "in view")
    text = (
        f"<p>{c.hdr.exposures} exposures a view. Ratios fitted from the pixels, against what EXIF says.</p>"
    )
    return html_page.section("Exposures", text, (), html_page.table(heads, rows, numbers=range(1, 6)))


def _iterations(c: Contents) -> str:
    """Which passes of the surface solve ran, and what each iteration gained; of other solvers nothing is known."""
    history = _facts(c, "surface").get("history")
    if not isinstance(history, list):
        return ""

    def told(value: float | None, form: str) -> str:
        return "" if value is None else format(value, form)

    rows = [
        (
            one["phase"], ", ".join(one["passes"]).replace("_", " "), f"{one['pixels']}", told(one["residual"], ".2f"),
            told(one["turned_deg"], ".2f"), told(one["validation_error"], ".2%"), "yes" if one["kept"] else "undone",
        )
        for one in history
    ]  # fmt: skip
    heads = (
        "phase",
        "passes",
        "pixels",
        "residual",
        "normals turned, deg",
        "validation views, error",
        "kept",
    )
    text = (
        "<p>Residual: median spread, in units of the expected noise. Validation views are never fitted. From the second"
        " iteration of a phase on, one that renders them worse, by more than the standard error over the views, is undone.</p>"
    )
    return html_page.section(
        "Iterations of the surface", text, (), html_page.table(heads, rows, numbers=range(2, 6))
    )


def _model_parts(c: Contents) -> str:
    """What the parts of the surface's model are worth to the views kept out; of other solvers nothing is known."""
    facts = _facts(c, "surface")
    worths, probes, error = (facts.get(name) for name in ("part_worths", "probes", "held_out_error"))
    if not (
        isinstance(worths, list) and worths and isinstance(probes, list) and isinstance(error, int | float)
    ):
        return ""
    rows = [
        (
            one["part"], f"{one['gain']:+.2%}", f"{one['stderr']:.2%}",
            "no" if is_needed(one["gain"], one["stderr"], error) else "yes",
        )
        for one in worths
    ]  # fmt: skip
    heads = ("part of the model", "validation views without it, error", "standard error", "may be left out")
    text = (
        f"<p>How much larger the error of the validation views is without each part, all else left as it is: the most that it can be"
        f" worth. A part that is worth no more than its standard error over the views, or a hundredth of their error ({error:.2%}),"
        f" may be left out. The light was taken at {' x '.join(map(str, probes))} probes in {facts.get('directions')} directions.</p>"
    )
    return html_page.section(
        "What this scene asks of the model", text, (), html_page.table(heads, rows, numbers=range(1, 3))
    )


def _times(c: Contents) -> str:
    if not c.stages:
        return html_page.section("Time", html_page.missing("No stage has run", "process"))
    longest = max(run.seconds for run in c.stages) or 1.0
    rows = "".join(
        f"<tr><td>{escape(run.name)}</td><td class=n>{html_page.duration(run.seconds)}</td>"
        f"<td>{escape(run.device)}</td><td style='width:45%'>"
        f'<div class=time style="width:{100 * run.seconds / longest:.1f}%"></div></td></tr>'
        for run in c.stages
    )
    head = "<tr><th>stage</th><th class=n>time</th><th>device</th><th></th></tr>"
    table = f"<table style='width:100%'>{head}{rows}</table>"
    return html_page.section("Time", f"<div class=scroll>{table}</div>")


def _exports(c: Contents) -> str:
    if not c.exported:
        return html_page.section("Files", html_page.missing("The results are not written out yet", "process"))
    items = " · ".join(f"<code>{escape(name)}</code>" for name in c.exported)
    return html_page.section("Files", f"<p>{items}</p>")


def _parameters(c: Contents) -> str:
    parts = []
    for run in c.stages:
        for title, values in (("parameters", run.params), ("reported", run.facts)):
            if values:
                rows = [(name, html_page.brief(value)) for name, value in values.items()]
                table = html_page.table((title, "value"), rows)
                parts.append(f"<details><summary>{escape(run.name)}: {title}</summary>{table}</details>")
    if c.software:
        parts.append(
            "<details><summary>software</summary>"
            + html_page.table(("program", "version"), list(c.software.items()))
            + "</details>"
        )
    if not parts:
        return ""
    return html_page.section("Parameters, reports and versions", "".join(parts))


def _object_middle(c: Contents) -> Float[np.ndarray, " 3"] | None:
    """The object's median point, camera frame."""
    if c.surface is None or c.poses is None:
        return None
    known = c.surface.mask & (c.surface.depth > 0)
    if not known.any():
        return None
    ray = rays(c.poses.camera)[known]
    return np.median(ray / ray[:, 2:] * c.surface.depth[known][:, None], axis=0)


def _unit(poses: Poses | None) -> str:
    if poses is None or poses.scale == "unknown":
        return "scene units"
    return "metres" if poses.metric else "units of the given poses"


def _some(names: Sequence[str], most: int = 12) -> str:
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")
