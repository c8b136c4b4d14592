"""The shared paths agree with a plain path trace, and the room's lookup with Mitsuba's own."""

from dataclasses import replace

import numpy as np
import pytest

from hardware.virtual.studio import (
    bake,
    glow,
    mirror,
    motion,
    objects,
    relight,
    render,
    rooms,
    samples,
    solids,
    tracer,
    truth,
)

X, Y, Z = np.eye(3)


@pytest.fixture(scope="module")
def mi():
    mi = tracer.load("cpu")
    if not tracer.is_vectorised(mi):
        pytest.skip("no libLLVM here: objects are path-traced plainly")
    return mi


def nook() -> tuple[rooms.Room, bake.Atlas]:
    """A small room with a globe, an even sheet, a sheet with a picture, and a board before the lamps."""
    rng = np.random.default_rng(5)
    panels = []
    for normal in (X, -X, Y, -Y, Z, -Z):
        up = Y if abs(normal[2]) > 0 else Z
        right = np.cross(up, normal)
        corner = -normal - right + up
        panels.append(rooms.Panel(corner, 2 * right, -2 * up, rng.uniform(0.1, 0.9, (24, 24, 3))))
    board = rng.uniform(0.1, 0.9, (6, 9, 3))
    panels.append(rooms.Panel(np.array([-0.1, -0.5, 0.75]), 0.5 * X, 0.3 * Y, board))
    globe = rooms.Globe(np.array([0.6, 0.1, 0.4]), 0.07, np.array([40.0, 30.0, 20.0]))
    even = np.full((4, 4, 3), 6.0)
    sky = rng.uniform(0.0, 12.0, (12, 10, 3))
    sheets = (
        rooms.Sheet(np.array([-0.5, -0.4, 0.97]), 0.8 * X, 0.7 * Y, even),
        rooms.Sheet(np.array([-0.98, -0.4, 0.3]), 0.7 * Y, -0.6 * Z, sky),
    )
    room = rooms.Room("nook", tuple(panels), (globe,), sheets, np.zeros(3))
    return room, bake.pack(room.panels, [p.albedo.astype(np.float32) for p in panels])


def cup(roughness: float, metal: float | None = None) -> objects.Body:
    """A deep bowl, opening towards the camera: what it reflects meets it again. Of paint, or so much of it metal."""
    t = np.linspace(0, np.pi / 2, 24)
    outer = np.stack([0.1 * np.sin(t), 0.1 * np.cos(t)], 1)
    inner = np.stack([0.085 * np.sin(t[::-1]), 0.085 * np.cos(t[::-1])], 1)
    solid = solids.lathe(np.concatenate([outer, inner]), 48, lambda r, _: r + 0 * _, crease_deg=50.0)
    tilted = motion.turn(X, np.zeros(3), 0.4)[:, :3]
    solid = solids.moved(solid, tilted, np.array([0.0, 0.0, 0.45]))
    count = len(solid.vertices)
    metalness = None if metal is None else np.full(count, metal)
    albedo = np.full((count, 3), [0.8, 0.7, 0.5])
    return objects.Body(
        "cup", solid, albedo, np.full(count, roughness), metalness, 0.5 if metal is None else 0.9
    )


POSES = np.stack([
    np.column_stack([motion.turn(np.array(axis), np.zeros(3), angle)[:, :3], [0.0, 0.0, 0.25]])
    for axis, angle in (((1.0, 0.3, 0.0), 0.5), ((0.2, 1.0, -0.4), 2.4))
])  # fmt: skip


def on_a_polished_floor(room: rooms.Room) -> rooms.Room:
    """The room standing on z = 0, which mirrors."""
    raised = {
        "panels": tuple(replace(panel, corner=panel.corner + Z) for panel in room.panels),
        "globes": tuple(replace(globe, centre=globe.centre + Z) for globe in room.globes),
        "sheets": tuple(replace(sheet, corner=sheet.corner + Z) for sheet in room.sheets),
    }
    return replace(room, centre=room.centre + Z, polish=0.5, **raised)


@pytest.mark.parametrize("polished", [False, True])
def test_rays_meet_what_mitsubas_own_room_shows(mi, polished: bool):
    room, atlas = nook()
    room, atlas = mirror.reflected(on_a_polished_floor(room) if polished else room, atlas)
    plain = render.Backdrop(room, atlas, "cpu").scene
    import drjit as dr

    noise = mi.PCG32(20000)
    origin = (mi.Vector3f(noise.next_float32(), noise.next_float32(), noise.next_float32()) - 0.5) * 0.8
    origin += mi.Vector3f(room.centre)
    aim = mi.warp.square_to_uniform_sphere(mi.Point2f(noise.next_float32(), noise.next_float32()))
    dr.eval(origin, aim)
    ray = mi.Ray3f(mi.Point3f(origin), aim)
    met = plain.ray_intersect(ray)
    truly = np.array(met.emitter(plain).eval(met)).T
    seen = glow.Glow(mi, room, atlas).look(ray)
    off = np.abs(np.array(seen.radiance).T - truly).max(1) > 2e-3 * (0.1 + truly.max(1))
    # Rounding moves a ray in ten thousand across an edge.
    assert off.mean() < 5e-4
    assert np.array(seen.is_lamp).mean() > 0.02


