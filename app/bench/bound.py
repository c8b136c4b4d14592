"""The least error that a set's photographs allow (Cramer and Rao), pixel by pixel; kept beside the set.

Of the best unbiased estimate of a pixel's normal from that pixel's photographs alone, under the studio's own light
(`true_incident`), with true depth, visibility, bounced light and material known and the other unknowns of
`engine.surface.optimize.gauss_newton` not. What scatters is what the set is made with: the sensor's noise, where a camera took it, and the
path tracer's. Neighbours' accord may come below it. Some thousand pixels' bounds differ little from a few hundred's: one
in so many is asked.
"""

import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from app import places, results
from app.bench import sets
from app.bench.choices import Choice
from app.bench.information import Bound, Scatter, derivatives, expected_angle, information
from app.bench.sets import Set
from app.bench.sizes import Size
from app.bench.stored import evenly
from app.bench.true_incident import incident_of
from engine.hdr.merge import HdrReport
from engine.io import session as sessions
from engine.io.ground_truth import Truth
from engine.pipeline import run
from engine.progress import Progress
from engine.surface.optimize.gauss_newton import PixelEstimate, initial_estimate
from engine.surface.params import SurfaceParams
from engine.surface.passes import depth_range
from engine.surface.reflectance.brdf import PAINT
from engine.surface.rendering.object_pixels import ObjectPixels, geometry_with_visibility, observe_object
from engine.surface.rendering.transport import IncidentLight, SurfaceGeometry, pixel_blocks, probe_grid_around
from hardware.errors import StudioError
from hardware.virtual import sensor
from hardware.virtual.studio import shoot
from hardware.virtual.studio import truth as studio_truth
from hardware.virtual.studio.objects import Body

VERSION = 3  # raise when a kept bound would be another
PIXELS = 400  # about so many are asked
PARAMS = SurfaceParams(directions=1024)
PROBES = (2, 2, 2)


def bounded(
    on: Set, room: Choice, thing: Choice, size: Size, seed: int, device: str, count: int | None = None
) -> Set:
    """The set with its bound, of all photographs or `count` of them; without where the studio cannot follow rays here.

    Raises:
        RoomlightError: what the studio has to say, or the disk.
    """
    many = "" if count is None else f"-{count}"
    place = on.session.parent / f"bound{many}.v{VERSION}.npz"
    if not place.is_file():
        try:
            with sets.job(f"{on.name} noise bound") as progress:
                found = of_set(on, room, thing, size, seed, device, count, progress)
        except StudioError as fault:
            print(f"{on.name}: no noise bound: {fault}", file=sys.stderr)
            return on
        _keep(found, place)
    with np.load(place) as kept:
        return replace(on, bound=Bound(kept["chosen"], kept["normal_deg"], kept["blur_deg"]))


