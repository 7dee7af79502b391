"""The admittance step against Eq. 10 and the matrix of Section 7.1.3, written out once more here."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from hands import compliance_of, constant_targets, floor, pressing_finger

from icjax import lcp
from icjax.model import forward_kinematics, pad_positions, point_jacobian
from icjax.synthesis import Target, init, step

EXACT = 1e-12  # rounding: both solve the same small problem with numbers of order one


def equation_10_step(model, scene, q, contact_point, force_before, reference_before, reference, friction):
    """theta(k+1) and f(k+1) from Eq. 10 for constant C, a fixed floor and m = 4 tangent pairs.

    Replaced contact points: the joint displacement that the translated forces cause is added to the change of the
    reference, as the end of Section 7.1.3 says.
    """
    C = np.diag(compliance_of(model))
    pad = float(model.pad_compliance[0])
    body = model.pad_bodies[0]
    J = np.asarray(JACOBIAN(model, jnp.asarray(q), body, jnp.asarray(contact_point)))
    n = np.array([0.0, 0.0, 1.0])
    G = J @ C @ J.T
    equilibrium = reference_before + C @ J.T @ force_before
    change = (reference - reference_before) + (equilibrium - q)  # Delta theta_r and the correction
    tangential = force_before - n * (n @ force_before)
    angles = np.pi * np.arange(4) / 4
    D = np.stack([n] + [s * np.array([np.cos(a), np.sin(a), 0.0]) for a in angles for s in (1, -1)], axis=1)
    E = np.concatenate([[0.0], -np.ones(8)])
    F = np.concatenate([[friction], -np.ones(8)])
    height = float(scene.surfaces[0].shape.point[2])
    gap = float(PADS(model, jnp.asarray(q))[0, 2]) - float(model.pad_radius[0]) - height
    M = np.zeros((10, 10))
    M[:9, :9], M[:9, 9], M[9, :9] = D.T @ (G + pad * np.eye(3)) @ D, -E, F
    s = D.T @ (J @ change - G @ force_before - pad * tangential)
    s[0] += gap
    solution = SOLVE(M, np.concatenate([s, [0.0]]), throw=True)
    force = D @ np.asarray(solution.value)[:9]
    # theta(k+1) from the linearised equilibrium about the corrected theta_r(k+1); J of step k
    return force, q + change + C @ J.T @ (force - force_before)


@pytest.mark.slow
def test_step_equals_equation_10():
    for friction in (0.3, 1.5):  # slides, sticks
        check_steps(friction)


def check_steps(friction):
    model, rows, height = pressing_finger(25, stroke=0.01)
    scene = floor(friction, height=height)
    targets = constant_targets(model, rows)
    state = INIT(model, scene, targets.reference[0])
    loaded = 0
    for k in range(1, 25):
        q = np.asarray(state.q)
        rotation = np.asarray(POSES(model, state.q).rotation[model.pad_bodies[0]])
        before = rotation @ np.asarray(state.pad_force[0])
        force, expected = equation_10_step(
            model,
            scene,
            q,
            np.asarray(state.contacts.point[0]),
            before,
            rows[k - 1],
            rows[k],
            friction,
        )
        target = Target(reference=targets.reference[k], compliance=targets.compliance[k])
        state, info = STEP(model, scene, state, target)
        np.testing.assert_allclose(info.contact_force[0], force, atol=EXACT)
        np.testing.assert_allclose(state.q, expected, atol=EXACT)
        loaded += np.linalg.norm(before) > 0
    assert loaded > 10


def test_changing_compliance_lets_the_joint_yield():
    """theta(k+1) = theta_r + C(k+1) J^T f(k+1): all of the load, not only its change, bends the new compliance."""
    model, rows, height = pressing_finger(25)
    scene = floor(1.5, height=height)
    targets = constant_targets(model, rows)
    state = INIT(model, scene, targets.reference[0])
    for k in range(25):
        target = Target(reference=targets.reference[k], compliance=targets.compliance[k])
        state, info = STEP(model, scene, state, target)
    softer = Target(reference=targets.reference[-1], compliance=1.5 * targets.compliance[-1])
    J = np.asarray(state.contacts.jacobian[0])
    after, info = STEP(model, scene, state, softer)
    expected = rows[-1] + 1.5 * compliance_of(model) * (J.T @ np.asarray(info.contact_force[0]))
    np.testing.assert_allclose(after.q, expected, atol=EXACT)


STEP, INIT = eqx.filter_jit(step), eqx.filter_jit(init)
POSES, JACOBIAN, PADS = map(eqx.filter_jit, (forward_kinematics, point_jacobian, pad_positions))
SOLVE = eqx.filter_jit(lcp.solve)
