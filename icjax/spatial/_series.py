"""Coefficient functions of the exponential maps, smooth through zero angle.

Each is an even function of the angle, written as a function of its square x, which is a polynomial of the rotation
vector and therefore has derivatives at zero. Below `SWITCH` a Taylor series of eight terms is used (its remainder,
SWITCH^8 / 16!, is below 1e-21), above it the closed form; each branch is given a harmless input where the other one
is taken, so that neither produces NaN in a derivative.
"""

import math

import jax.numpy as jnp

from icjax.typing import Scalar

SWITCH = 0.1
TERMS = 8


def sinc(x: Scalar) -> Scalar:
    """sin(a) / a, with x = a^2."""
    a = jnp.sqrt(_large(x))
    return _join(x, jnp.sin(a) / a, [(-1) ** n / math.factorial(2 * n + 1) for n in range(TERMS)])


def versine(x: Scalar) -> Scalar:
    """(1 - cos a) / a^2, with x = a^2."""
    safe = _large(x)
    half = jnp.sin(0.5 * jnp.sqrt(safe))
    return _join(x, 2.0 * half * half / safe, [(-1) ** n / math.factorial(2 * n + 2) for n in range(TERMS)])


def sine_excess(x: Scalar) -> Scalar:
    """(a - sin a) / a^3, with x = a^2."""
    safe = _large(x)
    a = jnp.sqrt(safe)
    return _join(x, (a - jnp.sin(a)) / (a * safe), [(-1) ** n / math.factorial(2 * n + 3) for n in range(TERMS)])


def cotangent_defect(x: Scalar) -> Scalar:
    """(1 - (a/2) cot(a/2)) / a^2, with x = a^2, for 0 <= a < 2 pi."""
    safe = _large(x)
    half = 0.5 * jnp.sqrt(safe)
    closed = (1.0 - half * jnp.cos(half) / jnp.sin(half)) / safe
    bernoulli = [1 / 6, 1 / 30, 1 / 42, 1 / 30, 5 / 66, 691 / 2730, 7 / 6, 3617 / 510]
    return _join(x, closed, [b / math.factorial(2 * n + 2) for n, b in enumerate(bernoulli)])


def _large(x: Scalar) -> Scalar:
    return jnp.where(x < SWITCH, 1.0, x)


def _join(x: Scalar, closed: Scalar, coefficients: list[float]) -> Scalar:
    small = jnp.where(x < SWITCH, x, 0.0)
    series = jnp.zeros_like(small)
    for coefficient in reversed(coefficients):
        series = series * small + coefficient
    return jnp.where(x < SWITCH, series, closed)
