"""A rollout as a function: traced once, differentiable, the same in any frame."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hands import RADIUS, compliance_of, constant_targets, floor, planar_finger, pressing_finger, simulate, sprung_tip
from scipy.spatial.transform import Rotation

import icjax.synthesis._stepper as stepper
from icjax.geometry import Ellipsoid, Plane
from icjax.model import pad_positions
from icjax.synthesis import Scene, Surface, Target, rollout

STEPS = 12
MODEL = planar_finger()


def test_a_rollout_traces_once(monkeypatch):
    model, rows, height = pressing_finger(37)
    traces = []
    real = stepper.find_contacts
    monkeypatch.setattr(stepper, "find_contacts", lambda *args, **more: traces.append(None) or real(*args, **more))
    targets = constant_targets(model, rows)
    chunked = {"chunk": 10, "progress": lambda fraction: None}
    scene = floor(0.123, facets=3, height=height)
    _, first = rollout(model, scene, targets, **chunked)
    assert len(traces) == 2  # init and the step
    rollout(model, floor(0.456, facets=3, height=height - 0.001), targets, **chunked)
    assert len(traces) == 2  # other numbers compile nothing
    _, whole = rollout(model, scene, targets)
    np.testing.assert_array_equal(whole.contact_force, first.contact_force)


def outcome(x, reference, height):
    """Last force and pose as a function of (4 compliances, friction, pad compliance, shift of the reference)."""
    model = dataclasses.replace(MODEL, pad_compliance=x[5:6])
    scene = Scene(
        "flat", (Surface("plate", Plane(jnp.array([0.0, 0.0, 1.0]) * height, jnp.array([0.0, 0.0, 1.0])), x[4]),)
    )
    part = jnp.linspace(0.0, 1.0, STEPS)[:, None]
    targets = Target(
        reference=reference + part * x[None, 6:],
        compliance=jnp.tile(jnp.concatenate([jnp.zeros(2), x[:4]]), (STEPS, 1)),
    )
    state, info = rollout(model, scene, targets)
    return jnp.concatenate([info.contact_force[-1, 0], state.q, info.torque[-1]])


OUTCOME = jax.jit(outcome)
FORWARD, REVERSE = jax.jit(jax.jacfwd(outcome)), jax.jit(jax.jacrev(outcome))


def parameters(friction):
    return jnp.concatenate([jnp.asarray(compliance_of(MODEL)[2:]), jnp.array([friction, 1 / 750]), jnp.zeros(6)])


@pytest.mark.slow
def test_derivatives():
    """Forward = reverse = central difference with respect to compliance, friction, pad compliance and reference; finite
    at singular points. One test, because they share what takes time: compiling the derivatives of a rollout."""
    _, rows, height = pressing_finger(STEPS, stroke=0.004)
    for friction in (0.3, 1.5):  # slides, sticks
        x, reference = parameters(friction), jnp.asarray(rows)
        forward, reverse = FORWARD(x, reference, height), REVERSE(x, reference, height)
        scale = jnp.concatenate([x[:6], jnp.full(6, 0.01)])  # a typical size of each parameter
        step = 1e-5
        columns = [
            (OUTCOME(x + step * s * e, reference, height) - OUTCOME(x - step * s * e, reference, height)) / (2 * step)
            for s, e in zip(scale, jnp.eye(len(x)), strict=True)
        ]
        size = float(jnp.max(jnp.abs(forward * scale[None, :])))
        assert size > 0.05
        np.testing.assert_allclose(forward, reverse, atol=1e-10 * float(jnp.max(jnp.abs(forward))))  # rounding
        # difference: truncation and rounding of a relative step of 1e-5
        np.testing.assert_allclose(forward * scale[None, :], jnp.stack(columns, axis=1), atol=1e-7 * size)
    for case in ("at rest", "first touch", "zero slip", "straight finger", "in the air"):
        finite_at(case)


def finite_at(case):
    posture = np.array([0.0, 0.0, 0.1, 0.3, 0.4, 0.3]) * (case != "straight finger")
    bottom = float(pad_positions(MODEL, jnp.asarray(posture))[0, 2]) - RADIUS
    rows = np.tile(posture, (STEPS, 1))
    height = bottom + {"at rest": 0.002, "zero slip": 0.002, "in the air": -0.05}.get(case, 0.0)
    if case == "zero slip":
        rows[:, 1] -= 0.002 * np.linspace(0, 1, STEPS)
    x = parameters(0.5)
    for function in (OUTCOME, FORWARD, REVERSE):
        assert np.all(np.isfinite(function(x, jnp.asarray(rows), height))), case


def test_rigid_pad_on_a_planar_finger():
    """Without pad compliance W is singular across the plane of motion; the step is still solved."""
    _, rows, height = pressing_finger(30, stroke=0.01)
    model = planar_finger(pad=0.0)
    _, info = simulate(model, floor(0.5, height=height), constant_targets(model, rows))
    assert np.all(np.asarray(info.status) == 0)
    assert np.asarray(info.contact_force)[-1, 0, 2] > 0.1
    # an impenetrable pad: what is left of the gap is the curvature of the finger's arc within one step
    assert np.min(np.asarray(info.gap)) > -1e-5


@pytest.mark.parametrize("friction", [0.0, 2.0], ids=["frictionless", "sticks"])
def test_the_same_in_any_frame(friction):
    """Turning the surfaces, the root and nothing else turns the forces (where facets do not matter)."""
    tip, turned_tip = sprung_tip(), sprung_tip()
    R = Rotation.from_euler("xyz", [0.3, -0.4, 0.7]).as_matrix()
    turned_tip = dataclasses.replace(turned_tip, joint_axis=tip.joint_axis @ R.T)
    along = np.linspace(0.0, 1.0, 40)
    rows = np.stack([-0.02 + 0.01 * along, 0.002 * along, 0.012 - 0.014 * along], axis=1)

    def world(R):
        bump = Ellipsoid(R @ np.array([-0.01, 0.0, 0.0]), R, np.array([0.012, 0.035, 0.003]))
        plate = Plane(np.zeros(3), R @ np.array([0.0, 0.0, 1.0]))
        return Scene("turned", (Surface("plate", plate, friction), Surface("bump", bump, friction)))

    _, here = simulate(tip, world(np.eye(3)), constant_targets(tip, rows))
    _, there = simulate(turned_tip, world(R), constant_targets(turned_tip, rows))
    force = np.asarray(here.contact_force)
    assert np.max(np.linalg.norm(force, axis=-1)) > 0.1
    rounding = 1e-9  # of 40 steps whose pivots are taken in another order
    np.testing.assert_allclose(np.asarray(there.contact_force), force @ R.T, atol=rounding)
    np.testing.assert_allclose(np.asarray(there.contact_point), np.asarray(here.contact_point) @ R.T, atol=rounding)
    np.testing.assert_allclose(there.q, here.q, atol=rounding)
    np.testing.assert_allclose(there.torque, here.torque, atol=rounding)