def test_aimed_rays_meet_their_lamp_with_the_stated_density(mi):
    room, atlas = nook()
    lights = glow.Glow(mi, room, atlas)
    noise = mi.PCG32(4000)
    point = (
        mi.Point3f(0.2 * noise.next_float32(), 0.2 * noise.next_float32(), 0.2 * noise.next_float32()) - 0.1
    )
    import drjit as dr

    dr.eval(point)
    for lamp in range(3):
        u = mi.Point2f(noise.next_float32(), noise.next_float32())
        dr.eval(u)
        aim = lights.aim(mi.UInt32(lamp), point, u)
        seen = lights.look(mi.Ray3f(point, aim.direction))
        clear = np.array(lights.arriving(point, None, aim, True)[0])
        mine = np.array(seen.is_lamp) & (np.array(seen.lamp) == lamp)
        assert (clear == mine).mean() > 0.995
        both = clear & mine
        assert both.mean() > 0.3
        np.testing.assert_allclose(np.array(seen.density)[both], np.array(aim.density)[both], rtol=2e-3)
        found = np.array(seen.radiance).T[both]
        np.testing.assert_allclose(found, np.array(aim.radiance).T[both], rtol=5e-3, atol=5e-3)


@pytest.mark.parametrize(("roughness", "metal"), [(0.2, None), (0.5, 0.6)])
def test_shared_paths_have_the_mean_of_plain_ones(mi, roughness, metal):
    room, atlas = nook()
    body = cup(roughness, metal)
    mask = truth.maps(body, 24, 18)["mask"]
    plain = render.Foreground(room, atlas, body, mask, "cpu")
    lit = relight.Relighter(glow.Glow(mi, room, atlas), body, mask)
    effort = samples.Effort(64, 32, (16, 16, 32))
    fast = np.stack([lit.look(POSES, effort, seed, lambda _: None) for seed in range(8)]).mean(-1)
    slow = np.stack([[plain.look(p, 512, 100 * s + i) for i, p in enumerate(POSES)] for s in range(8)]).mean(
        -1
    )
    gap = fast.mean(0) - slow.mean(0)
    error = np.sqrt((fast.var(0, ddof=1) + slow.var(0, ddof=1)) / 8)
    assert mask.sum() > 40
    for view in range(2):
        bias = gap[view].mean() / slow[:, view].mean()
        assert abs(bias) < 0.01
        # Differences of two means of 8, in their own standard errors: nearly all within 4.
        assert (np.abs(gap[view]) < 4 * error[view] + 1e-6).mean() > 0.95
        z = gap[view].sum() / np.sqrt((error[view] ** 2).sum())
        assert abs(z) < 4


def test_noise_falls_faster_than_that_of_independent_samples(mi):
    room, atlas = nook()
    body = cup(0.5)
    mask = truth.maps(body, 16, 12)["mask"]
    lit = relight.Relighter(glow.Glow(mi, room, atlas), body, mask)

    def noise(n: int) -> float:
        effort = samples.Effort(n, n, (n, n, n))
        return float(
            np.stack([lit.look(POSES[:1], effort, s, lambda _: None) for s in range(8)]).std(0, ddof=1).mean()
        )

    assert noise(128) < noise(8) / 16**0.5


def test_effort_has_samples_for_every_lamp():
    room, _ = nook()
    for count in (8, 256):
        effort = samples.plan(room, count)
        assert len(effort.aimed) == 3
        assert all(n > 0 and n & (n - 1) == 0 for n in (effort.diffuse, effort.glossy, *effort.aimed))


def test_counts_go_where_the_noise_is_and_reach_the_target():
    touched = np.ones((40, 40), bool)
    noise = np.full(touched.shape, 0.02)
    noise[:, 20:] = 0.16
    counts = samples.needed(noise[touched], touched, 0.015).reshape(40, 40)
    assert (counts & (counts - 1) == 0).all()
    assert counts[:, 25:].min() > 2 * counts[:, :15].max()
    left = noise * (counts / samples.PILOT) ** -samples.FALL
    assert 0.7 < left.mean() / 0.015 < 1.2


def test_the_stated_noise_is_that_of_independent_pictures(mi):
    room, atlas = nook()
    body = cup(0.5)
    mask = truth.maps(body, 24, 18)["mask"]
    lit = relight.Relighter(glow.Glow(mi, room, atlas), body, mask)
    effort = samples.Effort(16, 16, (16, 16, 16))
    stated = np.sqrt(np.square([lit.noise(POSES, effort, 2 * s, lambda _: None) for s in range(6)]).mean(0))
    pictures = np.stack([lit.look(POSES, effort, 100 + s, lambda _: None).mean(-1) for s in range(12)])
    found = np.sqrt(pictures.var(0, ddof=1).mean(0)) / pictures.mean((0, 1))
    assert 0.8 < stated.mean() / found.mean() < 1.25


def test_some_of_the_pixels_are_as_bright_as_among_all(mi):
    room, atlas = nook()
    body = cup(0.5)
    mask = truth.maps(body, 24, 18)["mask"]
    lit = relight.Relighter(glow.Glow(mi, room, atlas), body, mask)
    effort = samples.Effort(256, 256, (64, 64, 64))
    some = np.arange(mask.sum())[::3]
    whole, part = lit.look(POSES, effort, 3, lambda _: None), lit.look(POSES, effort, 4, lambda _: None, some)
    assert abs(part.mean() / whole[:, some].mean() - 1) < 0.01
    np.testing.assert_allclose(part.mean((0, 2)), whole[:, some].mean((0, 2)), rtol=0.2)
