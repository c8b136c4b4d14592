"""Turn what surfaces are made of into pictures of their albedo and their glow.

The albedo of a reflectance at a texture coordinate is the share that it sends back of light that arrives evenly from its
side: a mean of Mitsuba's own samples. A picture spans the texture's one period where the reflectance repeats, else
the coordinates that are in use. Linear Rec.709.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

SAMPLES = 64  # of a reflectance, per texel; those of a plain one: all over
PLAIN_SAMPLES = 65536
LARGEST = 2048  # texels a side
TELLING = 16  # texture coordinates that tell whether anything depends on them
CUTS = 12  # parts of the edge of a triangle that is partly cut out, at most
CUT_M = 0.006


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Albedo and emitted radiance over texture coordinates, row 0 at `low`; outside of it, repeated or held."""

    albedo: Float[np.ndarray, "h w 3"]
    emission: Float[np.ndarray, "h w 3"]  # from the front only
    low: Float[np.ndarray, "2"]
    size: Float[np.ndarray, "2"]
    repeats: bool
    two_sided: bool  # the back reflects too

    def digest(self) -> bytes:
        import hashlib

        facts = (self.albedo, self.emission, self.low, self.size)
        whole = b"".join(np.ascontiguousarray(fact, np.float32).tobytes() for fact in facts)
        return hashlib.sha256(whole + bytes([self.repeats, self.two_sided])).digest()


