"""Transforms between unconstrained numbers and the values of a model: what keeps a compliance positive."""

import math
from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from icjax.typing import Float, Real


class Transform(eqx.Module):
    """A smooth one-to-one map from x in R^size to a value; a fit moves x, a model sees the value."""

    @abstractmethod
    def size(self, value: Float[Real, "..."]) -> int:
        """How many unconstrained numbers stand for the value."""

    @abstractmethod
    def value(self, x: Float[Real, " size"]) -> Float[Real, "..."]:
        """The value at x."""

    @abstractmethod
    def free(self, value: Float[Real, "..."]) -> Float[Real, " size"]:
        """The x of a value. **Errors**: `ValueError` for a known value outside the range."""


class Identity(Transform):
    """value = x, of any shape; x runs through it row by row."""

    shape: tuple[int, ...] = eqx.field(static=True, default=())

    def size(self, value):
        return math.prod(self.shape) if self.shape else int(np.size(value))

    def value(self, x):
        return jnp.reshape(x, self.shape) if self.shape else x

    def free(self, value):
        return jnp.ravel(jnp.asarray(value))


class Log(Transform):
    """value = exp x: positive, and a step of x is a relative change."""

    def size(self, value):
        return int(np.size(value))

    def value(self, x):
        return jnp.exp(x)

    def free(self, value):
        _refuse(value, lambda y: y > 0, "must be above zero")
        return jnp.log(jnp.ravel(jnp.asarray(value)))


class Softplus(Transform):
    """value = s log(1 + exp(x / s)): positive, and linear where it is large against the scale s."""

    scale: float = eqx.field(static=True, default=1.0)

    def __check_init__(self):
        if not (math.isfinite(self.scale) and self.scale > 0):
            raise ValueError(f"scale = {self.scale}: must be above zero and finite")

    def size(self, value):
        return int(np.size(value))

    def value(self, x):
        return self.scale * jax.nn.softplus(x / self.scale)

    def free(self, value):
        _refuse(value, lambda y: y > 0, "must be above zero")
        y = jnp.ravel(jnp.asarray(value)) / self.scale
        return self.scale * (y + jnp.log(-jnp.expm1(-y)))


class Logistic(Transform):
    """value = lower + (upper - lower) / (1 + exp(-x)): between two bounds, which it never reaches."""

    lower: float = eqx.field(static=True)
    upper: float = eqx.field(static=True)

    def __check_init__(self):
        if not (math.isfinite(self.lower) and math.isfinite(self.upper) and self.lower < self.upper):
            raise ValueError(f"bounds {self.lower} and {self.upper}: must be finite, the lower one first")

    def size(self, value):
        return int(np.size(value))

    def value(self, x):
        return self.lower + (self.upper - self.lower) * jax.nn.sigmoid(x)

    def free(self, value):
        _refuse(value, lambda y: (y > self.lower) & (y < self.upper), f"must be between {self.lower} and {self.upper}")
        share = (jnp.ravel(jnp.asarray(value)) - self.lower) / (self.upper - self.lower)
        return jnp.log(share) - jnp.log1p(-share)


class Tied(Transform):
    """Several entries share a number: value_i = b(x)_groups[i]; one stiffness for all fingers, say.

    **Fields**: `groups` the group of every entry, counted from zero; `of` the transform of the groups' numbers.
    """

    groups: tuple[int, ...] = eqx.field(static=True)
    of: Transform = Log()

    def __check_init__(self):
        if sorted(set(self.groups)) != list(range(len(set(self.groups)))):
            raise ValueError(f"groups {self.groups}: must count from 0 without a gap")

    def size(self, value):
        return max(self.groups) + 1

    def value(self, x):
        return self.of.value(x)[np.asarray(self.groups)]

    def free(self, value):
        value = jnp.asarray(value)
        if value.shape[:1] != (len(self.groups),):
            raise ValueError(f"a value of the shape {value.shape} for {len(self.groups)} groups")
        groups = np.asarray(self.groups)
        members = np.stack([groups == group for group in range(self.size(value))]).astype(float)
        return members / members.sum(axis=1, keepdims=True) @ self.of.free(value)


