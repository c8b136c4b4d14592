"""What the light rests on, in rooms where it is known."""

from dataclasses import replace

import numpy as np
import pytest

from engine.light.fitting.lamp_model import with_lamps
from engine.light.gaussians.gaussians import joined, part
from engine.light.incident.coverage import coverage_of, covered
from engine.light.incident.probes import panorama, panorama_directions
from engine.light.incident.provenance import CLIPPED, GUESSED, PHOTOGRAPHED, photographed, provenance_of
from engine.light.incident.unseen_patches import unseen_patches
from engine.types import Camera, Emitters, Frames, Gaussians, Lamps, Masks, Panorama, Poses
from tests.engine.light import clouds

SIDE, HEIGHT = 32, 48
CAMERA = Camera(SIDE, SIDE, SIDE / 2, SIDE / 2, SIDE / 2, SIDE / 2)  # 90 degrees across
AHEAD = np.array([[0.0, 0, 1]])
UPWARD = np.array([[0.0, -1, 0]])


def views(
    background: np.ndarray, clipped: np.ndarray, turns: tuple[float, ...]
) -> tuple[Frames, Masks, Poses]:
    """Views from the origin, turned about the vertical by so many degrees, 0 being along +z."""
    poses = np.zeros((len(turns), 3, 4))
    for i, angle in enumerate(np.radians(turns)):
        c, s = np.cos(angle), np.sin(angle)
        poses[i, :, :3] = [[c, 0, -s], [0, 1, 0], [s, 0, c]]
    shape = (len(turns), SIDE, SIDE)
    frames = Frames(
        tuple(map(str, turns)), np.ones((*shape, 3), np.float32), clipped, np.zeros(shape, bool), (0.0, 0.0)
    )
    return (
        frames,
        Masks(np.zeros((SIDE, SIDE), bool), background),
        Poses(CAMERA, poses, np.ones(len(turns), bool), np.zeros((0, 3)), "given", 0.0),
    )


def everywhere(turns: int, value: bool) -> np.ndarray:
    return np.full((turns, SIDE, SIDE), value)


def classes(
    room: Gaussians, frames: Frames, masks: Masks, poses: Poses, unseen: Gaussians | None = None
) -> np.ndarray:
    """The class of every direction of a panorama at the origin; `unseen` are patches beside the room."""
    nothing = Lamps(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0, bool))
    whole = room if unseen is None else joined(room, unseen)
    emitters = Emitters(whole, nothing, 0 if unseen is None else len(unseen.means))
    radiance, opacity = panorama(emitters.gaussians, np.zeros(3), np.eye(3), HEIGHT, fill=True)
    shown, clipped = photographed(
        emitters.photographed(), np.zeros(3), np.eye(3), HEIGHT, frames, masks, poses
    )
    return provenance_of(Panorama("v", radiance, opacity * shown), clipped, AHEAD).kind


def cone(axis: tuple[float, float, float], widest: float) -> np.ndarray:
    """Directions within so many tangents of a face's middle, as a pinhole of 90 degrees sees them."""
    directions = panorama_directions(HEIGHT)
    x, y, z = np.moveaxis(directions @ np.array([np.cross([0, 1, 0], axis), [0, 1, 0], axis]).T, -1, 0)
    return (z > 0) & (np.maximum(abs(x), abs(y)) < widest * z)


def test_two_views_of_a_room_show_two_faces_of_it_and_the_rest_is_guessed():
    kind = classes(clouds.shell(2.0), *views(everywhere(2, True), everywhere(2, False), (0, 180)))
    inside = cone((0, 0, 1), 0.95) | cone((0, 0, -1), 0.95)
    outside = ~(cone((0, 0, 1), 1.05) | cone((0, 0, -1), 1.05))
    assert (kind[inside] == PHOTOGRAPHED).all()
    assert (kind[outside] == GUESSED).all()


def test_a_place_is_clipped_only_if_no_view_shows_it_unclipped():
    # Views ahead and 45 degrees aside; what is clipped ahead is clean aside where both look.
    clipped = everywhere(2, False)
    clipped[0] = True
    kind = classes(clouds.shell(2.0), *views(everywhere(2, True), clipped, (0, 45)))
    aside = (np.sin(np.radians(45)), 0, np.cos(np.radians(45)))
    assert (kind[cone((0, 0, 1), 0.95) & ~cone(aside, 1.1)] == CLIPPED).all()
    assert (kind[cone((0, 0, 1), 0.95) & cone(aside, 0.9)] == PHOTOGRAPHED).all()
    assert (kind[cone(aside, 0.9)] == PHOTOGRAPHED).all()


def test_a_hole_in_the_room_is_guessed_though_photographs_look_there():
    room = clouds.shell(2.0)
    kept = room.means[:, 2] < 3 * np.cos(np.radians(30))
    holed = type(room)(*(getattr(room, name)[kept] for name in type(room).__slots__))
    kind = classes(holed, *views(everywhere(2, True), everywhere(2, False), (0, 180)))
    assert (kind[cone((0, 0, 1), 0.1)] == GUESSED).all()
    assert (kind[cone((0, 0, -1), 0.9)] == PHOTOGRAPHED).all()


