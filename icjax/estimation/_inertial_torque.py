"""The inertial part of the contact torque: a correction of Eq. 2 (section 4.3)."""

import equinox as eqx
import numpy as np

from icjax.estimation._joints import angle_courses
from icjax.estimation._smooth_motion import Motion
from icjax.model import Model, mass_matrix
from icjax.recording import Recording
from icjax.typing import Float, Real


def inertial_torque(
    recording: Recording, motion: Motion, onset: float, window: float, degree: int
) -> Float[np.ndarray, "time dof"]:
    """M e'' + B e' after a contact, e being the deviation from the movement that would have gone on without it.

    Until the contact e is zero and both movements obey the same muscles. After it the contact torque accelerates,
    is lost in damping and loads the springs,

        M e'' + B e' + C^-1 e = J^T f    (gravity and Coriolis terms at the two postures taken as equal),

    so that Eq. 1 holds for J^T f - M e'' - B e', not for J^T f. The contact-free movement is the paper's: the
    polynomial of `degree` fitted to the `window` before the onset and extrapolated. M is the mass matrix at the onset
    with everything that the joints carry, B the model's damping (zero where the model states none).

    **Arguments**: `motion` of `smooth_motion`; `onset`, `window` s.

    **Returns** `[time, dof]`, Nm; zero before the onset, NaN where the window holds too few frames or the pose is
    unknown.

    Source: Kry and Pai 2006, section 4.3.
    """
    model = recording.model
    s = np.asarray(recording.time) - onset
    course = angle_courses(model, recording.q, tuple(range(model.nv)))
    usable = np.asarray(recording.valid) & np.isfinite(course).all(axis=1)
    before = usable & (s <= 0) & (s >= -window - 1e-6 / recording.rate)
    after = s > 0
    torque = np.where(after[:, None], np.nan, np.zeros((len(s), model.nv)))
    if before.sum() < degree + 3:
        return torque
    fit = np.polynomial.polynomial.polyfit(s[before], course[before], degree)
    slope, bend = (np.polynomial.polynomial.polyder(fit, order) for order in (1, 2))
    v, a = (np.polynomial.polynomial.polyval(s[after], item).T for item in (slope, bend))
    M = np.asarray(_mass_matrix(model, np.asarray(recording.q)[np.flatnonzero(before)[-1]]))
    B = np.asarray(model.damping)
    torque[after] = (motion.a[after] - a) @ M.T + (motion.v[after] - v) * B
    return torque


@eqx.filter_jit
def _mass_matrix(model: Model, q: Float[Real, " nq"]) -> Float[Real, "nv nv"]:
    return mass_matrix(model, q)