class Found:
    """Collects the looks of a scene's shapes, one for each pair of a reflectance and a lamp, and what they cost in truth."""

    def __init__(self, mi: Any):
        self.mi = mi
        self.looks: list[Look] = []
        self.index: dict[tuple[Any, ...], int] = {}
        self.kept: list[Any] = []  # an id holds only while its object lives
        self.areas: dict[str, float] = {}
        self.total = 0.0

    def look(self, part: Any) -> tuple[Int[np.ndarray, "f 3"], int, Any]:
        """Faces that stay, the number of their look, and the part with vertices that were added for cuts."""
        bsdf, faces = part.bsdf, part.faces
        area = float(_areas(part.vertices, faces).sum())
        self.total += area
        transmitted, kind = self._kind(bsdf, part)
        if kind:
            self.areas[kind] = self.areas.get(kind, 0.0) + area
        if transmitted > 0.5 and part.emitter is None:
            return faces[:0], -1, part
        if self.mi.has_flag(bsdf.flags(), self.mi.BSDFFlags.Null):
            part, faces = self._cut(part)
            if len(faces) == 0:
                return faces, -1, part
        used = part.uv[faces]
        span = (used.min((0, 1)), used.max((0, 1)))
        key = (id(bsdf), id(part.emitter) if part.emitter is not None else None)
        if part.emitter is not None or key not in self.index or not self._covers(self.index[key], span):
            self.index[key] = len(self.looks)
            self.looks.append(self._picture(bsdf, part.emitter, span))
            self.kept.append((bsdf, part.emitter))
        return faces, self.index[key], part

    def notes(self) -> tuple[str, ...]:
        """What was simplified, in shares of the surfaces' area."""
        return tuple(
            f"{kind} ({100 * area / max(self.total, 1e-12):.2g} % of the area)"
            for kind, area in self.areas.items()
        )

    def _covers(self, index: int, span: tuple[np.ndarray, np.ndarray]) -> bool:
        look = self.looks[index]
        plain = look.albedo.shape[:2] == (1, 1) == look.emission.shape[:2]
        inside = bool((span[0] >= look.low - 1e-6).all() and (span[1] <= look.low + look.size + 1e-6).all())
        return plain or look.repeats or inside

    def _kind(self, bsdf: Any, part: Any) -> tuple[float, str]:
        """How much it lets through, and what is lost when it becomes diffuse; nothing lost: ''."""
        mi = self.mi
        flags = bsdf.flags()
        _, through = self._albedo(bsdf, part.uv[part.faces].mean((0, 1))[None], 4096)
        if through[0] > 0.5:
            return float(through[0]), "glass and what else lets light through, left out"
        if mi.has_flag(flags, mi.BSDFFlags.DeltaReflection):
            return float(through[0]), "mirrors, made diffuse"
        if mi.has_flag(flags, mi.BSDFFlags.GlossyReflection):
            return float(through[0]), "gloss and metal, made diffuse"
        if mi.has_flag(flags, mi.BSDFFlags.Null):
            return float(through[0]), "partly transparent, cut out where it is mostly so"
        if mi.has_flag(flags, mi.BSDFFlags.Transmission):
            return float(through[0]), "translucent, made opaque"
        return float(through[0]), ""

    def _albedo(
        self, bsdf: Any, uv: Float[np.ndarray, "n 2"], count: int, seed: int = 0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Share sent back [n 3], and share let through [n], but not by holes."""
        mi = self.mi
        import drjit as dr

        n = len(uv)
        context = mi.BSDFContext(mi.TransportMode.Importance)  # power, not radiance, which glass squeezes
        back, through = np.zeros((n, 3)), np.zeros(n)
        step = max(1, 4_000_000 // count)
        for begin in range(0, n, step):
            some = uv[begin : begin + step]
            lane = dr.arange(mi.UInt32, len(some) * count)
            # The same numbers for each coordinate: what is the same there comes out the same.
            sample = lane % count
            a, b = mi.sample_tea_32(sample, mi.UInt32(seed))
            c, d = mi.sample_tea_32(sample, mi.UInt32(seed + 1))
            e, _ = mi.sample_tea_32(sample, mi.UInt32(seed + 2))
            u = [mi.Float(word >> 8) * 2.0**-24 for word in (a, b, c, d, e)]
            si = dr.zeros(mi.SurfaceInteraction3f, len(some) * count)
            si.t = 1.0
            si.n, si.sh_frame = mi.Normal3f(0, 0, 1), mi.Frame3f(mi.Normal3f(0, 0, 1))
            si.dp_du, si.dp_dv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
            si.wi = mi.warp.square_to_cosine_hemisphere(mi.Point2f(u[0], u[1]))
            si.uv = dr.gather(mi.Point2f, mi.Point2f(some.T.astype(np.float32)), lane // count)
            picked, weight = bsdf.sample(context, si, u[4], mi.Point2f(u[2], u[3]))
            good = dr.isfinite(dr.sum(weight)) & (picked.pdf > 0)
            null = mi.has_flag(picked.sampled_type, mi.BSDFFlags.Null)
            up = mi.Frame3f.cos_theta(picked.wo) > 0
            value = dr.select(good & up & ~null, mi.Color3f(weight), 0.0)
            gone = dr.select(good & ~up & ~null, dr.mean(mi.Color3f(weight)), 0.0)
            dr.eval(value, gone)
            back[begin : begin + step] = np.array(dr.block_sum(value, count)).T / count
            through[begin : begin + step] = np.array(dr.block_sum(gone, count)) / count
        return back, through

    def _of_what_is_there(
        self, bsdf: Any, uv: Float[np.ndarray, "n 2"], count: int
    ) -> Float[np.ndarray, "n 3"]:
        """Albedo of the opaque part."""
        albedo, _ = self._albedo(bsdf, uv, count)
        if self.mi.has_flag(bsdf.flags(), self.mi.BSDFFlags.Null):
            albedo /= np.maximum(self._opacity(bsdf, uv), 0.1)[:, None]
        return albedo

    def _opacity(self, bsdf: Any, uv: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        mi = self.mi
        import drjit as dr

        si = dr.zeros(mi.SurfaceInteraction3f, len(uv))
        si.t, si.wi = 1.0, mi.Vector3f(0, 0, 1)
        si.uv = mi.Point2f(uv.T.astype(np.float32))
        holes = dr.mean(mi.Color3f(bsdf.eval_null_transmission(si))) + dr.zeros(mi.Float, len(uv))
        return 1 - np.array(holes)

    def _cut(self, part: Any) -> tuple[Any, np.ndarray]:
        """Triangles in small parts, those left out that are mostly transparent."""
        corners = part.vertices[part.faces]
        edge = np.linalg.norm(corners - np.roll(corners, 1, 1), axis=2).max(1)
        cuts = int(np.clip(np.ceil(np.median(edge) / CUT_M), 1, CUTS))
        weights, small = _grid(cuts)

        def spread(values: np.ndarray) -> np.ndarray:
            return np.einsum("wk,fkc->fwc", weights, values[part.faces]).reshape(-1, values.shape[1])

        uv = spread(part.uv)
        faces = (np.arange(len(part.faces))[:, None, None] * len(weights) + small).reshape(-1, 3)
        opaque = self._opacity(part.bsdf, uv[faces].mean(1)) > 0.5
        grown = replace(part, vertices=spread(part.vertices), normals=spread(part.normals), uv=uv)
        return grown, faces[opaque]

    def _picture(self, bsdf: Any, emitter: Any, span: tuple[np.ndarray, np.ndarray]) -> Look:
        mi = self.mi
        rng = np.random.default_rng(0)
        low, high = span
        size = np.maximum(high - low, 1e-6)
        some = low + rng.uniform(0, 1, (TELLING, 2)) * size
        there, _ = self._albedo(bsdf, some, SAMPLES)
        glow = self._glow(emitter, some)
        sides = mi.has_flag(bsdf.flags(), mi.BSDFFlags.BackSide)
        if np.ptp(there, axis=0).max() < 1e-6 and np.ptp(glow, axis=0).max() < 1e-6 * max(glow.max(), 1):
            plain = self._of_what_is_there(bsdf, some[:1], PLAIN_SAMPLES)
            return Look(plain[None], glow[None, :1], np.zeros(2), np.ones(2), True, sides)
        again, _ = self._albedo(bsdf, some + rng.integers(-2, 3, (TELLING, 2)), SAMPLES)
        glow_again = self._glow(emitter, some + rng.integers(-2, 3, (TELLING, 2)))
        repeats = bool(
            np.abs(again - there).mean() < 0.01 * there.mean() + 1e-6 and np.allclose(glow, glow_again)
        )
        if repeats:
            low, size = np.zeros(2), np.ones(2)
        rows, columns = self._texels(bsdf, emitter, size)
        y, x = np.meshgrid(
            (np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns, indexing="ij"
        )
        uv = low + np.stack([x.ravel(), y.ravel()], 1) * size
        albedo = self._of_what_is_there(bsdf, uv, SAMPLES)
        shape = (rows, columns, 3)
        return Look(
            albedo.reshape(shape).astype(np.float32), self._glow(emitter, uv).reshape(shape).astype(np.float32),
            low, size, repeats, sides,
        )  # fmt: skip

    def _glow(self, emitter: Any, uv: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
        """Radiance that leaves the front."""
        mi = self.mi
        import drjit as dr

        if emitter is None:
            return np.zeros((len(uv), 3))
        si = dr.zeros(mi.SurfaceInteraction3f, len(uv))
        si.t, si.wi, si.n = 1.0, mi.Vector3f(0, 0, 1), mi.Normal3f(0, 0, 1)
        si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
        si.uv = mi.Point2f(uv.T.astype(np.float32))
        value = mi.Color3f(emitter.eval(si)) + dr.zeros(mi.Color3f, len(uv))
        return np.maximum(np.array(value, float).T, 0)

    def _texels(self, bsdf: Any, emitter: Any, size: np.ndarray) -> tuple[int, int]:
        """As many as the largest texture in it has."""
        rows, columns = 64, 64
        for owner in (bsdf, emitter):
            if owner is None:
                continue
            for name, value in self.mi.traverse(owner):
                shape = getattr(value, "shape", ())
                if name.endswith("data") and len(shape) == 3:
                    rows, columns = max(rows, shape[0]), max(columns, shape[1])
        return min(LARGEST, int(np.ceil(rows * size[1]))), min(LARGEST, int(np.ceil(columns * size[0])))


def _areas(vertices: np.ndarray, faces: np.ndarray) -> Float[np.ndarray, " f"]:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def _grid(cuts: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """A triangle in `cuts`^2 equal ones: corner weights and faces."""
    number = {
        (i, j): k for k, (i, j) in enumerate((i, j) for j in range(cuts + 1) for i in range(cuts + 1 - j))
    }
    weights = np.array([[cuts - i - j, i, j] for i, j in number]) / cuts
    faces = []
    for i, j in number:
        if i + j < cuts:
            faces.append([number[i, j], number[i + 1, j], number[i, j + 1]])
        if i + j < cuts - 1:
            faces.append([number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]])
    return weights, np.array(faces)
