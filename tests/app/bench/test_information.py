"""The bound's arithmetic, against Fisher informations worked out by hand and against estimates from drawn photographs."""

import numpy as np
import pytest

from app.bench.information import Scatter, expected_angle, information

SENSOR = Scatter(shot=0.0, floor=0.01, path=0.0)


def lambert(lights: np.ndarray, albedo: float) -> tuple[np.ndarray, np.ndarray]:
    """(radiance, derivatives by two tilts and the log of albedo) of a matt pixel that faces +z, one view per far lamp."""
    radiance = albedo / np.pi * lights[:, 2]
    jacobian = np.stack([albedo / np.pi * lights[:, 0], albedo / np.pi * lights[:, 1], radiance], -1)
    return np.tile(radiance[None, :, None], 3), np.tile(jacobian[None, :, None], (3, 1))


def test_a_matt_pixel_under_four_lamps_is_known_as_well_as_by_hand() -> None:
    s, c = 0.6, 0.8
    lights = np.array([[s, 0, c], [-s, 0, c], [0, s, c], [0, -s, c]])
    found = information(*lambert(lights, np.pi / 2), SENSOR)
    # Three channels; each tilt is seen by two lamps as 0.5 s, albedo by four as 0.5 c; opposite lamps part them.
    tilt, tint = 3 * 2 * (0.5 * s / 0.01) ** 2, 3 * 4 * (0.5 * c / 0.01) ** 2
    np.testing.assert_allclose(found[0], np.diag([tilt, tilt, tint]), rtol=1e-12, atol=1e-9)
    assert expected_angle(found)[0] == pytest.approx(np.sqrt(np.pi / 2 / tilt))


def test_shot_noise_counts_by_the_light() -> None:
    radiance, jacobian = np.full((1, 1, 3), 0.25), np.zeros((1, 1, 3, 1))
    jacobian[0, 0, 1, 0] = 2.0
    found = information(radiance, jacobian, Scatter(0.04, 0.1, 0.0))
    assert found[0, 0, 0] == pytest.approx(2.0**2 / (0.04 * 0.25 + 0.1**2))


def test_noise_that_channels_share_counts_once_and_not_in_their_differences() -> None:
    radiance = np.full((1, 1, 3), 0.5)
    alike, apart = np.ones((1, 1, 3, 1)), np.array([1.0, -1.0, 0.0]).reshape(1, 1, 3, 1)
    scatter = Scatter(0.0, 0.0, path=0.2, shared=0.75)
    variance = 0.2**2 * 0.5 * 0.5
    # Eigenvalues of variance x (1/4 on the diagonal, 3/4 everywhere): 2.5 along (1, 1, 1), 0.25 across.
    assert information(radiance, alike, scatter)[0, 0, 0] == pytest.approx(3 / (2.5 * variance))
    assert information(radiance, apart, scatter)[0, 0, 0] == pytest.approx(2 / (0.25 * variance))


def test_the_path_tracers_noise_is_relative_to_the_pixels_mean() -> None:
    radiance, jacobian = np.array([0.1, 0.3]).reshape(1, 2, 1).repeat(3, 2), np.zeros((1, 2, 3, 1))
    jacobian[0, 1, 0, 0] = 1.0
    found = information(radiance, jacobian, Scatter(0.0, 0.0, 0.015, shared=0.0))
    assert found[0, 0, 0] == pytest.approx(1 / (0.015**2 * 0.2 * 0.3))


def test_a_view_in_which_a_pixel_is_all_but_dark_tells_no_more_than_a_dim_one() -> None:
    jacobian = np.zeros((1, 2, 3, 1))
    jacobian[0, 1, 0, 0] = 1.0
    told = []
    for dim in (1e-9, 0.1, 1.0):
        radiance = np.array([2 - dim, dim]).reshape(1, 2, 1).repeat(3, 2)
        told.append(information(radiance, jacobian, Scatter(0.0, 0.0, 0.015))[0, 0, 0])
    assert told[0] == pytest.approx(told[1])
    assert told[1] == pytest.approx(10 * told[2])


def test_the_mean_angle_is_that_of_drawn_tilts() -> None:
    covariance = np.array([[[4.0, 1.5], [1.5, 1.0]]]) * 1e-4
    drawn = np.random.default_rng(0).multivariate_normal([0, 0], covariance[0], 200_000)
    want = np.linalg.norm(drawn, axis=1).mean()
    assert expected_angle(np.linalg.inv(covariance))[0] == pytest.approx(want, rel=5e-3)


def test_other_unknowns_that_look_alike_make_a_normal_uncertain() -> None:
    alone = np.diag([1e4, 1e4, 1e4])[None]
    mixed = alone.copy()
    mixed[0, 0, 2] = mixed[0, 2, 0] = 9e3
    # The tilt's variance becomes 1 / (1e4 - 9e3^2 / 1e4): 5.26 times as large.
    assert expected_angle(mixed)[0] > 1.5 * expected_angle(alone)[0]
    assert expected_angle(mixed)[0] < np.sqrt(5.27) * expected_angle(alone)[0]


def test_where_nothing_is_known_a_normal_is_a_right_angle_off() -> None:
    assert expected_angle(np.zeros((1, 6, 6)))[0] == pytest.approx(np.pi / 2)


def test_no_estimate_from_drawn_photographs_beats_the_bound() -> None:
    rng = np.random.default_rng(1)
    lights = rng.normal(size=(40, 3)) * [1, 1, 0.3] + [0, 0, 1.5]
    radiance, jacobian = lambert(lights / np.linalg.norm(lights, axis=1, keepdims=True), 0.6)
    scatter = Scatter(1e-5, 1e-4, 0.015)
    bound = expected_angle(information(radiance, jacobian, scatter))[0]
    traced = scatter.path**2 * radiance.mean(1, keepdims=True) * radiance
    common, single = rng.normal(size=(4000, 40, 1)), rng.normal(size=(2, 4000, 40, 3))
    noise = np.sqrt(traced) * (np.sqrt(0.8) * common + np.sqrt(0.2) * single[0])
    noise = noise + np.sqrt(scatter.shot * radiance + scatter.floor**2) * single[1]
    covariance = (
        0.8 * np.sqrt(traced[..., None] * traced[..., None, :])
        + np.eye(3) * (0.2 * traced + scatter.shot * radiance + scatter.floor**2)[..., None]
    )[0]
    weighed = np.linalg.solve(covariance, jacobian[0])
    best = np.einsum("ncu,pnc->pu", weighed, noise) @ np.linalg.inv(
        np.einsum("ncu,ncw->uw", jacobian[0], weighed)
    )
    plain = noise.reshape(4000, -1) @ np.linalg.pinv(jacobian[0].reshape(-1, 3)).T
    assert np.linalg.norm(best[:, :2], axis=1).mean() == pytest.approx(bound, rel=0.03)
    assert np.linalg.norm(plain[:, :2], axis=1).mean() > 1.0 * bound