def test_patches_over_a_hole_do_not_make_it_photographed():
    room = clouds.shell(2.0)
    holed = part(room, room.means[:, 2] < 3 * np.cos(np.radians(50)))
    unseen = unseen_patches(holed, np.zeros(3))
    assert len(unseen.means) > 20
    # Both views look there: at the patches' places stands background of theirs.
    kind = classes(holed, *views(everywhere(2, True), everywhere(2, False), (0, 180)), unseen)
    assert (kind[cone((0, 0, 1), 0.5)] == GUESSED).all()
    assert (kind[cone((0, 0, -1), 0.9)] == PHOTOGRAPHED).all()


def test_lamps_are_photographed_and_patches_are_not():
    field, unseen = clouds.shell(2.0, count=20), clouds.shell(1.0, count=7)
    lamps = Lamps(np.array([[0, 0, 2.0]]), np.array([0.1]), np.ones((1, 3)), np.array([False]))
    found = Emitters(with_lamps(joined(field, unseen), lamps), lamps, 7).photographed()
    np.testing.assert_array_equal(found.means, np.concatenate([field.means, lamps.centres]))


def test_what_the_object_hides_in_every_view_is_guessed():
    background = everywhere(1, True)
    background[:, :, : SIDE // 2] = False  # the left half of the picture
    kind = classes(clouds.shell(2.0), *views(background, everywhere(1, False), (0,)))
    left = panorama_directions(HEIGHT)[..., 0] < -0.1
    assert (kind[left] == GUESSED).all()
    assert (kind[cone((0, 0, 1), 0.95) & (panorama_directions(HEIGHT)[..., 0] > 0.1)] == PHOTOGRAPHED).all()


def test_one_clipped_pixel_makes_its_whole_small_pixel_a_lower_bound():
    clipped = everywhere(1, False)
    clipped[0, 17, 17] = True
    frames, masks, poses = views(everywhere(1, True), clipped, (0,))
    small = coverage_of(masks, poses, SIDE // 4, frames.clipped)
    assert (~small.shown[0]).sum() == 1
    at = np.array([[3.5 / 16, 3.5 / 16, 1.0], [-0.5, 0.5, 1.0]])
    np.testing.assert_array_equal(covered(small, at), [0, 1])


def striped(kind: str) -> tuple[Panorama, np.ndarray]:
    """Radiance 1 all around and 3 below; the upper half guessed, or clipped."""
    below = panorama_directions(HEIGHT)[..., 1] > 0
    radiance = np.where(below[..., None], 3.0, 1.0) * np.ones(3)
    seen = below.astype(float) if kind == "guessed" else np.ones_like(below, float)
    return Panorama("v", radiance, seen), ~below


@pytest.mark.parametrize("kind", ["guessed", "lower_bound"])
def test_shares_of_the_irradiance_worked_by_hand(kind: str):
    # A normal upward gets the upper half alone; one ahead pi / 2 of either half: 1 of 1 + 3 is the upper one's.
    # Averaged over both normals: (pi + pi / 2) / (pi + 2 pi) = 1 / 2.
    light, upper = striped(kind)
    clipped = upper & (kind == "lower_bound")
    for normals, share in (
        (UPWARD, 1.0),
        (-UPWARD, 0.0),
        (AHEAD, 0.25),
        (np.concatenate([UPWARD, AHEAD]), 0.5),
    ):
        grounds = provenance_of(light, clipped, normals)
        assert getattr(grounds, kind) == pytest.approx(share, abs=2e-3)
        assert grounds.guessed + grounds.lower_bound == pytest.approx(share, abs=2e-3)


def test_a_direction_counts_whole_for_its_class_and_darkness_rests_on_nothing():
    light, upper = striped("guessed")
    for seen, answer in ((0.6, (0, 1)), (0.4, (1, 0))):
        grounds = provenance_of(
            replace(light, seen=np.full_like(light.seen, seen)), np.ones_like(upper), AHEAD
        )
        assert (grounds.guessed, grounds.lower_bound) == pytest.approx(answer)
    dark = provenance_of(replace(light, radiance=np.zeros_like(light.radiance)), upper, AHEAD)
    assert (dark.guessed, dark.lower_bound) == (0, 0)


def test_a_few_normals_stand_for_very_many():
    many = np.random.default_rng(0).normal(size=(5000, 3)) + [0, 0, -1.5]
    many = (many / np.linalg.norm(many, axis=1, keepdims=True))[np.argsort(many[:, 1])]
    light, upper = striped("guessed")
    directions = panorama_directions(HEIGHT)
    facing = np.stack([np.maximum(row @ many.T, 0).mean(1) for row in directions])
    power = facing * light.radiance[..., 0] * np.sqrt(1 - directions[..., 1] ** 2)
    share = power[upper].sum() / power.sum()
    assert provenance_of(light, np.zeros_like(upper), many).guessed == pytest.approx(share, abs=2e-3)
