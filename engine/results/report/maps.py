"""The sections of the report about the object: its maps, how sure they are, and how they re-render."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from jaxtyping import Bool, Float

from engine.color import relative_error
from engine.geometry import angle_between
from engine.io.ground_truth import Truth
from engine.results.report import embedded_images, html_page
from engine.types import Surface, ValidationRenders

FLAGS = (
    (1, "grazing"), (2, "shadowed in most views"), (4, "saturated"), (8, "ill-conditioned"),
    (16, "lit by what no photograph shows"),
)  # fmt: skip


def maps(photograph: Float[np.ndarray, "h w 3"] | None, surface: Surface | None, unit: str) -> str:
    """The photograph beside normals, albedo, roughness and depth."""
    figures = []
    if photograph is not None:
        cut = embedded_images.crop(surface.mask) if surface is not None else (slice(None), slice(None))
        lit = photograph[surface.mask] if surface is not None and surface.mask.any() else photograph
        picture = embedded_images.photograph(photograph[cut], embedded_images.white(lit))
        figures.append(html_page.figure(picture, "<b>Photograph</b> of one view, exposed for the object", ""))
    s = surface
    if s is None:
        return html_page.section(
            "Maps", html_page.missing("The surface is not solved yet", "process"), figures
        )
    cut, mask = embedded_images.crop(s.mask), s.mask
    near, far = np.percentile(s.depth[mask], [1, 99]) if mask.any() else (0.0, 1.0)
    m = mask[cut]
    figures += [
        html_page.figure(
            embedded_images.normals(s.normal[cut], m),
            "<b>Normals</b>: red right, green up, blue towards the viewer",
        ),
        html_page.figure(
            embedded_images.albedo(s.albedo[cut], m), "<b>Albedo</b>, 0 to 1, shown sRGB-encoded"
        ),
        html_page.figure(
            embedded_images.scalar(s.roughness[cut], m, 0.0, 1.0, "viridis"),
            "<b>Roughness</b>, no unit (GGX, alpha = roughness²)" + html_page.bar("viridis", "0", "1"),
        ),
        *_materials(s, cut),
        html_page.figure(
            embedded_images.scalar(s.depth[cut], m, near, far, "cividis"),
            f"<b>Depth</b> along the viewing axis, {escape(unit)}"
            + html_page.bar("cividis", f"{near:.4g}", f"{far:.4g}"),
        ),
    ]
    return html_page.section("Maps", "<p>Camera frame, cropped to the object.</p>", figures)


def _materials(s: Surface, cut: tuple[slice, slice]) -> list[str]:
    """Nothing where all is of paint."""
    if s.material is None:
        return []
    level, metalness = np.moveaxis(s.material[cut], -1, 0)
    m = s.mask[cut]
    return [
        html_page.figure(
            embedded_images.scalar(metalness, m, 0.0, 1.0, "viridis"),
            f"<b>Metalness</b>: {100 * float(metalness[m].mean()):.0f} % of the pixels are metal, whose highlights have"
            " the albedo's colour" + html_page.bar("viridis", "0", "1"),
        ),
        html_page.figure(
            embedded_images.scalar(level, m & (metalness < 1), 0.0, 1.0, "viridis"),
            "<b>Specular level</b> of what is no metal: 0.08 times this is reflected head on"
            + html_page.bar("viridis", "0", "1"),
        ),
    ]


def confidence(surface: Surface | None) -> str:
    """Standard errors, misfit and flags of every pixel."""
    s = surface
    if s is None or not s.mask.any():
        return html_page.section(
            "How sure", html_page.missing("Standard errors come with the surface", "process")
        )
    cut, inside = embedded_images.crop(s.mask), s.mask
    figures = []
    for values, name, unit, colours, factor in (
        (s.stderr_normal, "Standard error of the normal", "degrees", "magma", 180 / np.pi),
        (s.stderr_albedo, "Standard error of the albedo", "albedo, 0 to 1", "magma", 1.0),
        (s.stderr_roughness, "Standard error of the roughness", "roughness, 0 to 1", "magma", 1.0),
        (s.residual, "Misfit left over", "share of the radiance", "viridis", 1.0),
    ):
        shown = values * factor
        half, most = np.percentile(shown[inside], [50, 95])
        top = float(np.percentile(shown[inside], 98)) or 1.0
        figures.append(
            html_page.figure(
                embedded_images.scalar(shown[cut], s.mask[cut], 0.0, top, colours),
                f"<b>{name}</b>, {unit}. Median {half:.3g}, 95 % below {most:.3g}"
                + html_page.bar(colours, "0", f"{top:.3g}"),
            )
        )
    total = int(inside.sum())
    rows = [
        (name, f"{100 * int(((s.flags & bit) > 0)[inside].sum()) / total:.1f} % of the pixels")
        for bit, name in FLAGS
    ]
    flagged = (s.flags[cut] > 0) & s.mask[cut]
    figures.append(
        html_page.figure(
            embedded_images.scalar(np.where(flagged, 1.0, 0.15), s.mask[cut], 0.0, 1.0, "YlOrBr"),
            "<b>Flagged pixels</b> (dark): to be taken with care. Shares in the table",
        )
    )
    text = "<p>One standard error per pixel, from leaving out groups of views (jackknife), and no less than noise and"
    text += " residuals imply. Errors common to all views, such as the light's level or the distance, are not included.</p>"
    return html_page.section("How sure", text, figures, html_page.table(("flag", "share"), rows))


def renders(
    surface: Surface | None,
    made: ValidationRenders | None,
    held_out: Float[np.ndarray, "k h w 3"] | None,
    names: Sequence[str],
) -> str:
    """Views kept out of the fit: photographed, re-rendered, and how far apart."""
    if made is None or held_out is None or surface is None or len(made.views) == 0:
        why = "The surface is not solved yet" if surface is None else "No view was kept for validation"
        return html_page.section("Re-rendered views", html_page.missing(why, "process"))
    mask = surface.mask
    cut = embedded_images.crop(mask)
    rows = []
    for k, view in enumerate(made.views):
        photographed, rendered = held_out[k][cut], made.radiance[k][cut]
        error = relative_error(photographed, rendered, mask[cut])
        white = embedded_images.white(photographed[mask[cut]])
        inside = error[mask[cut]]
        name = escape(names[view])
        figures = [
            html_page.figure(
                embedded_images.render(photographed, mask[cut], white), f"{name}, <b>photographed</b>"
            ),
            html_page.figure(
                embedded_images.render(rendered, mask[cut], white), "<b>re-rendered</b>, same exposure"
            ),
            html_page.figure(
                embedded_images.scalar(error, mask[cut], -0.3, 0.3, "RdBu_r"),
                f"<b>difference</b>, median size {100 * float(np.median(np.abs(inside))):.1f} %"
                + html_page.bar("RdBu_r", "-30 %", "+30 %"),
            ),
        ]
        rows.append(f"<div class=triple>{''.join(figures)}</div>")
    text = "<p>These validation views took no part in the fit. The difference is that of luminance, relative to the"
    text += " photograph; red is where the re-rendering is too bright.</p>"
    return html_page.section("Re-rendered views", text + "".join(rows))


def against(surface: Surface | None, truth: Truth | None, scores: Mapping[str, object] | None) -> str:
    """Scores against a ground truth and maps of the errors; nothing where no truth was given."""
    figures = []
    if surface is not None and truth is not None and truth.mask.shape == surface.mask.shape:
        both = surface.mask & truth.mask
        cut = embedded_images.crop(both)
        shown = both[cut]
        figures = [
            html_page.figure(embedded_images.normals(truth.normal[cut], shown), "<b>True normals</b>"),
            _error(
                np.degrees(angle_between(surface.normal, truth.normal)),
                both,
                "Error of the normal",
                "degrees",
            ),
            html_page.figure(embedded_images.albedo(truth.albedo[cut], shown), "<b>True albedo</b>"),
            _error(np.abs(surface.albedo - truth.albedo).mean(-1), both, "Error of the albedo", "0 to 1"),
            _error(np.abs(surface.roughness - truth.roughness), both, "Error of the roughness", "0 to 1"),
        ]
    if not figures and not scores:
        return ""
    table = ""
    if scores:
        rows = [(name.replace("_", " "), html_page.brief(value)) for name, value in scores.items()]
        table = f"<details><summary>all scores</summary>{html_page.table(('score', 'value'), rows, (1,))}</details>"
    text = "<p>Where both the result and the truth hold a pixel.</p>" if figures else ""
    return html_page.section("Against the truth", text, figures, table)


def _error(values: Float[np.ndarray, "h w"], both: Bool[np.ndarray, "h w"], name: str, unit: str) -> str:
    """A map of absolute errors with its mean; the scale ends at the 95th percentile."""
    cut = embedded_images.crop(both)
    inside = values[both] if both.any() else np.zeros(1)
    top = float(np.percentile(inside, 95)) or 1.0
    caption = f"<b>{name}</b>, {unit}. Mean {inside.mean():.3g}, median {np.median(inside):.3g}"
    picture = embedded_images.scalar(values[cut], both[cut], 0.0, top, "inferno")
    return html_page.figure(picture, caption + html_page.bar("inferno", "0", f"{top:.3g}"))
