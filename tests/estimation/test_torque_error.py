"""Standard deviation of the joint torque: against random draws, closed forms, and where it is used."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from hand_made import COMPLIANCE, chain, pressing, recording, session

from icjax.estimation import EstimationOptions, compliance_at_contact, contact_torque, estimate, torque_deviation
from icjax.estimation._torque_error import torque_derivatives
from icjax.model import integrate, load_model, neutral

DRAWS = 4000
"""A standard deviation from so many draws is known to 1 / sqrt(2 * 4000) = 1.1 %."""


def pressed(model, q, force, point, **stated):
    made = recording(
        model, np.arange(2) / 500.0, np.tile(q, (2, 1)), np.tile(force, (2, 1, 1)), np.tile(point, (2, 1, 1))
    )
    return dataclasses.replace(made, **stated)


def test_straight_finger_pressed_at_a_point_of_the_world():
    """tau = -F (x - x_joint): only x of the point and the vertical force enter, the angles to second order."""
    model = chain()
    made = pressed(
        model,
        np.zeros(3),
        np.array([[0.0, 0.0, 2.0]]),
        np.array([[0.1, 0.0, 0.0]]),
        contact_force_sd=np.array([0.01]),
        contact_point_sd=np.full((2, 1), 0.001),
        q_offset_sd=np.full(3, 0.02),
    )
    found = torque_deviation(made)
    arms = np.array([0.1, 0.05, 0.02])
    np.testing.assert_allclose(found.noise[0], np.hypot(0.01 * arms, 0.001 * 2.0), rtol=1e-12)
    np.testing.assert_allclose(found.offset, 0.0, atol=1e-12)


def test_random_draws_scatter_as_stated():
    model = chain()
    random = np.random.default_rng(0)
    q = np.array([0.3, 0.7, 0.4])
    root = 0.02 * random.normal(size=(3, 3))
    covariance, offset = root @ root.T, np.diag([0.01, 0.02, 0.03]) ** 2
    force, point = np.array([[0.5, 0.0, 2.0]]), np.array([[0.08, 0.0, -0.06]])
    made = pressed(
        model,
        q,
        force,
        point,
        q_covariance=np.tile(covariance, (2, 1, 1)),
        q_offset_covariance=offset,
        contact_force_sd=np.array([0.05]),
        contact_point_sd=np.full((2, 1), 0.002),
    )
    found = torque_deviation(made)

    @jax.jit
    @jax.vmap
    def torque(q, f, p):
        return contact_torque(model, (3,), q, f, p, jnp.zeros((1, 3)), jnp.ones(1, bool))

    noise = torque(
        q + random.normal(size=(DRAWS, 3)) @ np.linalg.cholesky(covariance).T,
        force + 0.05 * random.normal(size=(DRAWS, 1, 3)),
        point + 0.002 * random.normal(size=(DRAWS, 1, 3)),
    )
    # 0.04 rad of angle error leave second-order terms of 4 %.
    np.testing.assert_allclose(np.std(noise, axis=0), found.noise[0], rtol=0.08, atol=1e-9)
    shifted = torque(
        q + random.normal(size=(DRAWS, 3)) * [0.01, 0.02, 0.03],
        np.tile(force, (DRAWS, 1, 1)),
        np.tile(point, (DRAWS, 1, 1)),
    )
    np.testing.assert_allclose(np.std(shifted, axis=0), found.offset[0], rtol=0.08, atol=1e-9)
    np.testing.assert_allclose(found.total, np.hypot(found.noise, found.offset))


MIXED = """
<mujoco>
  <worldbody>
    <body name="trunk" pos="0.1 0.2 1.0">
      <freejoint/>
      <geom type="sphere" size="0.05" mass="1"/>
      <body name="upper" pos="0 0 -0.1" euler="10 20 30">
        <joint name="shoulder" type="ball" pos="0.01 0 0"/>
        <geom type="sphere" size="0.03" mass="0.3"/>
        <body name="lower" pos="0.05 0 -0.2">
          <joint name="bend" type="hinge" axis="0.6 0.8 0" pos="0 0.01 0.02"/>
          <joint name="twist" type="hinge" axis="0 0 1"/>
          <joint name="stretch" type="slide" axis="0 0.6 0.8"/>
          <geom type="sphere" size="0.02" mass="0.2"/>
        </body>
        <body name="other" pos="0 0.1 0">
          <joint name="side" type="hinge" axis="0 1 0"/>
          <geom type="sphere" size="0.02" mass="0.2"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_the_derivatives_are_those_of_the_torque(tmp_path):
    path = tmp_path / "mixed.xml"
    path.write_text(MIXED)
    model = load_model(path)
    random = np.random.default_rng(5)
    q = integrate(model, neutral(model), 0.7 * random.normal(size=model.nv))
    bodies = tuple(model.body(name) for name in ("lower", "other", "trunk", "lower"))
    force, point, moment = random.normal(size=(3, 4, 3))
    touching = np.array([True, True, True, False])

    def torque(dq, f, p):
        return contact_torque(model, bodies, integrate(model, q, dq), f, p, moment, touching)

    expected = jax.jacfwd(torque, argnums=(0, 1, 2))(np.zeros(model.nv), force, point)
    found = torque_derivatives(model, bodies, q, force, point, moment, touching)
    for mine, exact in zip(found, expected, strict=True):
        mine = mine if mine.ndim == 2 else mine[:, touching]
        exact = exact if exact.ndim == 2 else exact[:, touching]
        np.testing.assert_allclose(mine, exact, atol=1e-12)
        assert np.abs(exact).max() > 0.1


def test_nothing_without_contact_and_unknown_without_a_pose():
    made, _, tau = pressing(q_sd=1e-3, offset_sd=1e-2)
    touching = np.asarray(made.touching)[:, 0]
    found = torque_deviation(made)
    assert np.all(found.total[~touching] == 0)
    assert np.isfinite(found.total).all()
    largest = found.offset.max(axis=0)
    assert largest[0] < 1e-9  # the first joint stands in the world: its own angle does not move its anchor
    assert np.all(largest[1:] > 1e-4)
    valid = np.ones(len(touching), bool)
    valid[250] = False
    blind = torque_deviation(eqx.tree_at(lambda r: r.valid, made, valid))
    assert touching[250]
    assert np.isnan(blind.total[250]).all()


def test_the_reference_and_the_compliance_know_of_it():
    made, _, tau = pressing(q_sd=1e-5, offset_sd=2e-2)
    found = torque_deviation(made)
    given = EstimationOptions(given=dict(zip(("joint0", "joint1", "joint2"), COMPLIANCE, strict=True)))
    one = estimate(session(made), given)[0]
    np.testing.assert_allclose(one.torque_sd, found.total)
    expected = np.sqrt(1e-10 + 4e-4 + (np.asarray(COMPLIANCE) * found.total) ** 2)
    np.testing.assert_allclose(one.reference_sd, expected, rtol=1e-12)
    bare = compliance_at_contact((made,))
    told = compliance_at_contact((made,), None, (tau,), (found,))
    added = np.asarray(told.standard_error) ** 2 - np.asarray(bare.standard_error) ** 2
    after = (made.time > 0.4) & (made.time <= 0.5 + 1e-9)
    share = np.sqrt(np.sum(found.offset[after] ** 2, axis=0) / np.sum(tau[after] ** 2, axis=0))
    np.testing.assert_allclose(added[0], (np.asarray(COMPLIANCE) * share) ** 2, rtol=1e-5, atol=1e-12)
