"""Poses of many frames and a model's parameters together: bundle adjustment."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.capture._calibration_parameters import Parameters, changed_model
from icjax.capture._pose import marker_jacobian
from icjax.capture._posture import PosturePrior, prior_rows
from icjax.model import Model, forward_kinematics, integrate, world_jacobian
from icjax.typing import Float, Real

STEPS = 60
NEGLIGIBLE = 0.05
"""Decrease of the sum of squares in one step, in units of the noise: a parameter that is off by its standard deviation
costs 1, so what is left is a fifth of that."""

DAMPING = (1e-3, 1e-9, 1e9)
"""First, smallest and largest damping, relative to the diagonal."""


class Bundle(NamedTuple):
    """State of the adjustment: poses `q` [frame, nq], parameters `z` in units of their priors."""

    q: Float[Real, "frame nq"]
    z: Float[Real, " parameter"]


class Blocks(NamedTuple):
    """Normal equations. Poses are blocks on the diagonal, the parameters border them:

        [ A_f  B_f ] [dq_f]     [a_f]
        [ B^T   C  ] [ dz ] = - [ c ]

    `cost` is the sum of squares in units of the noise, `misfit` its part from the markers; `seen` [frame, nv, nv] the
    part of A from markers.
    """

    A: Float[Real, "frame nv nv"]
    B: Float[Real, "frame nv parameter"]
    C: Float[Real, "parameter parameter"]
    a: Float[Real, "frame nv"]
    c: Float[Real, " parameter"]
    cost: Float[Real, ""]
    misfit: Float[Real, ""]
    seen: Float[Real, "frame nv nv"]


class Data(NamedTuple):
    """Markers [frame, marker, 3] m, their weight [frame, marker] (0 or 1), the posture prior, the noise in m."""

    markers: Float[Real, "frame marker 3"]
    weight: Float[Real, "frame marker"]
    posture: PosturePrior
    sd: Float[Real, ""]


@eqx.filter_jit
def normal_equations(model: Model, sites: tuple[int, ...], parameters: Parameters, at: Bundle, data: Data) -> Blocks:
    """Linearisation of sum |x - p(q, z)|^2 / sd^2 + posture + |z|^2 at a state, exact derivatives."""
    bodies = np.asarray(model.site_bodies, int)[list(sites)]
    here = changed_model(model, sites, parameters, at.z)

    def points(q, z):
        changed = changed_model(model, sites, parameters, z)
        poses = forward_kinematics(changed, q)
        places = changed.site_position[np.asarray(sites)]
        return jnp.einsum("sij,sj->si", poses.rotation[bodies], places) + poses.position[bodies]

    def frame(q, x, w):
        weight = (jnp.sqrt(w) / data.sd)[:, None]
        p, slope = jax.linearize(lambda z: points(q, z), at.z)
        r = (weight * (p - x)).reshape(-1)
        Jz = jax.vmap(slope, out_axes=2)(jnp.eye(len(at.z), dtype=at.z.dtype))
        Jz = (weight[:, :, None] * Jz).reshape(-1, len(at.z))
        Jq = (weight[:, :, None] * marker_jacobian(here, bodies, world_jacobian(here, q).T, p)).reshape(-1, model.nv)
        believed, slopes = prior_rows(model, data.posture, q)
        believed, slopes = believed / data.posture.noise, slopes / data.posture.noise
        seen = Jq.T @ Jq
        return (
            seen + slopes.T @ slopes,
            Jq.T @ Jz,
            Jz.T @ Jz,
            Jq.T @ r + slopes.T @ believed,
            Jz.T @ r,
            r @ r + believed @ believed,
            r @ r,
            seen,
        )

    A, B, C, a, c, cost, misfit, seen = jax.vmap(frame)(at.q, data.markers, data.weight)
    return Blocks(
        A=A,
        B=B,
        C=jnp.sum(C, axis=0) + jnp.eye(len(at.z)),
        a=a,
        c=jnp.sum(c, axis=0) + at.z,
        cost=jnp.sum(cost) + at.z @ at.z,
        misfit=jnp.sum(misfit),
        seen=seen,
    )


@eqx.filter_jit
def schur(blocks: Blocks, damping: Float[Real, ""]) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Step of the poses and of the parameters, and the reduced matrix S = C - sum_f B_f^T A_f^-1 B_f.

    With damping zero the inverse of S is the covariance of the parameters after the poses are integrated out
    (Laplace).
    """
    A, C = _damped(blocks.A, damping), _damped(blocks.C, damping)
    factor = jnp.linalg.cholesky(A)
    right = jnp.concatenate([blocks.B, blocks.a[:, :, None]], axis=2)
    solved = jax.vmap(lambda L, b: jax.scipy.linalg.cho_solve((L, True), b))(factor, right)
    AB, Aa = solved[:, :, :-1], solved[:, :, -1]
    S = C - jnp.einsum("fvp,fvr->pr", blocks.B, AB)
    S = 0.5 * (S + S.T)
    dz = -jnp.linalg.solve(S, blocks.c - jnp.einsum("fvp,fv->p", blocks.B, Aa))
    return -Aa - jnp.einsum("fvp,p->fv", AB, dz), dz, S


def adjust(
    model: Model,
    sites: tuple[int, ...],
    parameters: Parameters,
    start: Bundle,
    data: Data,
    told: Callable[[float], None] = lambda fraction: None,
) -> tuple[Bundle, Blocks, bool]:
    """Levenberg-Marquardt on poses and parameters together.

    **Returns** the state, its normal equations and whether a decrease below `NEGLIGIBLE` ended the search.

    **Source**: Triggs et al. 2000, Bundle adjustment: a modern synthesis, section 6 (reduced system); Marquardt 1963.
    """
    at, blocks = start, normal_equations(model, sites, parameters, start, data)
    damping = DAMPING[0]
    for step in range(STEPS):
        dq, dz, _ = schur(blocks, jnp.asarray(damping))
        trial = Bundle(_moved(model, at.q, dq), at.z + dz)
        there = normal_equations(model, sites, parameters, trial, data)
        decrease = float(blocks.cost - there.cost)
        better = decrease >= 0
        if better:
            at, blocks = trial, there
        damping = float(np.clip(damping / 10 if better else damping * 10, DAMPING[1], DAMPING[2]))
        told((step + 1) / STEPS)
        if better and decrease < NEGLIGIBLE and damping < 1.0:  # a heavily damped step is short, not the last
            return at, blocks, True
    return at, blocks, False


@eqx.filter_jit
def _moved(model: Model, q: Real, dq: Real) -> jax.Array:
    return jax.vmap(lambda item, step: jnp.asarray(integrate(model, item, step)))(q, dq)


def _damped(matrix: Real, damping: Real) -> jax.Array:
    """M + damping diag M, kept definite where the data see nothing."""
    matrix = jnp.asarray(matrix)
    diagonal = jnp.diagonal(matrix, axis1=-2, axis2=-1)
    floor = jnp.finfo(matrix.dtype).eps * jnp.max(diagonal, axis=-1, keepdims=True)
    eye = jnp.eye(matrix.shape[-1], dtype=matrix.dtype).reshape((1,) * (matrix.ndim - 2) + matrix.shape[-2:])
    return matrix + (damping * diagonal + floor)[..., None] * eye
