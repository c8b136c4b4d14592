"""Drive Mitsuba 3: choose a variant that works here, build scenes, take pictures.

The one file that knows Mitsuba. Its cameras look along z with x left and y up, ours have x right and y
down: `_mitsuba_from_opencv` is the half turn between them. Textures are handed over top row first, with
v = 0 at the first row.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from hardware.errors import StudioError
from hardware.virtual.studio.objects import Body
from hardware.virtual.studio.rooms import Panel, Room, Sheet

OLDEST_LLVM = 16
_mitsuba_from_opencv = np.diag([-1.0, -1.0, 1.0, 1.0])


def load(device: str = "auto") -> Any:
    """Mitsuba with the fastest variant that runs here: `cuda` when asked for, else LLVM's, else scalar.

    Raises:
        StudioError: an unknown device, or CUDA was asked for and does not render.
    """
    if device not in ("auto", "cpu", "cuda"):
        raise StudioError(f"device {device!r} is not known; choose auto, cpu or cuda")
    if device != "cuda" and "DRJIT_LIBLLVM_PATH" not in os.environ:
        found = _libllvm()
        if found is not None:
            os.environ["DRJIT_LIBLLVM_PATH"] = str(found)
    import mitsuba as mi

    if device == "cuda":
        try:
            mi.set_variant("cuda_ad_rgb")
            _probe(mi)
        except Exception as fault:
            raise StudioError(f"Mitsuba cannot render on this GPU ({fault}); use --device cpu") from fault
        return mi
    if _has_llvm(mi):
        mi.set_variant("llvm_ad_rgb")
    else:
        mi.set_variant("scalar_rgb")
    return mi


def is_vectorised(mi: Any) -> bool:
    """Whether the variant follows many rays at once."""
    return not str(mi.variant()).startswith("scalar")


def _has_llvm(mi: Any) -> bool:
    import drjit as dr

    return bool("llvm_ad_rgb" in mi.variants() and dr.has_backend(dr.JitBackend.LLVM))


def _libllvm() -> Path | None:
    """The newest libLLVM of the system that Mitsuba can use."""
    found: list[tuple[int, Path]] = []
    for folder in (Path("/usr/lib"), Path("/usr/local/lib")):
        for path in (
            *folder.glob("*/libLLVM*.so*"),
            *folder.glob("llvm-*/lib/libLLVM*.so*"),
            *folder.glob("libLLVM*.so*"),
        ):
            digits = (
                path.name.replace("libLLVM", "").replace("-", "").replace(".so", "").strip(".").split(".")[0]
            )
            if digits.isdigit() and int(digits) >= OLDEST_LLVM:
                found.append((int(digits), path))
    return max(found)[1] if found else None


def _probe(mi: Any) -> None:
    mi.render(mi.load_dict(mi.cornell_box()), spp=1).numpy()


class RoomTracer:
    """The unbaked room, for baking."""

    def __init__(self, room: Room, atlas: Any, device: str):
        self.mi = mi = load(device)
        parts = {
            "room": room_mesh(
                mi, room.panels, atlas, {"type": "diffuse", "reflectance": texture(mi, atlas.picture)}
            )
        }
        self.scene = mi.load_dict({
            "type": "scene", **parts, **lamps(mi, room),
            "integrator": {"type": "path", "max_depth": 2},
        })  # fmt: skip
        self.every_bounce = mi.load_dict({"type": "path", "max_depth": 12, "rr_depth": 4})
        self.sensors: dict[tuple[int, int], Any] = {}

    def above(self, panel: Panel, top: float, left: float, tall: float, wide: float, size: int, samples: int,
              seed: int, bounced: bool) -> Float[np.ndarray, "h w 3"]:  # fmt: skip
        """Radiance leaving a part of a panel (fractions of its edges), seen straight from above.

        Light that reaches the panel straight from the lamps, or also what other panels send (`bounced`).
        """
        mi = self.mi
        normal = np.cross(panel.down, panel.right)
        normal /= np.linalg.norm(normal)
        middle = panel.corner + panel.right * (left + wide / 2) + panel.down * (top + tall / 2)
        world_from_sensor = np.eye(4)
        # Columns: what the camera calls left, up and forward, scaled to the half extents it should see.
        world_from_sensor[:3, 0] = -panel.right * wide / 2
        world_from_sensor[:3, 1] = -panel.down * tall / 2
        world_from_sensor[:3, 2] = -normal
        world_from_sensor[:3, 3] = middle + normal * 1e-3
        pose = mi.ScalarTransform4f(world_from_sensor)
        if (size, samples) not in self.sensors:
            self.sensors[size, samples] = mi.load_dict({
                "type": "orthographic", "to_world": pose, "near_clip": 1e-5, "far_clip": 20.0,
                "film": film(size, size), "sampler": {"type": "independent", "sample_count": samples},
            })  # fmt: skip
        sensor = self.sensors[size, samples]
        params = mi.traverse(sensor)
        params["to_world"] = mi.Transform4f(world_from_sensor)
        params.update()
        integrator = self.every_bounce if bounced else self.scene.integrator()
        return np.array(mi.render(self.scene, sensor=sensor, integrator=integrator, spp=samples, seed=seed))


def film(width: int, height: int, crop: tuple[int, int, int, int] | None = None) -> dict[str, Any]:
    """A float32 RGB film with a box filter, so that a pixel is the mean over its own square."""
    inner = {}
    if crop is not None:
        x, y, w, h = crop
        inner = {"crop_offset_x": x, "crop_offset_y": y, "crop_width": w, "crop_height": h}
    return {
        "type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb", "component_format": "float32",
        "rfilter": {"type": "box"}, **inner,
    }  # fmt: skip


def texture(mi: Any, picture: Float[np.ndarray, "h w 3"], interpolate: str = "nearest") -> dict[str, Any]:
    """A bitmap texture of linear values."""
    return {
        "type": "bitmap", "bitmap": mi.Bitmap(np.ascontiguousarray(picture, np.float32)), "raw": True,
        "filter_type": interpolate, "wrap_mode": "clamp",
    }  # fmt: skip


def room_mesh(mi: Any, panels: tuple[Panel, ...], atlas: Any, bsdf: dict[str, Any],
              emitter: dict[str, Any] | None = None) -> Any:  # fmt: skip
    """All panels as one mesh with the atlas's texture coordinates."""
    corners = quad_corners(panels)
    (u0, v0), (u1, v1) = atlas.low.T, atlas.high.T
    uv = np.stack(
        [np.stack([u0, v0], 1), np.stack([u1, v0], 1), np.stack([u1, v1], 1), np.stack([u0, v1], 1)], 1
    )
    first = 4 * np.arange(len(panels))[:, None]
    # cross(down, right) is the visible side: corner, corner + down, corner + down + right, ...
    faces = np.concatenate([first + [0, 3, 2], first + [0, 2, 1]])
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    if emitter is not None:
        properties["emitter"] = mi.load_dict(emitter)
    mesh = mi.Mesh("room", 4 * len(panels), len(faces), has_vertex_texcoords=True, props=properties)
    params = mi.traverse(mesh)
    params["vertex_positions"] = np.ravel(corners).astype(np.float32)
    params["vertex_texcoords"] = np.ravel(uv).astype(np.float32)
    params["faces"] = np.ravel(faces).astype(np.uint32)
    params.update()
    return mesh


