"""What a user may choose about a fit, checked when it is chosen."""

import dataclasses
import math

from icjax.inference import QUANTILE

RANGES = {
    "after": (0.03, 1.0),
    "before": (0.05, 2.0),
    "settle": (0.0, 2.0),
    "spacing": (1e-3, 0.03),
    "shift_sd": (1e-4, 0.2),
}
"""s. Less before or after a contact tells nothing, more is another movement; outside, milliseconds are likely meant."""


PERIODS = ("session", "trial", "contact")
"""In which compliance is one."""


@dataclasses.dataclass(frozen=True)
class FitOptions:
    """Choices of the fit of compliance to the dynamic response after contact.

    Reasons of the defaults: up to about 100 ms after a contact muscles act as they were set beforehand
    (reflexes), a voluntary approach lasts about a quarter of a second, hands weigh what textbooks say to
    within a factor of two, the compliance of joints goes from 0.03 (a tight grasp) to 10 rad/Nm (fingers at
    rest), joints are damped at a ratio of a third to critical or above. The width of the
    masses' prior and the offsets among the parameters were settled while developing on simulated sessions
    whose truth was known: figures on those sessions are no independent test.

    **Arguments**

    - `after`: s after the onset that are compared; `before`: s before it, which hold the repetitions against the trial;
      `settle`: s after a release in which the last contact still rings.
    - `spacing`: s between compared samples; markers are filtered at 20 Hz, closer ones say nothing new.
    - `compliance_sd`: of log C about the model's own value (or `typical_compliance` rad/Nm where it states none); at
      least twice the standard deviation that `widest` allows, log(widest) / 1.96, so that no joint gets the prior's
      number.
    - `compliance_by`: "session", "trial" or "contact": where compliance may change. It is then hierarchical: what all
      have in common is what `compliance_sd` is about, and log C of each deviates from it by `compliance_change`.
    - `damping_time`, `damping_time_sd`: s, B = T / C, and the deviation of a person's log T.
    - `damping_time_spread`: of each joint's log T about that of the person; muscle is much the same everywhere.
    - `inertia_sd`: of the logarithm of a segment's mass (its inertia with it).
    - `shift_sd`: s, by which a repetition's movement may start earlier or later.
    - `widest`: an interval whose ends differ by more than this factor is refused: the joint has no number, only bounds.

    **Errors**: `ValueError` naming the argument and its value.
    """

    after: float = 0.1
    before: float = 0.25
    settle: float = 0.15
    spacing: float = 0.008
    typical_compliance: float = 0.5
    compliance_sd: float = 1.5
    compliance_by: str = "session"
    compliance_change: float = 0.3
    damping_time: float = 0.03
    damping_time_sd: float = 0.7
    damping_time_spread: float = 0.4
    inertia_sd: float = 0.5
    shift_sd: float = 0.015
    widest: float = 4.0

    def __post_init__(self):
        if self.compliance_by not in PERIODS:
            raise ValueError(f"compliance_by = {self.compliance_by!r}: must be one of {', '.join(PERIODS)}")
        for field in dataclasses.fields(self):
            if field.name == "compliance_by" or field.name in RANGES:
                continue
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{field.name} = {value}: must be above zero and finite")
        for name, (least, most) in RANGES.items():
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"{name} = {getattr(self, name)} s: must be {least:g} to {most:g} s")
        if self.widest <= 1.0:
            raise ValueError(f"widest = {self.widest}: must be above 1")
        least = math.log(self.widest) / QUANTILE
        if self.compliance_sd < least:
            raise ValueError(
                f"compliance_sd = {self.compliance_sd} with widest = {self.widest}: must be at least {least:.2g}, or a "
                "joint that the contacts hardly told would get the prior's number"
            )
