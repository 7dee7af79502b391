"""Postures with a given endpoint stiffness: one equation for several unknown angles."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.model import Model, forward_kinematics, pad_positions, point_jacobian
from icjax.typing import Float, Real

TOLERANCE = 1e-6
"""Relative difference from the wanted stiffness up to which a posture counts as found."""


class Posture(eqx.Module):
    """A posture with the wanted stiffness.

    **Fields**: `q` coordinates; `scale` of the model's lengths; `stiffness` N/m; `distance` from the natural posture,
    root of the summed squares in units of `spread`; `share` [dof] of each degree of freedom in the compliance; `tilt`
    rad of the last body's x axis below the horizontal (its pitch); `found`: whether the search ended there.
    """

    q: Float[np.ndarray, " nq"]
    scale: float
    stiffness: float
    distance: float
    share: Float[np.ndarray, " dof"]
    tilt: float
    found: bool


def posture_search(
    model: Model,
    pad: str,
    compliance: Float[Real, " dof"],
    stiffness: float,
    spread: Float[np.ndarray, " nq"],
    scale_spread: float = 0.05,
    tilt: tuple[float, float] = (0.35, 1.3),
) -> Callable[[np.ndarray, float], Posture]:
    """Search for the posture closest to a natural one whose pad has a given vertical stiffness.

    Minimises `sum ((q - q_natural) / spread)^2 + ((s - s_natural) / scale_spread)^2` over the coordinates q and the
    scale s of all lengths, subject to `k_G(q, s) = stiffness`, the joint limits and the tilt of the body that carries
    the pad, by sequential quadratic programming with exact derivatives.

    **Arguments**

    - `model`: hinges and slides only. `compliance` rad/Nm. `stiffness` N/m, k_G of `directional_stiffness`.
    - `spread`: what counts as one unit away from natural, rad. `scale_spread`: the same for the scale.
    - `tilt`: rad, limits; a pad that touches a horizontal plate lies between flat (0) and upright (pi / 2).

    **Returns** a function of a natural posture `[nq]` and scale that gives a `Posture`.

    **Errors**: `ValueError` for joints that are neither hinges nor slides.
    """
    from scipy.optimize import minimize

    if not set(model.joint_types) <= {"hinge", "slide"}:
        raise ValueError(f"posture_search needs hinges and slides; the model has {', '.join(model.joint_types)}")
    body = model.pad_bodies[model.pad(pad)]
    C = jnp.asarray(compliance)

    @jax.jit
    def parts(x):
        """Compliance along z, degree by degree, and the tilt."""
        sized = eqx.tree_at(lambda m: (m.body_position, m.pad_centre), model, _scaled(model, x[-1]))
        q = x[:-1]
        lever = point_jacobian(sized, q, body, pad_positions(sized, q)[model.pad(pad)])[2]
        R = forward_kinematics(sized, q)[body].rotation
        return C * lever**2, jnp.arctan2(-R[2, 0], R[2, 2])

    def conditions(x):
        c, angle = parts(x)
        return jnp.stack([jnp.log(jnp.sum(c) * stiffness), angle])

    value_and_slope = jax.jit(lambda x: (conditions(x), jax.jacfwd(conditions)(x)))
    last: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if x.tobytes() not in last:
            last.clear()
            value, slope = value_and_slope(x)
            last[x.tobytes()] = np.asarray(value), np.asarray(slope)
        return last[x.tobytes()]

    unit = np.append(spread, scale_spread)
    low = np.append(np.asarray(model.lower), 0.5)
    high = np.append(np.asarray(model.upper), 1.5)

    def search(natural: np.ndarray, scale: float) -> Posture:
        centre = np.append(natural, scale)
        constraints = [
            {"type": "eq", "fun": lambda x: at(x)[0][0], "jac": lambda x: at(x)[1][0]},
            {"type": "ineq", "fun": lambda x: at(x)[0][1] - tilt[0], "jac": lambda x: at(x)[1][1]},
            {"type": "ineq", "fun": lambda x: tilt[1] - at(x)[0][1], "jac": lambda x: -at(x)[1][1]},
        ]
        done = minimize(
            lambda x: float(np.sum(((x - centre) / unit) ** 2)),
            np.clip(centre, low, high),
            jac=lambda x: 2 * (x - centre) / unit**2,
            bounds=list(zip(low, high, strict=True)),
            constraints=constraints,
            method="SLSQP",
            options={"maxiter": 200, "ftol": 1e-10},
        )
        c, angle = (np.asarray(item) for item in parts(done.x))
        reached = abs(np.sum(c) * stiffness - 1) < TOLERANCE
        return Posture(
            q=done.x[:-1],
            scale=float(done.x[-1]),
            stiffness=float(1 / np.sum(c)),
            distance=float(np.sqrt(done.fun)),
            share=c / np.sum(c),
            tilt=float(angle),
            found=bool(done.success and reached),
        )

    return search


def _scaled(model: Model, scale):
    return jnp.asarray(model.body_position) * scale, jnp.asarray(model.pad_centre) * scale