def quad_corners(panels: Sequence[Panel | Sheet]) -> Float[np.ndarray, "p 4 3"]:
    """Round each panel: corner, along its row, diagonally across, along its column."""
    return np.stack([
        [p.corner, p.corner + p.right, p.corner + p.right + p.down, p.corner + p.down] for p in panels
    ])  # fmt: skip


def body_mesh(mi: Any, body: Body) -> Any:
    """The body with its shading normals and per-vertex albedo, roughness and, if some of it is metal, metalness."""
    solid = body.solid
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict({
        "type": "principled", "specular": body.specular,
        "base_color": {"type": "mesh_attribute", "name": "vertex_albedo"},
        "roughness": {"type": "mesh_attribute", "name": "vertex_roughness"},
        **({} if body.metalness is None else {"metallic": {"type": "mesh_attribute", "name": "vertex_metalness"}}),
    })  # fmt: skip
    mesh = mi.Mesh("body", len(solid.vertices), len(solid.faces), has_vertex_normals=True, props=properties)
    mesh.add_attribute("vertex_albedo", 3, np.ravel(body.albedo).astype(np.float32))
    mesh.add_attribute("vertex_roughness", 1, np.ravel(body.roughness).astype(np.float32))
    if body.metalness is not None:
        mesh.add_attribute("vertex_metalness", 1, np.ravel(body.metalness).astype(np.float32))
    params = mi.traverse(mesh)
    params["vertex_positions"] = np.ravel(solid.vertices).astype(np.float32)
    params["vertex_normals"] = np.ravel(solid.normals).astype(np.float32)
    params["faces"] = np.ravel(solid.faces).astype(np.uint32)
    params.update()
    return mesh


