"""Joint angles from markers made with the model itself: exact, with gaps, with noise of known size."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.capture._joint_angles import joint_angles
from icjax.capture._pose import marker_jacobian, marker_normal_equations, solve_poses
from icjax.capture._posture import posture_prior, prior_normal_equations, prior_rows
from icjax.capture._registration import rigid_registration
from icjax.model import frames, index_finger, integrate, neutral, site_positions
from icjax.spatial import rotation_exp

RATE = 500.0
MODEL = index_finger(0.19, "free")
SITES = tuple(range(len(MODEL.site_names)))
HINGES = slice(7, 11)


def movement(count=700, turn=0.0):
    """Slow strokes of all joints of a forearm that drifts, turned by any angle about a skew axis."""
    time = np.arange(count) / RATE
    dq = np.zeros((count, MODEL.nv))
    dq[:, :3] = turn * np.array([0.6, 0.0, 0.8]) + 0.05 * np.sin(2 * np.pi * 0.5 * time)[:, None]
    dq[:, 3:6] = [0.2, -0.1, 0.3] + 0.01 * np.cos(2 * np.pi * 0.4 * time)[:, None]
    dq[:, 6:] = np.array([0.1, 0.3, 0.4, 0.3]) + 0.2 * np.sin(2 * np.pi * 0.7 * time[:, None] + np.arange(4))
    q = np.asarray(jax.vmap(lambda d: integrate(MODEL, neutral(MODEL), d))(jnp.asarray(dq)))
    return q, np.array(jax.vmap(lambda item: site_positions(MODEL, item))(jnp.asarray(q)))


@pytest.mark.parametrize("turn", [0.0, 1.5, 3.1])
def test_exact_markers_give_the_angles_back(turn):
    q, markers = movement(turn=turn)
    found = joint_angles(MODEL, SITES, markers, RATE, 20.0, 0.001)
    middle = slice(60, -60)
    # The filter takes (0.7 / 25)^4 = 6e-7 of a 0.7 Hz movement, more near the ends of the record.
    np.testing.assert_allclose(found.q[middle, HINGES], q[middle, HINGES], atol=2e-6)
    assert np.nanmax(found.residual[middle]) < 2e-6
    assert found.valid.all()


def test_gaps_are_bridged_without_a_jump_although_markers_sit_beside_their_sites():
    q, markers = movement()
    rng = np.random.default_rng(0)
    displaced = markers + 0.0005 * rng.normal(size=(1, *markers.shape[1:]))
    broken = displaced.copy()
    for marker in range(len(SITES)):
        start = 40 + 37 * marker
        broken[start : start + 14, marker] = np.nan
    whole = joint_angles(MODEL, SITES, displaced, RATE, 20.0, 0.001)
    gappy = joint_angles(MODEL, SITES, broken, RATE, 20.0, 0.001)
    masked = solve_poses(MODEL, SITES, broken, np.ones(broken.shape[:2])).q
    without = solve_poses(MODEL, SITES, displaced, np.ones(broken.shape[:2])).q
    # Left out, a marker half a millimetre beside its site turns its segment by degrees. Bridged, the mean place that
    # stands for it depends a little on the posture: a tenth of a degree.
    assert np.degrees(np.abs(masked - without)[:, HINGES]).max() > 1.0
    assert np.degrees(np.abs(gappy.q - whole.q)[:, HINGES]).max() < 0.15
    np.testing.assert_array_equal(np.isnan(gappy.residual), np.isnan(broken).any(axis=-1))
    assert gappy.valid.all()


def test_a_segment_that_loses_its_markers_for_long_is_not_valid():
    _, markers = movement()
    distal = [index for index, name in enumerate(MODEL.site_names) if name.startswith("DP")]
    markers[200:300, distal] = np.nan
    found = joint_angles(MODEL, SITES, markers, RATE, 20.0, 0.001)
    np.testing.assert_array_equal(~found.valid, (np.arange(700) >= 200) & (np.arange(700) < 300))
    assert np.isfinite(found.q).all()
    assert np.isfinite(found.covariance).all()
    assert np.sqrt(found.covariance[250, -1, -1]) > 1.0  # rad: unknown


def test_the_covariance_is_that_of_the_errors():
    q, markers = movement(4000)
    noisy = markers + 0.0003 * np.random.default_rng(1).normal(size=markers.shape)
    found = joint_angles(MODEL, SITES, noisy, RATE, 20.0, 0.001)
    scaled = (found.q - q)[:, HINGES] / np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)[:, 6:])
    # A 20 Hz band holds some 320 independent samples in 8 s: their RMS is known to 4 %.
    np.testing.assert_allclose(np.sqrt(np.mean(scaled**2, axis=0)), 1.0, atol=0.15)


def test_misplaced_markers_leave_the_offset_that_is_stated():
    q, markers = movement(60)
    scaled = []
    for seed in range(40):
        beside = 0.0003 * np.random.default_rng(seed).normal(size=(1, *markers.shape[1:]))
        found = joint_angles(MODEL, SITES, markers + beside, RATE, 20.0, 0.0003)
        scaled.append(np.mean(found.q - q, axis=0)[HINGES] / found.offset_sd[6:])
    # 40 draws of four correlated angles: RMS 1 to about 8 %.
    assert 0.75 < np.sqrt(np.mean(np.square(scaled))) < 1.25


def test_registration_is_exact_and_never_a_mirror_image():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(4, 3))
    R = np.asarray(rotation_exp(jnp.asarray(rng.normal(size=3))))
    found, p = rigid_registration(points, points @ R.T + [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found, R, atol=1e-12)
    np.testing.assert_allclose(p, [1, 2, 3], atol=1e-12)
    mirrored, _ = rigid_registration(points, points * [1, 1, -1])
    assert np.linalg.det(mirrored) > 0


def test_the_normal_equations_are_those_of_the_jacobian():
    """Composite sums against J^T J, far from the world's origin, where they would cancel about it."""
    random = np.random.default_rng(7)
    q = np.array(integrate(MODEL, neutral(MODEL), random.normal(size=MODEL.nv)))
    q[:3] += 3.0
    bodies = np.asarray(MODEL.site_bodies)
    at = frames(MODEL, q)
    poses = at.bodies(MODEL, bodies)
    points = np.einsum("sij,sj->si", poses.rotation, MODEL.site_position) + poses.position
    misfit, weight = 0.01 * random.normal(size=points.shape), random.random(len(points))
    J = np.asarray(marker_jacobian(MODEL, bodies, at.twists, points)).reshape(-1, MODEL.nv)
    each = np.repeat(weight, 3)
    cost, H, g = marker_normal_equations(MODEL, bodies, at.twists, points, misfit, weight)
    np.testing.assert_allclose(H, J.T @ (each[:, None] * J), atol=1e-12)
    np.testing.assert_allclose(g, J.T @ (each * misfit.reshape(-1)), atol=1e-13)
    np.testing.assert_allclose(cost, each @ misfit.reshape(-1) ** 2, rtol=1e-12)


def test_the_normal_equations_of_a_prior_are_those_of_its_rows():
    prior = posture_prior(MODEL, 0.002, sd=0.5, limit_sd=0.1, couplings={"DIP": ("PIP", 0.67, 0.1)})
    q = np.array(neutral(MODEL))
    q[HINGES] = [2.0, -0.1, 0.5, 3.0]
    r, J = prior_rows(MODEL, prior, q)
    assert np.count_nonzero(r[-4:]) >= 2
    cost, H, g = prior_normal_equations(MODEL, prior, q)
    np.testing.assert_allclose(H, J.T @ J, atol=1e-15)
    np.testing.assert_allclose(g, J.T @ r, atol=1e-15)
    np.testing.assert_allclose(cost, r @ r, rtol=1e-12)
