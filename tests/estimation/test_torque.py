"""Joint torque of contact forces: Eq. 2, against closed forms, virtual work and differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hand_made import chain, pressing, recording

from icjax.estimation import contact_torque, joint_torque
from icjax.model import forward_kinematics, integrate, site_positions

ROUNDING = 1e-14
"""A few operations on numbers of order 0.1 Nm in double precision."""


def one_frame(model, q, force, point, **other):
    return recording(
        model, np.arange(2) / 500.0, np.tile(q, (2, 1)), np.tile(force, (2, 1, 1)), np.tile(point, (2, 1, 1)), **other
    )


def test_straight_finger_pressing_down():
    """All angles zero: a force F up at distance x from a joint gives -F x about +y (flexion lowers the tip)."""
    model = chain()
    force, point = np.array([[0.0, 0.0, 2.0]]), np.array([[0.1, 0.0, 0.0]])
    tau = joint_torque(one_frame(model, np.zeros(3), force, point))
    np.testing.assert_allclose(tau[0], [-0.2, -0.1, -0.04], atol=ROUNDING)


def test_free_moment_loads_every_joint_up_to_the_root():
    model = chain()
    nothing = np.zeros((1, 3))
    made = one_frame(
        model,
        np.array([0.2, 0.5, 0.3]),
        nothing,
        nothing,
        moment=np.tile([[0.0, 0.07, 0.0]], (2, 1, 1)),
        touching=np.ones((2, 1), bool),
    )
    np.testing.assert_allclose(joint_torque(made)[0], [0.07] * 3, atol=ROUNDING)


def test_power_of_the_torque_is_the_power_of_the_force():
    """tau . dq = f . d(point) for a displacement dq: the derivative of the tip's path along dq."""
    model = chain(kind="ball")
    random = np.random.default_rng(1)
    q = integrate(model, jnp.asarray(model.zero), 0.5 * random.standard_normal(model.nv))
    dq, force = random.standard_normal(model.nv), random.standard_normal(3)
    path = jax.jit(lambda s: site_positions(model, integrate(model, q, s * dq))[0])
    tip, velocity = jax.jvp(path, (0.0,), (1.0,))
    tau = contact_torque(
        model, (model.site_bodies[0],), q, force[None], tip[None], jnp.zeros((1, 3)), jnp.array([True])
    )
    np.testing.assert_allclose(tau @ dq, force @ velocity, rtol=1e-12)


def test_a_pad_names_its_body_and_branches_do_not_mix():
    model = chain(branches=2)
    force, point = np.ones((2, 3)), np.array([[0.1, 0.0, 0.02], [0.1, 0.1, -0.01]])
    by_pad = joint_torque(one_frame(model, np.full(6, 0.2), force, point, bodies=("pad0", "pad1")))
    by_body = joint_torque(one_frame(model, np.full(6, 0.2), force, point, bodies=("link2_0", "link2_1")))
    np.testing.assert_array_equal(by_pad, by_body)
    only_second = one_frame(model, np.full(6, 0.2), force, point, touching=np.tile([False, True], (2, 1)))
    tau = np.asarray(joint_torque(only_second))
    assert np.all(tau[:, :3] == 0)
    np.testing.assert_array_equal(tau[:, 3:], by_body[:, 3:])
    proximal = joint_torque(one_frame(model, np.full(6, 0.2), force, point, bodies=("link0_0", "link1_1")))
    assert np.all(proximal[:, [1, 2, 5]] == 0)
    assert np.all(proximal[:, [0, 3, 4]] != 0)


def test_unknown_contact_body_is_named():
    with pytest.raises(ValueError, match="contact_bodies: 'toe' is neither a body nor a pad.*link2"):
        joint_torque(one_frame(chain(), np.zeros(3), np.ones((1, 3)), np.ones((1, 3)), bodies=("toe",)))


def test_nan_where_nothing_touches_is_ignored_and_elsewhere_kept():
    model = chain()
    made, _, tau = pressing()
    touching = np.asarray(made.touching)[:, 0]
    found = np.asarray(joint_torque(made))
    assert np.all(found[~touching] == 0)
    np.testing.assert_allclose(found, tau, atol=ROUNDING)
    q = np.asarray(made.q).copy()
    q[[10, 250]] = np.nan
    assert not touching[10]
    assert touching[250]
    blind = np.asarray(joint_torque(eqx.tree_at(lambda r: r.q, made, q)))
    assert np.all(blind[10] == 0)
    assert np.all(np.isnan(blind[250]))
    assert np.isfinite(np.delete(blind, 250, axis=0)).all()
    assert model.nv == blind.shape[1]
    valid = np.ones(len(touching), bool)
    valid[[10, 250]] = False
    unsure = np.asarray(joint_torque(eqx.tree_at(lambda r: r.valid, made, valid)))  # finite q, but not of markers
    np.testing.assert_array_equal(unsure, blind)


def test_derivatives_forward_reverse_central_difference():
    """At frames with contact and, where the point is NaN, without; step eps^(1/3), so eps^(2/3) is left."""
    model = chain()
    random = np.random.default_rng(2)
    force = random.standard_normal((2, 3))
    point = np.stack([np.array([0.1, 0.0, 0.02]), np.full(3, np.nan)])
    touching = jnp.array([True, False])

    @jax.jit
    def loss(q, force):
        tau = contact_torque(model, (3, 2), q, force, point, jnp.zeros((2, 3)), touching)
        return jnp.sum(jnp.sin(10 * tau))

    q, step = jnp.array([0.0, 0.3, 0.0]), np.finfo(float).eps ** (1 / 3)
    base = (q, jnp.asarray(force))
    forward = jax.jit(jax.jacfwd(loss, (0, 1)))(*base)
    reverse = jax.jit(jax.jacrev(loss, (0, 1)))(*base)
    for argument in (0, 1):
        flat = base[argument].ravel()
        central = []
        for i in range(flat.size):
            ends = [flat.at[i].add(sign * step).reshape(base[argument].shape) for sign in (1, -1)]
            args = [(end, base[1]) if argument == 0 else (base[0], end) for end in ends]
            central.append((loss(*args[0]) - loss(*args[1])) / (2 * step))
        assert np.isfinite(forward[argument]).all()
        np.testing.assert_allclose(forward[argument], reverse[argument], rtol=1e-13, atol=1e-14)
        np.testing.assert_allclose(forward[argument].ravel(), central, atol=1e-8)


def test_vmap_over_recordings_equals_a_loop():
    made, _, _ = pressing()
    forces = np.stack([np.asarray(made.contact_force) * k for k in (1.0, -2.0)])
    each = [joint_torque(eqx.tree_at(lambda r: r.contact_force, made, f)) for f in forces]
    batch = jax.vmap(lambda f: joint_torque(eqx.tree_at(lambda r: r.contact_force, made, f)))(forces)
    np.testing.assert_allclose(batch, np.stack(each), rtol=1e-13, atol=1e-16)


def test_the_body_of_a_contact_is_where_the_kinematics_put_it():
    """A force through a joint's own anchor has no torque about it."""
    model = chain()
    q = np.array([0.4, 0.7, 0.2])
    anchor = np.asarray(forward_kinematics(model, q).position[2])
    made = one_frame(model, q, np.array([[1.0, 2.0, 3.0]]), anchor[None], bodies=("link2",))
    assert abs(float(joint_torque(made)[0, 1])) < ROUNDING
