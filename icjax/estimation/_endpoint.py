"""Effective compliance of the contacts (Eq. 5), and how stiff a contact is along one direction."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.model import Model, forward_kinematics, integrate, point_jacobian
from icjax.typing import Float, Real

NORMAL_95 = 1.959964
"""Half width of a 95 % interval in standard deviations."""


class Stiffness(eqx.Module):
    """Stiffness along one direction with its uncertainty.

    **Fields**

    - `stiffness` N/m; `compliance` m/N, its inverse; `compliance_sd` m/N, first order.
    - `lower`, `upper` N/m: 95 %, the inverses of `compliance` -+ 1.96 `compliance_sd` (0 and inf are possible).
    - `sampled_lower`, `sampled_median`, `sampled_upper` N/m: 2.5, 50 and 97.5 % of samples; NaN without samples.
    - `share` [dof]: part of `compliance` that each degree of freedom carries; they sum to one.
    """

    stiffness: float
    compliance: float
    compliance_sd: float
    lower: float
    upper: float
    sampled_lower: float
    sampled_median: float
    sampled_upper: float
    share: Float[Real, " dof"]


def endpoint_compliance(
    model: Model,
    q: Float[Real, " nq"],
    body: int | tuple[int, ...],
    point: Float[Real, "*contact 3"],
    compliance: Float[Real, "dof *dof2"],
) -> Float[Real, "n n"]:
    """Effective compliance of one or several contacts, `G = J C J^T`: displacement of the points per force on them.

    **Arguments**

    - `q`: coordinates of the model.
    - `body`: index of the touched body, or one index a contact.
    - `point` [3] or [contact, 3]: contact points, m, world axes.
    - `compliance`: rad/Nm (m/N for a slide), `[dof]` for a diagonal C or `[dof, dof]`. A driven root has zero.

    **Returns** `[3, 3]` or `[3 contact, 3 contact]`, m/N, world axes, contact by contact. It is symmetric positive
    semidefinite if C is, and singular where the joints cannot move the points in every direction. Differentiable
    in `q` and `compliance`; the points are then fixed in the world.

    **Errors**: `ValueError` where the numbers of bodies and points differ.

    **Source**: Kry and Pai 2006, section 6.2, Eq. 5.
    """
    bodies = (body,) if isinstance(body, int) else tuple(body)
    points = jnp.reshape(jnp.asarray(point), (-1, 3))
    if len(bodies) != points.shape[0]:
        raise ValueError(f"body names {len(bodies)} bodies, point has {points.shape[0]} points")
    return _effective(model, jnp.asarray(q), jnp.asarray(bodies), points, jnp.asarray(compliance))


def directional_stiffness(
    model: Model,
    q: Float[Real, " nq"],
    body: int,
    point: Float[Real, "3"],
    compliance: Float[Real, "dof *dof2"],
    direction: Float[Real, "3"] | tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> Float[Real, ""]:
    """Stiffness felt by a force along one direction that leaves the others free, `k_G = 1 / (e^T J C J^T e)`.

    It is the k_G of Table 2 for the vertical. The tangential force must not change with the load: a fingertip that
    sticks is stiffer, `e^T (J C J^T)^-1 e`. A pad is not in it; see `in_series`.

    **Arguments**: those of `endpoint_compliance` for one contact; `direction` of any length, world axes.

    **Returns** N/m; infinite where the joints do not give way along the direction.

    **Source**: Kry and Pai 2006, sections 4.2 and 6.2.
    """
    C, e = jnp.asarray(compliance), _unit(direction)
    return 1.0 / _along(model, jnp.asarray(q), jnp.asarray(body), jnp.asarray(point), C, e)


def in_series(stiffness: Float[Real, ""] | float, compliance: float) -> Float[Real, ""] | float:
    """Stiffness with a spring in series, 1/k = 1/k_joints + C_pad.

    **Arguments**: `stiffness` N/m; `compliance` m/N of what lies in series, negative to take a pad off again.
    """
    return 1.0 / (1.0 / stiffness + compliance)


def stiffness_interval(
    model: Model,
    q: Float[Real, " nq"],
    body: int,
    point: Float[Real, "3"],
    compliance: Float[Real, " dof"],
    compliance_sd: Float[Real, " dof"],
    q_covariance: Float[Real, "dof dof"] | None = None,
    direction: Float[Real, "3"] | tuple[float, float, float] = (0.0, 0.0, 1.0),
    samples: int = 0,
    seed: int = 0,
) -> Stiffness:
    """`directional_stiffness` with a 95 % interval from the uncertainty of C (diagonal) and of the posture.

    First order in the compliance c = e^T J C J^T e, where it is exact for C and nearly so for q, and then inverted;
    first order in k itself would make the interval symmetric, which it is not. The point is fixed on its body while
    the posture varies. Samples (log-normal C with the given mean and standard deviation, normal q) check it.

    **Arguments**: as in `directional_stiffness`; `compliance_sd` rad/Nm, independent between joints, infinite where
    the estimate is unbounded; `q_covariance` rad^2, of the displacement; `samples` 0 for none.
    """
    q, point, C, e = jnp.asarray(q), jnp.asarray(point), jnp.asarray(compliance), _unit(direction)
    sd = np.asarray(compliance_sd)
    arguments = model, q, jnp.asarray(body), point, e
    c, (by_q, by_c) = _gradient(jnp.zeros(model.nv, q.dtype), C, *arguments)
    by_c = np.asarray(by_c)
    variance = np.sum(np.where(by_c > 0, by_c * np.where(by_c > 0, sd, 0.0), 0.0) ** 2)
    if q_covariance is not None:
        variance += np.asarray(by_q) @ np.asarray(q_covariance) @ np.asarray(by_q)
    deviation = float(np.sqrt(variance))
    c = float(c)
    least = c - NORMAL_95 * deviation
    lower, median, upper = (float("nan"),) * 3
    if samples:
        dq, C = _samples(np.asarray(compliance), sd, q_covariance, samples, seed)
        drawn = np.asarray(_moved_batch(jnp.asarray(dq), jnp.asarray(C), *arguments))
        upper, median, lower = (float(x) for x in 1.0 / np.quantile(drawn, [0.025, 0.5, 0.975]))
    return Stiffness(
        stiffness=1.0 / c,
        compliance=c,
        compliance_sd=deviation,
        lower=1.0 / (c + NORMAL_95 * deviation),
        upper=1.0 / least if least > 0 else float("inf"),
        sampled_lower=lower,
        sampled_median=median,
        sampled_upper=upper,
        share=by_c * np.asarray(compliance) / c,
    )


def _samples(mean: np.ndarray, sd: np.ndarray, q_covariance, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Draws of dq and C; a log-normal of mean C and standard deviation s has log-variance log(1 + (s/C)^2)."""
    if not np.isfinite(sd).all():
        raise ValueError(f"compliance_sd = {sd.tolist()}: samples need finite standard deviations")
    random = np.random.default_rng(seed)
    spread = np.sqrt(np.log1p((sd / np.where(mean > 0, mean, 1.0)) ** 2))
    C = mean * np.exp(spread * random.standard_normal((samples, mean.size)) - spread**2 / 2)
    cov = np.zeros((mean.size, mean.size)) if q_covariance is None else np.asarray(q_covariance)
    return random.multivariate_normal(np.zeros(mean.size), cov, samples, method="eigh"), C


