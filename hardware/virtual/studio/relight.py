"""Light the body in many views at once: paths across the body are traced once, then carried through the room.

Camera and body are rigid, so what a path does until it leaves the body is the same in every view; only what
it then meets differs. `_follow` takes every pixel's samples over the body, in the camera's frame, until they
leave; `_found` carries the leaving rays into the room of one view, and `_lit` aims from the body at its lamps.

Estimator, for one pixel (multi-sample MIS, Veach and Guibas 1995): at the first vertex cosine-weighted and microfacet
samples share the panels by the balance heuristic; microfacet and aimed samples share the lamps by the power heuristic.
Cosine-weighted samples see no lamps: whether they hit one is all or nothing, where aiming is nearly exact, and sharing
with them tripled the noise. At later vertices one reflectance sample and one aimed sample do. Nothing is clamped.
First-vertex samples are stratified, anew for each pixel, view and lamp (`samples`); later ones are not.
Needs one of Mitsuba's vectorised variants; `render.Foreground` is the plain way.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from jaxtyping import Bool, Float, Int

from hardware.virtual.studio import tracer
from hardware.virtual.studio.glow import Seen
from hardware.virtual.studio.objects import Body
from hardware.virtual.studio.samples import Effort, Numbers
from hardware.virtual.studio.truth import camera

DEPTH = 7  # vertices on the body; light that met it more often is under a thousandth
LANES = 2_000_000  # paths in flight: bounds the memory to about 1 GB

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False)
class _Exits:
    """Rays that left the body, camera frame."""

    lane: Any  # which of the paths in flight each belongs to; None: all of them in order
    ray: Any
    normal: Any  # shading normal where they left
    weight: Any  # radiance found is multiplied by this and summed
    density: Any  # of finding this direction by reflectance, all samples together; inf: seen directly
    finding: Any  # the part of it that may find lamps
    first: Any  # whether it leaves from the first vertex


@dataclass(frozen=True, slots=True, eq=False)
class _Vertices:
    """Points on the body from which lamps are aimed at, camera frame; `eval`uated once, used in every view."""

    lane: Any  # which of the paths in flight each belongs to
    point: Any
    normal: Any  # of the triangle
    shading: Any  # normal
    wi: Any  # local, towards where the path came from
    made: tuple[Any, ...]  # as `LanePaint.of` has it
    weight: Any


class Lights(Protocol):
    """What lights the body; points, normals and rays in the world."""

    mi: Any
    lamps: int  # that may be aimed at
    only_lamps: bool  # whether all there is to be met counts as one of them

    def view(self, world_from_cam: Float[np.ndarray, "4 4"]) -> None:
        """The body stands elsewhere from now on."""
        ...

    def effort(self, count: int) -> Effort:
        """How `count` samples a pixel are shared."""
        ...

    def look(self, ray: Any, normal: Any) -> Seen:
        """What `ray` meets that leaves a surface of this shading normal."""
        ...

    def aim(self, lamp: Any, point: Any, u: Any, normal: Any) -> Any:
        """Something with a `direction`."""
        ...

    def arriving(self, point: Any, normal: Any, aim: Any, active: Any) -> tuple[Any, Any, Any]:
        """Whether light arrives from where was aimed, its radiance, and the density of aiming there."""
        ...

    def choice(self, point: Any) -> list[Any]:
        """Probability of each lamp."""
        ...


class Relighter:
    """Path-traces the pixels that the body touches, for several views that share their samples."""

    def __init__(self, lights: Lights, body: Body, touched: Bool[np.ndarray, "h w"]):
        self.mi = mi = lights.mi
        self.glow = lights
        self.body = mi.load_dict({"type": "scene", "body": tracer.body_mesh(mi, body)})
        self.paint = tracer.LanePaint(mi, body)
        rows, columns = np.nonzero(touched)
        self.rows, self.columns = rows.astype(np.uint32), columns.astype(np.uint32)
        self.size = (touched.shape[1], touched.shape[0])

    def look(
        self, cams_from_world: Float[np.ndarray, "n 3 4"], effort: Effort, seed: int, progress: Progress,
        pixels: Int[np.ndarray, " p"] | None = None,
    ) -> Float[np.ndarray, "n p 3"]:  # fmt: skip
        """Radiance of the touched pixels (or those of them given by index) in each view; all views share one set of samples."""
        chosen = np.arange(len(self.rows)) if pixels is None else pixels
        total = np.zeros((len(cams_from_world), len(chosen), 3), np.float32)
        kinds = [("diffuse", 0, effort.diffuse), ("glossy", 0, effort.glossy)]
        kinds += [("aimed", lamp, count) for lamp, count in enumerate(effort.aimed)]
        kinds = [kind for kind in kinds if kind[2] > 0]
        cost = np.cumsum([0] + [count for *_, count in kinds])
        for job, (kind, lamp, count) in enumerate(kinds):
            step = max(1, LANES // count)
            for begin in range(0, len(chosen), step):
                part = slice(begin, min(begin + step, len(chosen)))
                salt = (seed * 64 + job) % 2**19 * 4096
                batch = _Batch(self, chosen[part], count, salt)
                carry = batch.aiming(lamp, effort) if kind == "aimed" else batch.following(kind, effort)
                for view, cam_from_world in enumerate(cams_from_world):
                    total[view, part] += carry(cam_from_world, view)
                    share = (begin + (part.stop - begin) * (view + 1) / len(cams_from_world)) / len(chosen)
                    progress((cost[job] + share * count) / cost[-1])
        return total

    def noise(
        self, cams_from_world: Float[np.ndarray, "n 3 4"], effort: Effort, seed: int, progress: Progress
    ) -> Float[np.ndarray, " p"]:
        """Standard deviation of each touched pixel, relative to its mean over the views: two pictures tell."""
        first = self.look(cams_from_world, effort, seed, lambda share: progress(0.5 * share)).mean(-1)
        second = self.look(cams_from_world, effort, seed + 1, lambda share: progress(0.5 + 0.5 * share)).mean(
            -1
        )
        level = np.maximum((first + second).mean(0) / 2, 1e-9)
        return np.sqrt(np.square(first - second).mean(0) / 2) / level


class _Batch:
    """Samples of one kind for some of the pixels, `count` for each; lanes as `samples` numbers them."""

    def __init__(self, owner: Relighter, pixels: np.ndarray, count: int, salt: int):
        self.mi, self.glow, self.body, self.paint = owner.mi, owner.glow, owner.body, owner.paint
        mi = self.mi
        import drjit as dr

        self.count, self.width = count, len(pixels) * count
        lane = dr.arange(mi.UInt32, self.width)
        pixel = dr.gather(mi.UInt32, mi.UInt32(pixels.astype(np.uint32)), lane // count)
        self.seed, self.salt = salt, dr.opaque(mi.UInt32, salt)
        self.lane, self.pixel, self.sample = lane, pixel, lane % count
        self.numbers = Numbers(mi, count, int(pixels[0]) * count)
        within = self.numbers.stratum(2, self.sample, pixel, self.salt)
        x = mi.Float(dr.gather(mi.UInt32, mi.UInt32(owner.columns), pixel)) + within.x
        y = mi.Float(dr.gather(mi.UInt32, mi.UInt32(owner.rows), pixel)) + within.y
        lens = {name: float(value) for name, value in camera(*owner.size).items()}
        aim = dr.normalize(mi.Vector3f((x - lens["cx"]) / lens["fx"], (y - lens["cy"]) / lens["fy"], 1.0))
        self.primary = mi.Ray3f(mi.Point3f(0.0), aim)
        self.at = self.body.ray_intersect(self.primary)
        dr.eval(self.at)  # all at once: gathering from it would trace the rays anew for every field

    def aiming(self, lamp: int, effort: Effort) -> Callable[[np.ndarray, int], np.ndarray]:
        """Light straight from one lamp to the first vertices."""
        mi = self.mi
        import drjit as dr

        hit: Any = dr.compress(self.at.is_valid())
        if dr.width(hit) == 0:  # pixels that only look past the body
            return lambda cam_from_world, view: np.zeros((self.width // self.count, 3), np.float32)
        vertices = self._vertices(
            dr.gather(mi.SurfaceInteraction3f, self.at, hit), hit, mi.Color3f(1 / self.count)
        )
        mine = dr.gather(mi.UInt32, self.lane, hit)
        sample, pixel = mine % self.count, dr.gather(mi.UInt32, self.pixel, hit)
        dr.eval(sample, pixel)

        def carry(cam_from_world: np.ndarray, view: int) -> np.ndarray:
            world_from_cam, salt = self._view(cam_from_world, view)
            u = self.numbers.stratum(0, sample, pixel, salt)

            def rival(at: Any, out: Any, _: Any) -> Any:
                return effort.glossy * self._glossy_pdf(at, vertices.made[1], out) / self.count

            chosen = dr.opaque(mi.UInt32, lamp)
            return self._summed(self._lit(vertices, chosen, mi.Float(1.0), u, world_from_cam, rival), hit)

        return carry

    def following(self, kind: str, effort: Effort) -> Callable[[np.ndarray, int], np.ndarray]:
        """Light found by following the reflectance, and light from lamps to later vertices."""
        mi = self.mi
        exits, sets = self._follow(kind, effort)
        counts = mi.Float(list(effort.aimed) or [0])

        def carry(cam_from_world: np.ndarray, view: int) -> np.ndarray:
            world_from_cam, salt = self._view(cam_from_world, view)
            total = self._summed(self._found(exits, world_from_cam, counts), exits.lane)
            for vertices in sets if self.glow.lamps else []:
                noise = self.numbers.noise(vertices.lane, salt)
                point = world_from_cam @ vertices.point
                chosen, probability = self._chosen(point, noise[2])
                value = self._lit(vertices, chosen, probability, mi.Point2f(noise[0], noise[1]), world_from_cam,
                                  lambda at, out, pdf: pdf)  # fmt: skip
                total += self._summed(value, vertices.lane)
            return total

        return carry

    def _follow(self, kind: str, effort: Effort) -> tuple[_Exits, list[_Vertices]]:
        mi = self.mi
        import drjit as dr

        at, hit = self.at, self.at.is_valid()
        made = self.paint.of(at, hit)
        u = self.numbers.stratum(0, self.sample, self.pixel, self.salt)
        if kind == "diffuse":
            out = mi.warp.square_to_cosine_hemisphere(u)
        else:
            half, _ = self._facets(made[1]).sample(at.wi, u)
            out = 2 * dr.dot(at.wi, half) * half - at.wi
        finding = effort.glossy * self._glossy_pdf(at, made[1], out)
        density = finding + effort.diffuse * mi.warp.square_to_cosine_hemisphere_pdf(out)
        if kind == "diffuse":
            finding = mi.Float(0.0)
        value, _ = self.paint.eval_pdf(at, made, out)
        good = hit & (density > 0) & (dr.max(value) > 0)
        ray = at.spawn_ray(at.to_world(out))
        ray.o, ray.d = dr.select(hit, ray.o, self.primary.o), dr.select(hit, ray.d, self.primary.d)
        weight = dr.select(good, value / density, dr.select(hit, 0.0, 1.0 / (effort.diffuse + effort.glossy)))
        density, first = dr.select(hit, density, dr.inf), dr.full(mi.Bool, True, self.width)
        finding = finding + dr.zeros(mi.Float, self.width)
        normal = at.sh_frame.n
        dr.eval(ray, normal, weight, density, finding, first, good)

        active: Any = dr.compress(good)
        if dr.width(active) == 0:
            return self._that_count(_Exits(None, ray, normal, weight, density, finding, first)), []
        onward, sets = dr.gather(mi.Ray3f, ray, active), []
        for bounce in range(1, DEPTH + 1):
            at = self.body.ray_intersect(onward)
            dr.eval(at)
            keep: Any = dr.compress(at.is_valid())
            if dr.width(keep) == 0:
                break
            active = dr.gather(mi.UInt32, active, keep)
            if bounce == DEPTH:  # what is still on the body is lost
                dr.scatter(weight, mi.Color3f(0.0), active)
                break
            at = dr.gather(mi.SurfaceInteraction3f, at, keep)
            carried = dr.gather(mi.Color3f, weight, active)
            vertices = self._vertices(at, active, carried)
            sets.append(vertices)
            noise = self.numbers.noise(active, self.salt + 7919 * bounce)
            sample, factor = self.paint.sample(at, vertices.made, noise[2], mi.Point2f(noise[0], noise[1]))
            onward = at.spawn_ray(at.to_world(sample.wo))
            dr.eval(onward, carried, factor, sample)
            dr.scatter(ray.o, onward.o, active)
            dr.scatter(ray.d, onward.d, active)
            dr.scatter(normal, vertices.shading, active)
            dr.scatter(weight, carried * factor, active)
            dr.scatter(density, sample.pdf, active)
            dr.scatter(finding, sample.pdf, active)
            dr.scatter(first, mi.Bool(False), active)
            dr.eval(ray, normal, weight, density, finding, first)
        dr.eval(weight)
        return self._that_count(_Exits(None, ray, normal, weight, density, finding, first)), sets

    def _that_count(self, exits: _Exits) -> _Exits:
        """Without what leads to lamps only and may not find any."""
        mi = self.mi
        import drjit as dr

        if not self.glow.only_lamps:
            return exits
        finds = (exits.finding > 0) | ~dr.isfinite(exits.density)
        lane: Any = dr.compress(finds & (dr.max(exits.weight) > 0))
        if dr.width(lane) == 0:
            lane = mi.UInt32(0)
        kept = _Exits(
            lane, dr.gather(mi.Ray3f, exits.ray, lane), dr.gather(mi.Normal3f, exits.normal, lane),
            dr.gather(mi.Color3f, exits.weight, lane), dr.gather(mi.Float, exits.density, lane),
            dr.gather(mi.Float, exits.finding, lane), dr.gather(mi.Bool, exits.first, lane),
        )  # fmt: skip
        dr.eval(kept.ray, kept.normal, kept.weight, kept.density, kept.finding, kept.first)
        return kept

    def _found(self, exits: _Exits, world_from_cam: Any, counts: Any) -> Any:
        """What the leaving rays meet in the room."""
        mi = self.mi
        import drjit as dr

        ray = mi.Ray3f(world_from_cam @ exits.ray.o, world_from_cam @ exits.ray.d)
        seen = self.glow.look(ray, world_from_cam @ exits.normal)
        tries = mi.Float(0.0)
        for lamp, share in enumerate(self.glow.choice(ray.o)):
            tries = dr.select(seen.lamp == lamp, share, tries)
        rival = dr.select(exits.first, dr.gather(mi.Float, counts, seen.lamp), tries) * seen.density
        share = exits.density * exits.finding / (dr.square(exits.finding) + dr.square(rival))
        share = dr.select(seen.is_lamp & dr.isfinite(exits.density), share, 1.0)
        return exits.weight * seen.radiance * share

    def _lit(self, vertices: _Vertices, lamp: Any, probability: Any, u: Any, world_from_cam: Any,
             rival: Callable[[Any, Any, Any], Any]) -> Any:  # fmt: skip
        """Light straight from the chosen lamps; `rival(at, out, pdf)` is the density of what competes."""
        mi = self.mi
        import drjit as dr

        point = world_from_cam @ vertices.point
        normal = world_from_cam @ mi.Normal3f(vertices.shading)
        aim = self.glow.aim(lamp, point, u, normal)
        direction = world_from_cam.inverse() @ aim.direction
        at = dr.zeros(mi.SurfaceInteraction3f)
        at.p, at.n, at.wi = vertices.point, vertices.normal, vertices.wi
        at.sh_frame = mi.Frame3f(vertices.shading)
        out = at.to_local(direction)
        value, pdf = self.paint.eval_pdf(at, vertices.made, out)
        active = dr.max(value) > 0
        active &= ~self.body.ray_test(at.spawn_ray(direction), active)
        arrives, radiance, density = self.glow.arriving(point, normal, aim, active)
        density *= probability
        value *= vertices.weight * radiance * density / (dr.square(density) + dr.square(rival(at, out, pdf)))
        return dr.select(active & arrives & (density > 0), value, 0.0)

    def _vertices(self, at: Any, lane: Any, weight: Any) -> _Vertices:
        mi = self.mi
        import drjit as dr

        # Only the normal of the shading frame is kept, so `wi` is turned into the frame made from it again.
        wi = mi.Frame3f(at.sh_frame.n).to_local(at.to_world(at.wi))
        vertices = _Vertices(lane, at.p, at.n, at.sh_frame.n, wi, self.paint.of(at), weight)
        dr.eval(
            vertices.lane, vertices.point, vertices.normal, vertices.shading, vertices.wi, *vertices.made,
            vertices.weight,
        )  # fmt: skip
        return vertices

    def _chosen(self, point: Any, u: Any) -> tuple[Any, Any]:
        """A lamp for each point, and the probability with which it was chosen."""
        mi = self.mi
        import drjit as dr

        shares = self.glow.choice(point)
        lamp, probability, below = mi.UInt32(0), shares[0], shares[0]
        for k, share in enumerate(shares[1:], 1):
            here = u >= below
            lamp, probability = dr.select(here, k, lamp), dr.select(here, share, probability)
            below = below + share
        return lamp, probability

    def _summed(self, value: Any, lane: Any) -> Float[np.ndarray, "p 3"]:
        """Sum over each pixel's lanes; `lane` None: all of them in order."""
        mi = self.mi
        import drjit as dr

        if lane is not None:
            full = dr.zeros(mi.Color3f, self.width)
            dr.scatter(full, value, lane)
            value = full
        dr.eval(value)  # or each channel's sum would trace the rays anew
        return np.array(dr.block_sum(value, self.count)).T

    def _view(self, cam_from_world: Float[np.ndarray, "3 4"], view: int) -> tuple[Any, Any]:
        mi = self.mi
        import drjit as dr

        pose = np.linalg.inv(np.vstack([cam_from_world, [0, 0, 0, 1]]))
        self.glow.view(pose)
        world_from_cam = mi.Transform4f(pose)
        # Opaque, so that one kernel serves all views.
        dr.make_opaque(world_from_cam)
        return world_from_cam, dr.opaque(mi.UInt32, self.seed + 1 + view)

    def _glossy_pdf(self, at: Any, roughness: Any, out: Any) -> Any:
        mi = self.mi
        import drjit as dr

        half = dr.normalize(at.wi + out)
        pdf = self._facets(roughness).pdf(at.wi, half) / (4 * dr.dot(at.wi, half))
        return dr.select((mi.Frame3f.cos_theta(at.wi) > 0) & (mi.Frame3f.cos_theta(out) > 0), pdf, 0.0)

    def _facets(self, roughness: Any) -> Any:
        mi = self.mi
        import drjit as dr

        return mi.MicrofacetDistribution(mi.MicrofacetType.GGX, dr.maximum(dr.square(roughness), 1e-3), True)