def of_set(
    on: Set,
    room: Choice,
    thing: Choice,
    size: Size,
    seed: int,
    device: str,
    count: int | None,
    progress: Progress,
) -> Bound:
    """Work it out.

    Raises:
        StudioError: Mitsuba has no vectorised variant here, or the files of room and object are gone.
    """
    order = sets.order_of(room, thing, size, size.views, seed, device)
    built = shoot.build(order, places.cache() / "studio", progress.part(0, 0.2).step)
    views = np.array(evenly(size.views if count is None else count, size.views))
    known = known_of(on, built, views, PARAMS, PROBES, progress.part(0.2, 0.7))
    mask, true = known.object_pixels.mask, known.true_state()
    sight = geometry_with_visibility(
        known.object_pixels, true, on.truth.depth, known.light.directions, PARAMS, progress.part(0.7, 0.9)
    )
    every = -(-int(mask.sum()) // PIXELS)
    parts = [asked for part in pixel_blocks(mask) if len(asked := part[part % every == 0])]
    angle = np.zeros(int(mask.sum()))
    angle[np.concatenate(parts)] = np.concatenate(
        list(known.least(true, sight, PARAMS, parts, known.scatter))
    )
    chosen = np.zeros_like(mask)
    chosen[mask] = np.arange(len(angle)) % every == 0
    return Bound(chosen, angle[::every], blur(built.body, mask)[chosen])


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """A set's photographs with the light and the truth they were taken of."""

    object_pixels: ObjectPixels
    light: IncidentLight
    truth: Truth
    scatter: Scatter

    def true_state(self) -> PixelEstimate:
        """The truth as the solver's unknowns."""
        mask, truth = self.object_pixels.mask, self.truth
        return initial_estimate(truth.normal[mask], truth.albedo[mask], truth.roughness[mask])

    def least(
        self,
        true: PixelEstimate,
        geometry: SurfaceGeometry,
        params: SurfaceParams,
        blocks: list[Int[np.ndarray, " _"]],
        scatter: Scatter,
    ) -> Iterator[Float[np.ndarray, " _"]]:
        """Degrees that each normal of each part is off at least on average."""
        transport = self.object_pixels.problem(self.light, geometry, params, "cpu").transport
        for pixels in blocks:
            radiance, jacobian = derivatives(transport, geometry, pixels, true)
            usable = self.object_pixels.observations.weight[pixels].reshape(radiance.shape) > 0
            yield np.degrees(expected_angle(information(radiance, jacobian * usable[..., None], scatter)))


def blur(body: Body, mask: Bool[np.ndarray, "h w"], finer: int = 4) -> Float[np.ndarray, "h w"]:
    """Degrees between the true normal at each pixel's centre and the mean of those at `finer` x `finer` places in it; of the
    object alone. A photograph shows such a mean, so no photograph tells the former."""
    height, width = mask.shape
    centre = studio_truth.maps(body, width, height)["normal"]
    places_in = studio_truth.maps(body, width * finer, height * finer)["normal"]
    mean = places_in.reshape(height, finer, width, finer, 3).sum((1, 3))
    cosine = (mean * centre).sum(-1) / np.maximum(np.linalg.norm(mean, axis=-1), 1e-12)
    return np.where(mask, np.degrees(np.arccos(np.clip(cosine, -1, 1))), 0.0)


def known_of(
    on: Set,
    built: shoot.Studio,
    views: Int[np.ndarray, " n"],
    params: SurfaceParams,
    probes: tuple[int, int, int],
    progress: Progress,
) -> Known:
    """The set under the studio's light; `views` of the studio's are those that the set holds.

    Raises:
        StudioError: Mitsuba has no vectorised variant here.
    """
    frames, camera, truth = on.stored.frames, on.stored.poses.camera, on.truth
    mask, raw = truth.mask, sessions.open_session(on.session).kind == "raw"
    report = run.loader(results.steps_of(on.session))("hdr", "report", HdrReport)
    lattice = probe_grid_around(camera, mask, depth_range(truth.depth[mask]), probes)
    light = incident_of(
        built.around, built.cams_from_world()[views], lattice, params.directions,
        session_per_studio(report.scale) if raw else 1.0, 1, progress,
    )  # fmt: skip
    who = observe_object(frames, mask, camera, np.arange(len(frames.names)), params)
    who = replace(who, material=_material(built.body, mask))
    # Images that no camera took hold no noise but the path tracer's; a floor keeps black from being certain.
    noise = frames.noise if raw else (0.0, 1e-6 * float(frames.radiance[:, mask].mean()))
    return Known(who, light, truth, Scatter(*noise, built.order.noise))


def session_per_studio(exposure: float) -> float:
    """The session's radiance of a studio radiance of 1: the share of a green site that it fills.

    `exposure` is that of the session's middle photograph, s * ISO / 100 / f^2, as `HdrReport.scale` has it.
    """
    camera = sensor.Sensor()
    shutter_s = exposure * camera.aperture**2 * 100 / camera.iso
    return camera.electrons_per_radiance_s() * shutter_s / camera.full_electrons


def _material(body: Body, mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "p 2"] | None:
    """As `engine.surface.reflectance.brdf` has it."""
    height, width = mask.shape
    if body.metalness is None:
        return None if body.specular == PAINT[0] else np.tile([body.specular, 0.0], (int(mask.sum()), 1))
    metal = studio_truth.maps(replace(body, roughness=body.metalness), width, height)["roughness"][mask]
    return np.stack([np.full(len(metal), body.specular), metal], 1)


def _keep(found: Bound, place: Path) -> None:
    partial = place.with_name(f".{place.stem}.{os.getpid()}.npz")
    with sessions.told(place):
        np.savez_compressed(
            partial, chosen=found.chosen, normal_deg=found.normal_deg, blur_deg=found.blur_deg
        )
        partial.rename(place)
