"""One pad on springs against a plane: open, sticking, sliding, and no creep."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from hands import ENDPOINT, PAD, RADIUS, compliance_of, constant_targets, floor, pressing_finger, simulate, sprung_tip

from icjax.synthesis import QuasiStaticHand, Target

EXACT = 1e-12  # rounding of a few dozen operations on numbers of order one


def targets_of(model, rows):
    return constant_targets(model, np.asarray(rows, float))


def test_open_contact_follows_the_reference():
    model = sprung_tip()
    _, info = simulate(model, floor(0.5), targets_of(model, [[0.0, 0.0, 0.02], [0.01, -0.01, RADIUS + 1e-6]]))
    np.testing.assert_array_equal(info.contact_force, 0.0)
    np.testing.assert_allclose(info.q, info.reference, atol=EXACT)
    np.testing.assert_array_equal(info.slip_state, 0)
    np.testing.assert_allclose(info.gap[:, 0], [0.02 - RADIUS, 1e-6], atol=EXACT)


@pytest.mark.parametrize("pad", [PAD, 0.0])
def test_pressing(pad):
    """f_n = depth / (c + c_pad); the spring takes c f_n of the depth, the pad the rest."""
    model, depth = sprung_tip(pad=pad), 0.01
    _, info = simulate(model, floor(0.5), targets_of(model, [[0.0, 0.0, 0.02], [0.0, 0.0, RADIUS - depth]]))
    force = depth / (ENDPOINT + pad)
    np.testing.assert_allclose(info.contact_force[1, 0], [0.0, 0.0, force], atol=EXACT)
    np.testing.assert_allclose(info.q[1, 2], RADIUS - depth + ENDPOINT * force, atol=EXACT)
    np.testing.assert_allclose(info.gap[1, 0], -pad * force, atol=EXACT)
    np.testing.assert_allclose(info.equilibrium_error, 0.0, atol=EXACT)
    assert np.all(np.asarray(info.status) == 0)


@pytest.mark.parametrize("facets", [2, 4, 8])
def test_stick_then_slide(facets):
    """Sticking f_t = moved / (c + c_pad) up to mu f_n along a tangent of the cone, then mu f_n."""
    model, depth, friction = sprung_tip(), 0.01, 0.4
    path = np.linspace(0.0, 0.0081, 41)  # no step ends exactly where sliding begins
    rows = np.stack([path, np.zeros(41), np.full(41, RADIUS - depth)], axis=1)
    _, info = simulate(model, floor(friction, facets), targets_of(model, rows))
    normal = depth / (ENDPOINT + PAD)
    expected = -np.minimum(path / (ENDPOINT + PAD), friction * normal)
    np.testing.assert_allclose(info.contact_force[:, 0, 2], normal, atol=EXACT)
    np.testing.assert_allclose(info.contact_force[:, 0, 0], expected, atol=EXACT)
    np.testing.assert_allclose(info.q[:, 0], path + ENDPOINT * expected, atol=EXACT)
    sticking = path / (ENDPOINT + PAD) < friction * normal
    np.testing.assert_array_equal(info.slip_state[:, 0], np.where(sticking, 1, 2))


def test_sliding_between_facets():
    """Maximum dissipation over the polygon: pulled midway between two tangents the force is one of its corners."""
    model, depth, friction, facets = sprung_tip(), 0.01, 0.4, 2
    angle = np.deg2rad(30.0)  # tangents at 0 and 90 degrees
    path = np.linspace(0.0, 0.05, 101)
    rows = np.stack([path * np.cos(angle), path * np.sin(angle), np.full(101, RADIUS - depth)], axis=1)
    _, info = simulate(model, floor(friction, facets), targets_of(model, rows))
    force, limit = np.asarray(info.contact_force[:, 0]), friction * depth / (ENDPOINT + PAD)
    assert np.all(np.abs(force[:, 0]) + np.abs(force[:, 1]) <= limit + EXACT)
    np.testing.assert_allclose(force[-1, :2], [-limit, 0.0], atol=EXACT)


def test_release_forgets_the_tangential_force():
    model = sprung_tip()
    low, high = RADIUS - 0.01, RADIUS + 0.01
    rows = [[0.0, 0.0, low], [0.002, 0.0, low], [0.002, 0.0, high], [0.002, 0.0, low]]
    _, info = simulate(model, floor(0.9), targets_of(model, rows))
    force = np.asarray(info.contact_force[:, 0, 0])
    np.testing.assert_allclose(force, [0.0, -0.002 / (ENDPOINT + PAD), 0.0, 0.0], atol=EXACT)


def test_stuck_fingertip_keeps_its_force_for_ten_seconds():
    model, steps = sprung_tip(), 5000
    part = np.minimum(np.arange(steps) / 100.0, 1.0)
    rows = np.stack([0.003 * part, -0.001 * part, np.full(steps, RADIUS - 0.01)], axis=1)
    scene = floor(0.9)
    _, info = simulate(model, scene, targets_of(model, rows))
    assert steps * scene.step == pytest.approx(10.0)
    expected = -np.array([0.003, -0.001]) / (ENDPOINT + PAD)
    np.testing.assert_allclose(info.contact_force[100:, 0, :2], np.tile(expected, (4900, 1)), atol=1e-10)


def test_stuck_finger_of_hinges_does_not_creep():
    """Two seconds at rest after a stroke: the linearisation settles, then nothing moves."""
    model, moving, height = pressing_finger(100, stroke=0.003)
    rows = np.concatenate([moving, np.tile(moving[-1], (1000, 1))])
    _, info = simulate(model, floor(1.5, height=height), constant_targets(model, rows))
    force = np.asarray(info.contact_force[:, 0])
    assert abs(force[-1, 0]) > 0.05  # N: a force worth keeping
    np.testing.assert_allclose(force[200:], np.tile(force[-1], (900, 1)), atol=1e-9)
    np.testing.assert_allclose(info.equilibrium_error[-1], 0.0, atol=1e-9)


def test_driven_coordinates_follow_their_reference_exactly():
    model, rows, height = pressing_finger(50, stroke=0.01)
    _, info = simulate(model, floor(0.5, height=height), constant_targets(model, rows))
    assert np.max(np.asarray(info.contact_force)[..., 2]) > 0.1
    np.testing.assert_allclose(info.q[:, :2], rows[:, :2], atol=EXACT)


def test_forces_stay_in_their_cone_and_rows_agree():
    """Cone about the reported normal, no tension, torque = J^T f, Eq. 7 with the reported error."""
    model, rows, height = pressing_finger(80, stroke=0.02)
    scene, friction = floor(0.4, height=height), 0.4
    state, info = simulate(model, scene, constant_targets(model, rows))
    force, normal = np.asarray(info.contact_force), np.asarray(info.contact_normal)
    along = np.sum(force * normal, axis=-1)
    across = np.linalg.norm(force - along[..., None] * normal, axis=-1)
    assert np.all(along >= -EXACT)
    assert np.all(across <= friction * along + EXACT)
    assert set(np.unique(info.slip_state)) == {0, 2} or set(np.unique(info.slip_state)) == {0, 1, 2}
    torque = np.einsum("iad,ia->d", state.contacts.jacobian, force[-1])
    np.testing.assert_allclose(info.torque[-1], torque, atol=EXACT)
    deviation = np.asarray(info.q[-1]) - rows[-1]  # slides and hinges only
    np.testing.assert_allclose(
        deviation + np.asarray(info.equilibrium_error[-1]), compliance_of(model) * torque, atol=EXACT
    )


def test_the_massless_limit_of_the_dynamic_hand():
    """h S^-1 [M v + h K (theta_r - q) + ...] and h^2 S^-1, S = M + h B + h^2 K, go to the quasi-static hand."""
    model, rows, _ = pressing_finger(2)
    compliance = compliance_of(model)[2:]
    stiffness, h, q = np.diag(1 / compliance), 0.002, rows[0] + 0.05
    hand = QuasiStaticHand(model).admittance(
        jnp.asarray(q), Target(reference=jnp.asarray(rows[1]), compliance=jnp.asarray(compliance_of(model)))
    )
    errors = []
    for scale in (1e-6, 1e-7):  # of inertia and damping; 1e-6 kg m^2 is 25 times h^2 K
        inertia, damping = scale * np.eye(4), scale * np.eye(4)
        S = inertia + h * damping + h**2 * stiffness
        errors.append(np.max(np.abs(h**2 * np.linalg.inv(S) - hand.matrix[2:, 2:])))
        free = h * np.linalg.solve(S, h * stiffness @ (rows[1] - q)[2:])
        errors.append(np.max(np.abs(free - hand.free[2:])))
    assert errors[2] < 0.2 * errors[0]
    assert errors[3] < 0.2 * errors[1]
    S = h**2 * stiffness
    np.testing.assert_allclose(h**2 * np.linalg.inv(S), hand.matrix[2:, 2:], atol=EXACT)


def test_penetration_at_the_start_is_pushed_out():
    model = sprung_tip()
    state, info = simulate(model, floor(0.5), targets_of(model, [[0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(info.contact_force[0, 0, 2], RADIUS / (ENDPOINT + PAD), atol=EXACT)
    np.testing.assert_allclose(state.q[2], ENDPOINT * RADIUS / (ENDPOINT + PAD), atol=EXACT)


def test_no_pads_is_an_error():
    model = sprung_tip()

    bare = dataclasses.replace(
        model,
        pad_names=(),
        pad_bodies=(),
        pad_centre=np.zeros((0, 3)),
        pad_radius=np.zeros(0),
        pad_compliance=np.zeros(0),
    )
    with pytest.raises(ValueError, match="has no contact pads"):
        simulate(bare, floor(0.5), constant_targets(model, np.zeros((2, 3))))