class LanePaint:
    """The body's reflectance where what it is made of is at hand, one per lane, and needs no mesh."""

    def __init__(self, mi: Any, body: Body):
        self.mi, self.metal = mi, body.metalness is not None

        class Lanes(mi.Texture):
            # Calls that Mitsuba dispatches by pointer visit every reflectance alive, this one's too: between
            # its own calls it has to answer, with anything.
            value: Any = 0.5

            def eval(self, si: Any, active: Any = True) -> Any:
                return mi.Color3f(self.value)

            def eval_1(self, si: Any, active: Any = True) -> Any:
                return mi.Float(self.value)

        mi.register_texture("lanes", Lanes)
        self.lanes = [mi.load_dict({"type": "lanes"}) for _ in range(3 if self.metal else 2)]
        names = ("base_color", "roughness", "metallic")
        looks = dict(zip(names, self.lanes, strict=False))
        self.bsdf = mi.load_dict({"type": "principled", "specular": body.specular, **looks})

    def of(self, at: Any, active: Any = True) -> tuple[Any, ...]:
        """Albedo, roughness and, if some of the body is metal, metalness at points of its mesh."""
        mi, shape = self.mi, at.shape
        albedo = mi.Color3f(shape.eval_attribute_3("vertex_albedo", at, active))
        one = ("vertex_roughness", "vertex_metalness")[: len(self.lanes) - 1]
        return albedo, *(shape.eval_attribute_1(name, at, active) for name in one)

    def eval_pdf(self, at: Any, made: tuple[Any, ...], out: Any) -> tuple[Any, Any]:
        """Reflectance times cosine, and its sampling density, for local directions `at.wi` and `out`."""
        with self._painted(made):
            return self.bsdf.eval_pdf(self.mi.BSDFContext(), at, out)

    def sample(self, at: Any, made: tuple[Any, ...], lobe: Any, u: Any) -> tuple[Any, Any]:
        """A local direction with its density, and reflectance times cosine over density."""
        with self._painted(made):
            return self.bsdf.sample(self.mi.BSDFContext(), at, lobe, u)

    @contextmanager
    def _painted(self, made: tuple[Any, ...]) -> Iterator[None]:
        for lanes, value in zip(self.lanes, made, strict=True):
            lanes.value = value
        yield
        for lanes in self.lanes:
            lanes.value = 0.5


def lens(mi: Any, width: int, height: int, field_deg: float,
         crop: tuple[int, int, int, int] | None = None) -> dict[str, Any]:  # fmt: skip
    """A pinhole at the origin in our camera frame."""
    return {
        "type": "perspective", "fov": field_deg, "fov_axis": "x", "near_clip": 1e-3, "far_clip": 50.0,
        "to_world": mi.ScalarTransform4f(_mitsuba_from_opencv), "film": film(width, height, crop),
        "sampler": {"type": "multijitter"},
    }  # fmt: skip


def place(mi: Any, sensor: Any, world_from_cam: Float[np.ndarray, "3 4"]) -> None:
    """Put a lens somewhere."""
    params = mi.traverse(sensor)
    params["to_world"] = mi.Transform4f(np.vstack([world_from_cam, [0, 0, 0, 1]]) @ _mitsuba_from_opencv)
    params.update()


def move_room(mi: Any, params: Any, room: Room, corners: Float[np.ndarray, "p 4 3"],
              cam_from_world: Float[np.ndarray, "3 4"]) -> None:  # fmt: skip
    """Carry panels and lamps into the camera's frame."""
    pose = np.vstack([cam_from_world, [0, 0, 0, 1]])
    moved = corners.reshape(-1, 3) @ cam_from_world[:, :3].T + cam_from_world[:, 3]
    params["room.vertex_positions"] = np.ravel(moved).astype(np.float32)
    for k, globe in enumerate(room.globes):
        params[f"globe{k}.to_world"] = mi.Transform4f(pose @ globe_pose(globe))
    for k, sheet in enumerate(room.sheets):
        params[f"sheet{k}.to_world"] = mi.Transform4f(pose @ sheet_pose(sheet))
    params.update()


BLACK = {"type": "conductor", "specular_reflectance": 0.0}  # a delta lobe: no light sampling is spent on it


def lamps(mi: Any, room: Room) -> dict[str, Any]:
    """Globes and sheets as area emitters in the world, chosen in proportion to their power."""
    parts: dict[str, Any] = {}
    for k, globe in enumerate(room.globes):
        parts[f"globe{k}"] = {
            "type": "sphere", "to_world": mi.ScalarTransform4f(globe_pose(globe)), "bsdf": BLACK,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(map(float, globe.radiance))},
                        "sampling_weight": float(4 * np.pi * globe.radius_m**2 * globe.radiance.mean())},
        }  # fmt: skip
    for k, sheet in enumerate(room.sheets):
        area = np.linalg.norm(np.cross(sheet.right, sheet.down))
        parts[f"sheet{k}"] = {
            "type": "rectangle", "to_world": mi.ScalarTransform4f(sheet_pose(sheet)), "bsdf": BLACK,
            "emitter": {"type": "area", "radiance": texture(mi, sheet.radiance[::-1], "bilinear"),
                        "sampling_weight": float(area * sheet.radiance.mean())},
        }  # fmt: skip
    return parts


def globe_pose(globe: Any) -> Float[np.ndarray, "4 4"]:
    pose = np.diag([globe.radius_m] * 3 + [1.0])
    pose[:3, 3] = globe.centre
    return pose


def sheet_pose(sheet: Any) -> Float[np.ndarray, "4 4"]:
    """Mitsuba's rectangle spans [-1, 1]^2, glows towards +z, and has v = 0 at y = -1: the texture's last row."""
    # `flip_normals` would save the flip, but it turns only half of the emitter: light sampling stays behind.
    pose = np.eye(4)
    pose[:3, 0] = sheet.right / 2
    pose[:3, 1] = -sheet.down / 2
    front = np.cross(sheet.down, sheet.right)
    pose[:3, 2] = front / np.linalg.norm(front)
    pose[:3, 3] = sheet.corner + sheet.right / 2 + sheet.down / 2
    return pose
