"""Light the body in many views at once: paths across the body are traced once, then carried through the room.

Camera and body are rigid, so what a path does until it leaves the body is the same in every view; only what
it then meets differs. `_paths` follows every pixel's samples over the body, in the camera's frame, until they
leave; `Relighter.look` carries the leaving rays into the room of one view, where they find a panel or a lamp.

Estimator, for one pixel (multi-sample MIS with the balance heuristic, Veach and Guibas 1995): at the first
vertex `DIFFUSE` cosine-weighted and `GLOSSY` microfacet samples look for panels and lamps, and `AIMED`
samples per lamp look for lamps; at later vertices one reflectance sample and one aimed sample do. Nothing is
clamped. Needs one of Mitsuba's vectorised variants; `render.Foreground` is the plain way.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from hardware.virtual import tracer
from hardware.virtual.objects import Body
from hardware.virtual.rooms import Room
from hardware.virtual.truth import FIELD_OF_VIEW_DEG

DEPTH = 6  # vertices on the body; light that met it more often is under a thousandth
LANES = 3_000_000  # paths in flight: bounds the memory to about 0.6 GB


@dataclass(frozen=True, slots=True)
class Effort:
    """Samples per pixel and view."""

    diffuse: int = 256
    glossy: int = 64
    aimed: int = 16  # per lamp


@dataclass(frozen=True, slots=True, eq=False)
class _Exits:
    """Rays that left the body, `per_pixel` for each pixel in turn, camera frame."""

    per_pixel: int
    ray: Any
    weight: Any  # radiance found is multiplied by this and summed
    density: Any  # of finding this direction by reflectance, all samples together; inf: seen directly
    rivals: Any  # aimed samples that compete for a lamp in this direction


@dataclass(frozen=True, slots=True, eq=False)
class _Vertices:
    """Points on the body from which lamps are aimed at."""

    count: int  # paths in flight that these belong to
    per_pixel: int
    lane: Any  # which of those paths; None: all of them in order
    at: Any  # SurfaceInteraction3f, camera frame
    weight: Any
    first: bool


class Relighter:
    """Path-traces the pixels that the body touches, for several views that share their samples."""

    def __init__(self, scene: Any, room: Room, body: Body, touched: Bool[np.ndarray, "h w"], device: str):
        self.mi = mi = tracer.load(device)
        self.room_scene = scene  # world frame
        self.lamps = [s.emitter() for s in scene.shapes() if s.id() != "room"]
        self.panels = next(s for s in scene.shapes() if s.id() == "room")
        self.body_scene = mi.load_dict({"type": "scene", "body": tracer.body_mesh(mi, body)})
        rows, columns = np.nonzero(touched)
        self.rows, self.columns = mi.UInt32(rows.astype(np.uint32)), mi.UInt32(columns.astype(np.uint32))
        self.pixels = len(rows)
        self.size = (touched.shape[1], touched.shape[0])

    def look(
        self, cams_from_world: Float[np.ndarray, "n 3 4"], effort: Effort, seed: int
    ) -> Float[np.ndarray, "n p 3"]:
        """Radiance of the touched pixels in each view, row by row; all views share one set of samples."""
        total = np.zeros((len(cams_from_world), self.pixels, 3))
        for kind, count in (("diffuse", effort.diffuse), ("glossy", effort.glossy), ("aimed", effort.aimed)):
            if count == 0:
                continue
            sampler = self.mi.load_dict({"type": "multijitter", "sample_count": count, "seed": seed})
            count = sampler.sample_count()
            step = max(
                d for d in range(1, count + 1) if count % d == 0 and (d * self.pixels <= LANES or d == 1)
            )
            sampler.set_samples_per_wavefront(step)
            sampler.seed(seed * 3 + ("diffuse", "glossy", "aimed").index(kind), step * self.pixels)
            for _ in range(count // step):
                if kind == "aimed":
                    sets = [self._first_vertices(sampler, step, count)]
                    exits = None
                else:
                    exits, sets = self._paths(sampler, step, kind, effort)
                for view, cam_from_world in enumerate(cams_from_world):
                    total[view] += self._carried(exits, sets, cam_from_world, sampler, effort)
                sampler.advance()
        return total.astype(np.float32)

    def _primary(self, sampler: Any, per_pixel: int) -> Any:
        """Camera rays, `per_pixel` for each touched pixel in turn."""
        mi = self.mi
        import drjit as dr

        pixel = dr.arange(mi.UInt32, self.pixels * per_pixel) // per_pixel
        within = sampler.next_2d()
        x = mi.Float(dr.gather(mi.UInt32, self.columns, pixel)) + within.x
        y = mi.Float(dr.gather(mi.UInt32, self.rows, pixel)) + within.y
        width, height = self.size
        focal = width / 2 / float(np.tan(np.radians(FIELD_OF_VIEW_DEG) / 2))
        return mi.Ray3f(
            mi.Point3f(0.0), dr.normalize(mi.Vector3f((x - width / 2) / focal, (y - height / 2) / focal, 1.0))
        )

    def _first_vertices(self, sampler: Any, per_pixel: int, count: int) -> _Vertices:
        import drjit as dr

        at = self.body_scene.ray_intersect(self._primary(sampler, per_pixel))
        weight = dr.select(at.is_valid(), 1.0 / count, 0.0)
        dr.eval(at, weight)
        return _Vertices(self.pixels * per_pixel, per_pixel, None, at, weight, True)

    def _paths(
        self, sampler: Any, per_pixel: int, kind: str, effort: Effort
    ) -> tuple[_Exits, list[_Vertices]]:
        """Follow samples of one kind until they leave the body."""
        mi = self.mi
        import drjit as dr

        lanes = self.pixels * per_pixel
        primary = self._primary(sampler, per_pixel)
        at = self.body_scene.ray_intersect(primary)
        hit = at.is_valid()
        out = self._first_direction(at, sampler.next_2d(hit), kind, hit)
        density = effort.diffuse * mi.warp.square_to_cosine_hemisphere_pdf(out)
        density += effort.glossy * self._glossy_pdf(at, out, hit)
        value = at.bsdf().eval(mi.BSDFContext(), at, out, hit)
        good = hit & (density > 0) & (dr.max(value) > 0)
        ray = at.spawn_ray(at.to_world(out))
        ray.o, ray.d = dr.select(hit, ray.o, primary.o), dr.select(hit, ray.d, primary.d)
        weight = dr.select(good, value / density, dr.select(hit, 0.0, 1.0 / (effort.diffuse + effort.glossy)))
        density = dr.select(hit, density, dr.inf)
        rivals = dr.select(hit, mi.Float(effort.aimed), 0.0)
        dr.eval(ray, weight, density, rivals, good)

        active = dr.compress(good)
        bounced = self.body_scene.ray_intersect(dr.gather(mi.Ray3f, ray, active))
        sets = []
        for _ in range(1, DEPTH):
            keep = dr.compress(bounced.is_valid())
            if dr.width(keep) == 0:
                break
            active = dr.gather(mi.UInt32, active, keep)
            at = dr.gather(mi.SurfaceInteraction3f, bounced, keep)
            carried = dr.gather(mi.Color3f, weight, active)
            dr.eval(at, carried, active)
            sets.append(_Vertices(lanes, per_pixel, active, at, carried, False))
            u = self._noise(sampler, active, 3)
            sample, factor = at.bsdf().sample(mi.BSDFContext(), at, u[0], mi.Point2f(u[1], u[2]))
            onward = at.spawn_ray(at.to_world(sample.wo))
            dr.scatter(ray.o, onward.o, active)
            dr.scatter(ray.d, onward.d, active)
            dr.scatter(weight, carried * factor, active)
            dr.scatter(density, sample.pdf, active)
            dr.scatter(rivals, mi.Float(1.0 / max(1, len(self.lamps))), active)
            dr.eval(ray, weight, density, rivals)
            bounced = self.body_scene.ray_intersect(onward)
        # What is still on the body after the last vertex is lost.
        left = dr.gather(mi.UInt32, active, dr.compress(bounced.is_valid()))
        if dr.width(left) > 0:
            dr.scatter(weight, mi.Color3f(0.0), left)
        dr.eval(weight)
        return _Exits(per_pixel, ray, weight, density, rivals), sets

    def _noise(self, sampler: Any, lane: Any, count: int) -> list[Any]:
        """Independent numbers for some of the sampler's lanes."""
        import drjit as dr

        return [dr.gather(self.mi.Float, sampler.next_1d(), lane) for _ in range(count)]

    def _first_direction(self, at: Any, u: Any, kind: str, active: Any) -> Any:
        """Local direction drawn for the first vertex."""
        mi = self.mi
        import drjit as dr

        if kind == "diffuse":
            return mi.warp.square_to_cosine_hemisphere(u)
        half, _ = self._facets(at, active).sample(at.wi, u)
        return 2 * dr.dot(at.wi, half) * half - at.wi

    def _glossy_pdf(self, at: Any, out: Any, active: Any) -> Any:
        mi = self.mi
        import drjit as dr

        half = dr.normalize(at.wi + out)
        pdf = self._facets(at, active).pdf(at.wi, half) / (4 * dr.dot(at.wi, half))
        up = active & (mi.Frame3f.cos_theta(at.wi) > 0) & (mi.Frame3f.cos_theta(out) > 0)
        return dr.select(up, pdf, 0.0)

    def _facets(self, at: Any, active: Any) -> Any:
        mi = self.mi
        import drjit as dr

        roughness = at.shape.eval_attribute_1("vertex_roughness", at, active)
        return mi.MicrofacetDistribution(mi.MicrofacetType.GGX, dr.maximum(dr.square(roughness), 1e-3), True)

    def _carried(self, exits: _Exits | None, sets: list[_Vertices], cam_from_world: np.ndarray, sampler: Any,
                 effort: Effort) -> Float[np.ndarray, "p 3"]:  # fmt: skip
        """Radiance of each pixel in one view."""
        mi = self.mi
        import drjit as dr

        world_from_cam = mi.Transform4f(np.linalg.inv(np.vstack([cam_from_world, [0, 0, 0, 1]])))
        dr.make_opaque(world_from_cam)
        total = mi.Color3f(0.0)
        if exits is not None:
            total += dr.block_sum(self._found(exits, world_from_cam), exits.per_pixel)
        for vertices in sets:
            value = self._aimed(vertices, world_from_cam, sampler, effort)
            if vertices.lane is not None:
                full = dr.zeros(mi.Color3f, vertices.count)
                dr.scatter(full, value, vertices.lane)
                value = full
            total += dr.block_sum(value, vertices.per_pixel)
        return np.array(total).T

    def _found(self, exits: _Exits, world_from_cam: Any) -> Any:
        """What the leaving rays meet in the room."""
        mi = self.mi
        import drjit as dr

        ray = world_from_cam @ exits.ray
        si = self.room_scene.ray_intersect(ray)
        emitter = si.emitter(self.room_scene)
        radiance = emitter.eval(si)
        lamp = si.is_valid() & (si.shape != mi.ShapePtr(self.panels))
        start = dr.zeros(mi.Interaction3f)
        start.p = ray.o
        seen = mi.DirectionSample3f(self.room_scene, si, start)
        rival = exits.rivals * emitter.pdf_direction(start, seen, lamp)
        share = dr.select(lamp & dr.isfinite(exits.density), exits.density / (exits.density + rival), 1.0)
        return exits.weight * radiance * share

    def _aimed(self, vertices: _Vertices, world_from_cam: Any, sampler: Any, effort: Effort) -> Any:
        """Light that comes straight from the lamps to points on the body."""
        mi = self.mi
        import drjit as dr

        at = vertices.at
        point = dr.zeros(mi.Interaction3f)
        point.p = world_from_cam @ at.p
        total = mi.Color3f(0.0)
        if vertices.first:
            draws = [lamp.sample_direction(point, sampler.next_2d(), at.is_valid()) for lamp in self.lamps]
        else:
            u = self._noise(sampler, vertices.lane, 2)
            draws = [self.room_scene.sample_emitter_direction(point, mi.Point2f(u[0], u[1]), False)]
        cam_from_world = world_from_cam.inverse()
        for aim, radiance_over_pdf in draws:
            direction = cam_from_world @ aim.d
            out = at.to_local(direction)
            value, pdf = at.bsdf().eval_pdf(mi.BSDFContext(), at, out)
            if vertices.first:
                found = effort.diffuse * mi.warp.square_to_cosine_hemisphere_pdf(out)
                found += effort.glossy * self._glossy_pdf(at, out, at.is_valid())
                share = effort.aimed * aim.pdf / (effort.aimed * aim.pdf + found)
            else:
                share = aim.pdf / (aim.pdf + pdf)
            active = (aim.pdf > 0) & (dr.max(value) > 0) & (dr.max(vertices.weight) > 0)
            clear = ~self.body_scene.ray_test(at.spawn_ray(direction), active)
            reach = mi.Ray3f(point.p, aim.d)
            reach.maxt = aim.dist * (1 - 1e-4)
            clear &= ~self.room_scene.ray_test(reach, active & clear)
            total += dr.select(active & clear, vertices.weight * value * radiance_over_pdf * share, 0.0)
        return total
