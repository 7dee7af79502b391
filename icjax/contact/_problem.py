"""The contact problem of one step and its answer."""

import equinox as eqx
import numpy as np

from icjax.typing import Bool, Float, Int, Real, Scalar


class ContactProblem(eqx.Module):
    """N contact slots of one time step; every force acts on the first body of its ordered pair.

    The relative displacement of the first body over the step is ``du = W f + du_free`` (Eq. 10 in admittance form:
    ``W = J A J^T + C_pad``, ``du_free = J dq_free - P_t C_pad f(k)``).

    R limits (joint limits, or any other one-sided rows) may follow the contacts: a clearance that must stay at least
    zero, and its generalised force; ``theta - theta_min`` and ``theta_max - theta`` (rad) with torques (Nm), say.

    **Fields**

    - `coupling`: W, symmetric positive semidefinite, m/N, world axes, three rows a contact, then one a limit.
    - `free_displacement`: du_free, m, world axes; then of each limit what its clearance grows by without force.
    - `gap`: `s_i0` at the start of the step, m, negative in penetration.
    - `frames`: columns normal (towards the first body), tangent 1, tangent 2; orthonormal, world.
    - `friction`: Coulomb coefficient, >= 0.
    - `active`: False masks a slot: it carries exactly zero force, does not influence the others, and its numbers
      (NaN included) are not read.
    - `limit_gap`: clearance of each limit at the start of the step, `[R]`, negative if it is violated; infinite for a
      limit that does not exist. Default none.
    """

    coupling: Float[Real, "component component"]
    free_displacement: Float[Real, " component"]
    gap: Float[Real, " contact"]
    frames: Float[Real, "contact 3 3"]
    friction: Float[Real, " contact"]
    active: Bool[Real, " contact"]
    limit_gap: Float[Real, " limit"] = eqx.field(default_factory=lambda: np.zeros(0))


class ContactForces(eqx.Module):
    """Forces and displacements of one step.

    **Fields**

    - `force`: on the first body, world axes, N; zero in masked and open slots.
    - `displacement`: relative displacement du of the step, pad included, world axes, m; zero in masked slots.
    - `slip_state`: 0 open or masked, 1 sticking, 2 sliding.
    - `margin`: dimensionless distance from a change of contact state, where the derivative jumps (see
      [`solve`][icjax.contact.solve]); infinite without active contacts. It has no derivative.
    - `limit_force`, `limit_displacement`: of each limit, its force (>= 0) and by how much its clearance has changed.
    """

    force: Float[Real, "contact 3"]
    displacement: Float[Real, "contact 3"]
    slip_state: Int[Real, " contact"]
    margin: Scalar
    limit_force: Float[Real, " limit"]
    limit_displacement: Float[Real, " limit"]
