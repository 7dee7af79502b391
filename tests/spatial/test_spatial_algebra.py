"""Adjoint, wrenches, Gamma, inertia and Eq. 3: power invariance, and the laws they stand for."""

import jax
import jax.numpy as jnp
import numpy as np
from axioms import holds
from hypothesis import strategies as st

from icjax.spatial import (
    adjoint,
    gamma,
    newton_euler,
    rotation_exp,
    skew,
    spatial_cross,
    spatial_inertia,
    twist_exp,
    wrench_adjoint,
)

ROUNDING = 1e-13
"""A hundred roundings of numbers up to ten."""

numbers = st.floats(-1.5, 1.5)
six = st.tuples(*[numbers] * 6).map(np.asarray)

MASS, COM = 0.7, np.asarray([0.1, -0.2, 0.05])
ABOUT_COM = np.asarray([[0.03, 0.002, 0.0], [0.002, 0.04, -0.003], [0.0, -0.003, 0.05]])
INERTIA = spatial_inertia(MASS, COM, ABOUT_COM)


def close(a, b, tolerance=ROUNDING):
    np.testing.assert_allclose(np.asarray(a), np.asarray(b), rtol=0, atol=tolerance)


@holds(six, six, six, six)
def test_power_is_the_same_in_every_frame(a, b, phi, w):
    X, Y = twist_exp(a), twist_exp(b)
    yield (adjoint(X) @ phi) @ (wrench_adjoint(X) @ w), phi @ w
    yield wrench_adjoint(X), jnp.linalg.inv(adjoint(X)).T
    yield adjoint(X @ Y), adjoint(X) @ adjoint(Y)
    yield wrench_adjoint(X @ Y), wrench_adjoint(X) @ wrench_adjoint(Y)
    yield adjoint(X.inverse()), jnp.linalg.inv(adjoint(X))


@holds(six, six)
def test_gamma_gives_velocities_of_points_and_wrenches_of_forces(phi, rest):
    r, f = rest[:3], rest[3:]
    yield gamma(r) @ phi, phi[3:] + jnp.cross(phi[:3], r)
    yield gamma(r).T @ f, jnp.concatenate([jnp.cross(r, f), f])


@holds(six, six)
def test_the_cross_product_is_the_rate_of_the_adjoint(xi, phi):
    """d/dt Ad(exp(t xi)) phi at t = 0 is [xi] phi, and [xi] xi = 0."""
    _, rate = jax.jvp(lambda t: adjoint(twist_exp(t * jnp.asarray(xi))) @ phi, (0.0,), (1.0,))
    yield rate, spatial_cross(xi) @ phi
    yield spatial_cross(xi) @ xi, np.zeros(6)


@holds(six)
def test_kinetic_energy_is_that_of_koenig(phi):
    at_com = phi[3:] + jnp.cross(phi[:3], COM)
    energy = 0.5 * MASS * at_com @ at_com + 0.5 * phi[:3] @ ABOUT_COM @ phi[:3]
    yield 0.5 * phi @ INERTIA @ phi, energy


@holds(six, six, six)
def test_newton_euler_is_the_rate_of_momentum(a, phi, phidot):
    """Eq. 3 against the derivative of the world momentum Ad^-T M phi along a motion with that twist and rate."""

    def momentum(t):
        X = twist_exp(a) @ twist_exp(t * jnp.asarray(phi))  # body twist phi at t = 0
        return wrench_adjoint(X) @ (INERTIA @ (phi + t * phidot))

    _, rate = jax.jvp(momentum, (0.0,), (1.0,))
    yield wrench_adjoint(twist_exp(a)) @ newton_euler(INERTIA, phi, phidot), rate


def test_a_free_body_keeps_its_momentum_and_spins_by_eulers_equations():
    inertia = np.diag([0.03, 0.04, 0.06])
    M = spatial_inertia(2.0, np.zeros(3), inertia)
    phi = np.asarray([1.0, -2.0, 0.5, 0.1, 0.2, 0.3])
    phidot = np.concatenate(
        [np.linalg.solve(inertia, -np.cross(phi[:3], inertia @ phi[:3])), -np.cross(phi[:3], phi[3:])]
    )
    close(newton_euler(M, phi, phidot), np.zeros(6), 1e-15)


def test_skew_is_the_cross_product_and_turns_with_its_vector():
    p, x = np.asarray([0.2, -1.0, 0.7]), np.asarray([1.1, 0.3, -0.4])
    R = rotation_exp(x)
    close(skew(p) @ x, np.cross(p, x), 1e-15)
    close(R @ skew(p) @ R.T, skew(R @ p), 1e-15)