@eqx.filter_jit
def _effective(model, q, bodies, points, compliance):
    J = jax.vmap(point_jacobian, (None, None, 0, 0))(model, q, bodies, points).reshape(-1, model.nv)
    return J @ _times(compliance, J.T)


@eqx.filter_jit
def _along(model, q, body, point, compliance, e):
    torque = e @ point_jacobian(model, q, body, point)
    return torque @ _times(compliance, torque)


def _moved(dq, compliance, model, q, body, point, e):
    """Compliance along e after the displacement dq, the point fixed on its body."""
    home = forward_kinematics(model, q)[body].inverse().apply(point)
    moved = integrate(model, q, dq)
    return _along(model, moved, body, forward_kinematics(model, moved)[body].apply(home), compliance, e)


@eqx.filter_jit
def _gradient(dq, compliance, *arguments):
    return jax.value_and_grad(_moved, argnums=(0, 1))(dq, compliance, *arguments)


@eqx.filter_jit
def _moved_batch(dq, compliance, *arguments):
    return jax.vmap(lambda a, b: _moved(a, b, *arguments))(dq, compliance)


def _times(compliance, columns):
    """C x for a diagonal or a full C, x [dof] or [dof, n]."""
    if compliance.ndim == 2:
        return compliance @ columns
    return compliance.reshape(-1, *[1] * (columns.ndim - 1)) * columns


def _unit(direction):
    e = jnp.asarray(direction, dtype=float)
    return e / jnp.linalg.norm(e)
