# pyright: reportGeneralTypeIssues=false
# (the checker does not see that `labelled`, `names` and `static` declare fields without a default)
"""The paper's estimate repeated over the choices that it leaves open: lengths of the windows and degree."""

import dataclasses
from itertools import product

import equinox as eqx
import numpy as np

from icjax.estimation._contact_compliance import compliance_at_contact
from icjax.estimation._options import EstimationOptions
from icjax.estimation._stability import judge
from icjax.estimation._summary import summarise
from icjax.estimation._torque import joint_torque
from icjax.files import labelled, names, static
from icjax.recording import Recording
from icjax.typing import Bool, Float, Int, Real

WINDOWS = (0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1)
"""s; from fifteen samples at 500 Hz to the delay of a spinal reflex, after which the response is no compliance."""


class Sensitivity(eqx.Module):
    """Estimates of section 3.3 over a grid of windows and degrees, and whether they agree.

    `stable` and `reason` follow the rule of `stability`; `reason[event][joint]` is a sentence with its numbers.
    """

    recording: tuple[str, ...] = names("event")
    joint_names: tuple[str, ...] = names("joint")
    onset: Float[Real, " event"] = labelled("event", unit="s")
    window: Float[Real, "window side"] = labelled("window", "side", unit="s", doc="length before and after the onset")
    degree: Int[Real, " degree"] = labelled("degree", unit="1", doc="of the polynomials")
    compliance: Float[Real, "event joint window degree"] = labelled(
        "event", "joint", "window", "degree", unit="rad/Nm", doc="NaN where there is no estimate"
    )
    standard_error: Float[Real, "event joint window degree"] = labelled(
        "event", "joint", "window", "degree", unit="rad/Nm"
    )
    status: Int[Real, "event joint window degree"] = labelled(
        "event", "joint", "window", "degree", unit="1", doc="index into STATUS"
    )
    pooled: Float[Real, "joint window degree"] = labelled(
        "joint", "window", "degree", unit="rad/Nm", doc="over the events, as `summarise` does"
    )
    lower: Float[Real, "joint window degree"] = labelled("joint", "window", "degree", unit="rad/Nm")
    upper: Float[Real, "joint window degree"] = labelled("joint", "window", "degree", unit="rad/Nm")
    stable: Bool[Real, "event joint"] = labelled("event", "joint", unit="1")
    reason: tuple[tuple[str, ...], ...] = static()  # [event][joint]


def sensitivity(
    recordings: tuple[Recording, ...],
    windows: tuple[float, ...] = WINDOWS,
    degrees: tuple[int, ...] = (1, 2),
    options: EstimationOptions | None = None,
    torques: tuple[Float[Real, "_ dof"], ...] | None = None,
    separate: bool = False,
) -> Sensitivity:
    """The estimate of `compliance_at_contact` over lengths of windows and degrees of polynomials.

    The method fixes neither ("small windows", "linear or quadratic depending on data quality"). Where the choice
    decides the answer, the event has none; where it does not, the choice was right enough. Agreement does not
    prove an estimate: a bias that all windows share stays (see `docs/estimator.md`).

    **Arguments**

    - `recordings`: of one subject's model.
    - `windows`: lengths, s; the same before and after the onset.
    - `degrees`: 1 (linear), 2 (quadratic).
    - `options`: everything else; its own windows and degree are not used.
    - `torques`: `joint_torque` of each recording, Nm, if already computed.
    - `separate`: also every pair of different lengths before and after.

    **Returns** the estimates and the rule's verdict, events in order of recording and onset.

    **Errors**: `ValueError` for no window or degree, a repeated one, and as in `compliance_at_contact`.

    Source: Kry and Pai 2006, sections 3.3 and 4.3.
    """
    for name, values in (("windows", windows), ("degrees", degrees)):
        if not values or len(set(values)) != len(values):
            raise ValueError(f"{name} = {tuple(values)}: give at least one, each once")
    options = options or EstimationOptions()
    pairs = tuple(product(windows, windows)) if separate else tuple((window, window) for window in windows)
    if torques is None:
        torques = tuple(np.asarray(joint_torque(recording)) for recording in recordings)
    tables, pools = [], []
    for (before, after), degree in product(pairs, degrees):
        choice = dataclasses.replace(options, window_before=before, window_after=after, degree=degree)
        tables.append(compliance_at_contact(recordings, choice, torques))
        pools.append(summarise(tables[-1], options.pool_negative))

    def grid(items: list, field: str) -> np.ndarray:
        """Stack a field of every choice: `[..., window, degree]`."""
        stacked = np.stack([np.asarray(getattr(item, field)) for item in items], axis=-1)
        return stacked.reshape(*stacked.shape[:-1], len(pairs), len(degrees))

    first = tables[0]
    compliance, error, status = (grid(tables, field) for field in ("compliance", "standard_error", "status"))
    change = np.abs(grid(tables, "torque_change"))
    verdicts = [
        [judge(compliance[e, j], error[e, j], status[e, j], change[e, j]) for j in range(len(first.joint_names))]
        for e in range(len(first.onset))
    ]
    return Sensitivity(
        recording=first.recording,
        joint_names=first.joint_names,
        onset=first.onset,
        window=np.asarray(pairs, dtype=float),
        degree=np.asarray(degrees, dtype=np.int32),
        compliance=compliance,
        standard_error=error,
        status=status,
        pooled=grid(pools, "compliance"),
        lower=grid(pools, "lower"),
        upper=grid(pools, "upper"),
        stable=np.asarray([[item.stable for item in row] for row in verdicts], dtype=bool).reshape(change.shape[:2]),
        reason=tuple(tuple(item.reason for item in row) for row in verdicts),
    )