class Cholesky(Transform):
    """Symmetric positive definite matrices: value = D L L^T D, L lower triangular with exp x on its diagonal.

    Entries of x: the logarithms of L's diagonal, then what lies below it, row by row. With `scale` (the square roots
    of a typical diagonal, on D's) every entry of x is of order one.

    Source: Pinheiro and Bates 1996, Statistics and Computing 6, 289 (the log-Cholesky parametrisation).
    """

    order: int = eqx.field(static=True)
    scale: tuple[float, ...] | None = eqx.field(static=True, default=None)

    def size(self, value):
        return self.order * (self.order + 1) // 2

    def _scale(self):
        return np.ones(self.order) if self.scale is None else np.asarray(self.scale)

    def value(self, x):
        n, D = self.order, self._scale()
        L = jnp.zeros((n, n), x.dtype).at[np.tril_indices(n, -1)].set(x[n:]) + jnp.diag(jnp.exp(x[:n]))
        L = jnp.asarray(D[:, None], x.dtype) * L
        return L @ L.T

    def free(self, value):
        D = self._scale()
        if np.shape(value) != (self.order, self.order) or D.shape != (self.order,):
            raise ValueError(
                f"a value of the shape {np.shape(value)} and {D.size} scales for a matrix of order {self.order}"
            )
        value = jnp.asarray(value) / (D[:, None] * D[None, :])
        _refuse(value, lambda y: np.abs(y - y.T) <= 1e-6 * np.abs(y).max(), "must be symmetric")
        _refuse(value, lambda y: np.linalg.eigvalsh(y) > 0, "must be positive definite")
        L = jnp.linalg.cholesky(value)
        return jnp.concatenate([jnp.log(jnp.diagonal(L)), L[np.tril_indices(self.order, -1)]])


class Synergies(Transform):
    """Compliance along a few directions: value = S diag(exp x_s) S^T + diag(exp x_d), S `[n, k]` known.

    x holds the k logarithms of the synergies' compliances (rad/Nm for columns without unit), then the n of the joints'
    own. The value of many x is nearly the same where S spans all joints; `free` starts from a matrix by giving its
    diagonal to the joints, a synergy a hundredth of what it could hold.
    """

    directions: Float[Real, "n k"]

    def size(self, value):
        n, k = np.shape(self.directions)
        return n + k

    def value(self, x):
        S = jnp.asarray(self.directions)
        k = S.shape[1]
        return (S * jnp.exp(x[:k])[None, :]) @ S.T + jnp.diag(jnp.exp(x[k:]))

    def free(self, value):
        S, diagonal = jnp.asarray(self.directions), jnp.diagonal(jnp.asarray(value))
        _refuse(diagonal, lambda y: y > 0, "must have a positive diagonal")
        share = jnp.sum(S**2 * diagonal[:, None], axis=0) / jnp.sum(S**2, axis=0) ** 2
        return jnp.concatenate([jnp.log(0.01 * share), jnp.log(diagonal)])


def tied(groups: Any, of: Transform | None = None) -> Tied:
    """`Tied` from an array of labels of any kind, numbered in the order in which they appear."""
    labels = list(dict.fromkeys(np.asarray(groups).tolist()))
    return Tied(tuple(labels.index(label) for label in np.asarray(groups).tolist()), of or Log())


def _refuse(value, allowed, text) -> None:
    """Known values are checked; tracers are not."""
    if isinstance(value, Tracer):
        return
    known = np.asarray(value, float)
    if not (np.isfinite(known).all() and np.all(allowed(known))):
        raise ValueError(f"value {np.array2string(known, threshold=8, precision=4)}: {text}")
