"""Dynamic equilibrium after contact: closed form, derivatives, recovery from data that the model itself made."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.fit import DynamicEquilibrium, Parameter, Parameters, Problem, response, solve
from icjax.inference import Log

STEP, FRAMES, EVENTS = 0.002, 60, 6
C, T = np.array([0.3, 0.8]), np.array([0.02, 0.015])
MASS = np.array([[2e-3, 6e-4], [6e-4, 3e-4]])


def values(**other):
    plain = {"compliance": C, "damping time": T, "inertia": np.ones(1), "offsets": np.zeros(2)}
    plain |= {"sensor gain": np.array(1.0), "sensor delay": np.array(0.0)} | other
    return {key: jnp.asarray(value) for key, value in plain.items()}


def measurement() -> DynamicEquilibrium:
    rng = np.random.default_rng(3)
    ramp = np.clip(np.arange(FRAMES) * STEP / 0.05, 0.0, 1.0)
    torque = 0.05 * ramp[None, :, None] * rng.uniform(0.3, 1.5, (EVENTS, 1, 2))
    torque = torque * (1.0 + 0.3 * np.sin(np.arange(FRAMES) / rng.uniform(4, 9, (EVENTS, 1))))[:, :, None]
    still = np.zeros((EVENTS, FRAMES, 1, 2, 2))
    frames = np.tile(np.arange(0, FRAMES, 4), (EVENTS, 1))
    count = frames.shape[1] * 2
    return DynamicEquilibrium(
        "tap", STEP, torque, np.gradient(torque, STEP, axis=1), np.zeros((EVENTS, FRAMES, 2, 2)),
        (still, still, still + MASS), np.zeros(2), 1e-3 * np.eye(2), frames,
        np.zeros((EVENTS, frames.shape[1], 2)), np.tile(np.eye(count) / 1e-3, (EVENTS, 1, 1)),
    )  # fmt: skip


def test_a_constant_torque_ends_at_static_equilibrium():
    """e = C tau once inertia and damping have died away."""
    rest = np.zeros((1500, 1, 2, 2))
    tau = np.array([0.05, 0.02])
    e = response((rest, rest, rest + MASS), jnp.asarray(np.tile(tau, (1500, 1))), values(), np.zeros(2), STEP)
    np.testing.assert_allclose(e[-1], C * tau, rtol=1e-9)
    np.testing.assert_allclose(e[0], 0.0)


def test_a_single_joint_follows_the_closed_form():
    """m e'' + b e' + k e = tau, overdamped, from rest; the midpoint rule is of second order in the step."""
    m, k, damping_time, tau = 1e-3, 4.0, 0.05, 0.1
    b = damping_time * k
    errors = []
    for step in (0.002, 0.001):
        count = round(0.1 / step) + 1
        t = np.arange(count) * step
        one = np.ones((count, 1, 1, 1))
        state = values(compliance=np.array([1 / k]), **{"damping time": np.array([damping_time])})
        e = response((0 * one, 0 * one, m * one), jnp.full((count, 1), tau), state, np.zeros(1), step)[:, 0]
        root = np.sqrt(b**2 - 4 * m * k)
        r1, r2 = (-b + root) / (2 * m), (-b - root) / (2 * m)
        exact = tau / k * (1 + (r2 * np.exp(r1 * t) - r1 * np.exp(r2 * t)) / (r1 - r2))
        errors.append(np.abs(np.asarray(e) - exact).max() / (tau / k))
    assert errors[1] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


def test_forward_reverse_and_central_derivatives():
    model = measurement()
    weight = np.random.default_rng(4).normal(size=model.residual(values()).size)

    def scalar(x):
        state = values(
            compliance=jnp.exp(x[:2]), inertia=jnp.exp(x[4:5]), offsets=x[5:7],
            **{"damping time": jnp.exp(x[2:4]), "sensor gain": x[7], "sensor delay": x[8]},
        )  # fmt: skip
        return jnp.vdot(jnp.asarray(weight), model.residual(state))

    x = jnp.concatenate([jnp.log(C), jnp.log(T), jnp.zeros(3), jnp.array([1.0, 1e-4])])
    function = jax.jit(scalar)
    forward, reverse = jax.jit(jax.jacfwd(scalar))(x), jax.jit(jax.grad(scalar))(x)
    h = 1e-5
    central = jnp.stack([(function(x + h * d) - function(x - h * d)) / (2 * h) for d in jnp.eye(9)])
    np.testing.assert_allclose(forward, reverse, rtol=1e-9)
    np.testing.assert_allclose(forward, central, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("full", [False, True])
def test_recovery_from_exact_data(full):
    """Diagonal and full compliance, damping and mass come back from far."""
    truth = np.array([[0.3, 0.1], [0.1, 0.8]]) if full else C
    model = measurement()
    exact = model.deviation(values(compliance=truth))
    model = dataclasses.replace(model, difference=jax.vmap(lambda e, at: e[at])(exact, jnp.asarray(model.frames)))
    from icjax.inference import Cholesky

    start = np.array([[1.0, 0.0], [0.0, 0.3]]) if full else np.array([1.0, 0.3])
    parameters = Parameters(
        (
            Parameter("compliance", start, "rad/Nm", Cholesky(2) if full else Log()),
            Parameter("damping time", np.array([0.04, 0.04]), "s", Log()),
            Parameter("inertia", np.array([2.0]), "1", Log()),
            Parameter("offsets", np.zeros(2), frozen=True),
            Parameter("sensor gain", np.array(1.0), frozen=True),
            Parameter("sensor delay", np.array(0.0), frozen=True),
        )
    )
    found = solve(Problem(parameters, (model,)), tolerance=1e-12, max_steps=200)
    state = parameters.values(found.value.x)
    np.testing.assert_allclose(state["compliance"], truth, rtol=1e-6)
    np.testing.assert_allclose(state["damping time"], T, rtol=1e-6)
    np.testing.assert_allclose(state["inertia"], 1.0, rtol=1e-6)
