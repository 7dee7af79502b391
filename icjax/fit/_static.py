"""Measured angles and torques: the compliance without a simulation."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from icjax.fit._parameters import Values
from icjax.fit._roles import check_array, check_sd, check_time, check_uses, counted, of_role, used
from icjax.typing import Bool, Float, Real

ROLES = ("compliance", "reference")


class StaticEquilibrium(eqx.Module):
    r"""Joint angles in equilibrium with measured torques: $\theta = \theta_r + C \tau$ (Eq. 7).

    $$r = (\theta - \theta_0 - B d - C \tau) / \sigma$$

    One trial's theta_r is nominal $\theta_0$ plus a deviation $B d$ in a basis. Trials of one intended movement on
    different surfaces use the same "reference"; only so do they determine C. A free reference of each trial explains
    any C (`laplace` then says infinite). Catch trials without contact, or a reference that is known, need no
    "reference": leave `basis` None. Errors of the torque are not part of the model: of noisy torques C comes out
    too small.

    **Parameters** of which `uses` names those that the fit may change

    - "compliance": `[joint]` the diagonal or `[joint, joint]`, rad/Nm. Without it: `compliance`.
    - "reference", or "reference of ..." of some movement: d `[basis, joint]`, rad. Without it: zero.

    **Arguments** are the fields, and `time` `[time]` s of the samples, which must increase; `uses`, default
    "compliance" unless one is given, and with a basis "reference".

    **Fields**: `name`; `uses`; `angles` and `torque` `[time, joint]` measured, rad and Nm (of external forces on the
    joints); `angle_sd` rad, one number, one a joint or one a sample; `nominal` theta_0 `[time, joint]`, rad, default
    zero; `basis` B `[time, basis]` ([`spline_basis`]); `compliance` where it is no parameter; `counts` `[time]` which
    samples count, default all.

    **Errors**: `ValueError` for shapes that do not agree, numbers that are not finite in a sample that counts,
    standard deviations that are not positive, and parameters of no known role.
    """

    name: str = eqx.field(static=True)
    uses: tuple[str, ...] = eqx.field(static=True)
    angles: Float[Real, "time joint"]
    torque: Float[Real, "time joint"]
    angle_sd: Float[Real, "..."]
    nominal: Float[Real, "time joint"]
    basis: Float[Real, "time basis"] | None
    compliance: Float[Real, "joint ..."] | None
    counts: Bool[Real, " time"]

    def __init__(
        self,
        name: str,
        time: Any,
        angles: Any,
        torque: Any,
        angle_sd: Any,
        *,
        uses: Sequence[str] | None = None,
        nominal: Any = None,
        basis: Any = None,
        compliance: Any = None,
        counts: Any = None,
    ):
        what = f"measurement {name!r}"
        uses = used(what, uses, compliance=compliance is None, reference=basis is not None)
        check_uses(what, uses, ROLES)
        rows = check_time(f"{what}: time", time).size
        if np.ndim(angles) != 2:
            raise ValueError(f"{what}: angles must be [time, joint]; got {list(np.shape(angles))}")
        shape = rows, np.shape(angles)[1]
        nominal = np.zeros(shape) if nominal is None else nominal
        mask = counted(what, counts, rows)
        for label, value in (("angles", angles), ("torque", torque), ("nominal", nominal)):
            check_array(f"{what}: {label}", value, shape, "time, joint", mask)
        check_sd(f"{what}: angle_sd", angle_sd, shape)
        shared = {one.split(" of ", 1)[0] for one in uses}
        if ("reference" in shared) != (basis is not None):
            raise ValueError(f"{what}: a basis and a parameter 'reference' belong together; uses {uses}")
        if basis is not None:
            check_array(f"{what}: basis", basis, (rows, np.shape(basis)[-1]), "time, basis")
        if ("compliance" in shared) == (compliance is not None):
            raise ValueError(f"{what}: either uses 'compliance' or states its compliance")
        self.name, self.uses, self.counts = name, tuple(uses), mask
        self.angles, self.torque, self.nominal = (
            jnp.where(mask[:, None], jnp.asarray(value, float), 0.0) for value in (angles, torque, nominal)
        )
        self.angle_sd = jnp.asarray(angle_sd, float)
        self.basis = None if basis is None else jnp.asarray(basis, float)
        self.compliance = None if compliance is None else jnp.asarray(compliance, float)

    def predict(self, values: Values) -> Float[Real, "time joint"]:
        """Angles in equilibrium with the measured torques, rad."""
        stated, deviation = (of_role(self.uses, values, one) for one in ROLES)
        compliance = jnp.asarray(self.compliance if stated is None else stated)
        joints = self.angles.shape[1]
        if np.shape(compliance) not in ((joints,), (joints, joints)):
            raise ValueError(
                f"measurement {self.name!r}: compliance must be [{joints}] or [{joints}, {joints}]; "
                f"got {list(np.shape(compliance))}"
            )
        given = self.torque * compliance[None, :] if compliance.ndim == 1 else self.torque @ compliance.T
        reference = self.nominal if deviation is None else self.nominal + deviated(self.name, self.basis, deviation)
        return reference + given

    def residual(self, values: Values) -> Float[Real, " row"]:
        """(measured - predicted) / sd, `[time * joint]`; zero where a sample does not count."""
        off = (self.angles - self.predict(values)) / jnp.broadcast_to(self.angle_sd, self.angles.shape)
        return jnp.where(self.counts[:, None], off, 0.0).reshape(-1)


def deviated(name: str, basis: Any, deviation: Any) -> Any:
    """B d. **Errors**: `ValueError` for d of another size."""
    if np.ndim(deviation) != 2 or np.shape(deviation)[0] != basis.shape[1]:
        raise ValueError(
            f"measurement {name!r}: reference must be [{basis.shape[1]}, joint], a row a function of the basis; "
            f"got {list(np.shape(deviation))}"
        )
    return basis @ deviation
