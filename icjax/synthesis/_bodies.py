"""What a body answers to a contact solver over one step: its free displacement and its admittance."""

import equinox as eqx
import jax.numpy as jnp

from icjax.model import Model, difference
from icjax.typing import Float, Real


class Admittance(eqx.Module):
    """Displacement of a body's coordinates over one step, affine in the contact forces: dq = free + A J^T f.

    **Fields**: `free` dq without contact forces; `matrix` A, symmetric positive semidefinite.
    """

    free: Float[Real, " nv"]
    matrix: Float[Real, "nv nv"]


class Target(eqx.Module):
    """Where the hand wants to be at the end of a step, and how firmly: one row of an interaction trajectory.

    **Fields**

    - `reference`: theta_r(k+1), rad, m.
    - `compliance`: C(k+1), rad/Nm, m/N, zero on driven degrees of freedom: its diagonal, or the whole symmetric
      positive semidefinite matrix `[*time, nv, nv]`.
    - `wrench`: on the objects besides gravity and contact, torque about the centre of mass and force, world axes, Nm,
      N; None for none.
    - `path`: where the driven objects are at the end of the step, in their order: origin of their frame, m, and
      quaternion (w, x, y, z); None where they stay.
    """

    reference: Float[Real, "*time nq"]
    compliance: Float[Real, "*time nv"] | Float[Real, "*time nv nv"]
    wrench: Float[Real, "*time object 6"] | None = None
    path: Float[Real, "*time driven 7"] | None = None


class QuasiStaticHand(eqx.Module):
    """The massless compliant hand of Section 7: always in (linearised) equilibrium with its springs.

    dq = difference(theta(k) -> theta_r(k+1)) + C(k+1) J^T f(k+1)

    Starting from theta(k), not theta_r(k), carries the equilibrium error of Eq. 7 into the step, the remark of
    Section 7.1.3 about replaced contact points. For C(k+1) = C(k) the step is Eq. 10 with that correction; for
    varying C it adds J (C(k+1) - C(k)) J^T f(k), which Eq. 10 drops. A driven degree of freedom (a moving forearm)
    has C = 0 and follows its reference exactly. It is the limit of the dynamic hand,
    h^2 (M + h B + h^2 K)^-1 -> K^-1 = C, as M and B go to zero.
    """

    model: Model

    def admittance(self, q: Float[Real, " nq"], target: Target) -> Admittance:
        """Free displacement and admittance over the step from `q` to `target`."""
        compliance = jnp.asarray(target.compliance)
        matrix = jnp.diag(compliance) if compliance.ndim == 1 else compliance
        return Admittance(free=difference(self.model, q, target.reference), matrix=matrix)
