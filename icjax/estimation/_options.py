"""What a user may choose, checked when it is chosen."""

import dataclasses
import math
from typing import Literal

LONGEST_WINDOW = 1.0
"""s; ten times the delay of a spinal reflex. Over a longer window the response is a new movement, not compliance."""


@dataclasses.dataclass(frozen=True)
class EstimationOptions:
    """Choices of the compliance estimate and of the reference trajectory.

    The defaults follow section 3.3 of Kry and Pai 2006, not any known answer. A spinal reflex needs about 100 ms
    to change muscle force, so up to 100 ms after contact the response is the compliance that was set beforehand:
    the window after contact is that whole time (50 samples at 500 Hz, as in the paper), and the window before it
    is as long, so that both slopes are known equally well. Over 100 ms neither the movement nor the contact
    torque is straight, so the polynomials are quadratic; with windows of 50 ms or less the linear fit of Figure 3
    is the better choice.

    **Arguments**

    - `window_before`, `window_after`: lengths of the windows on either side of the onset, s; at most `LONGEST_WINDOW`.
    - `degree`: 1 (linear) or 2 (quadratic).
    - `coverage`: least part of each window that must be free of other contacts, of the recording's ends and of
      invalid frames; below it the event has too few samples.
    - `excitation`: the torque's change in the window and its rate at contact must exceed this many times their
      own noise, otherwise the joint is not excited.
    - `least_torque`: Nm; smaller changes of torque never count as excitation. The default is the noise of an
      ordinary six-axis sensor, 10 mN, at the length of a finger, 0.1 m.
    - `pool_negative`: keep negative estimates in the pooled value. Leaving them out, as the paper does, biases
      what remains upward, because noise of one sign is removed.
    - `source`: "event" holds each event's own estimate where it was accepted and its standard error is below its
      value (an error as large as the value says nothing about the value), else the session's pooled value;
      "session" uses the pooled value throughout. Where the pooled value is not finite, the one that the model
      states stands for it.
    - `blend`: s before an onset in which one compliance changes smoothly into the next.
    - `joints`: names of the joints to estimate (a joint's name or that of one of its degrees of freedom); empty
      means every compliant joint of the model.
    - `inertia`: subtract the inertial and damping part M e'' + B e' from the contact torque (`inertial_torque`,
      section 4.3). Needs the person's masses in the model. Off by default: `experiments/inertia_correction.py`
      measures what it does.
    - `inertia_cutoff`: Hz, of the smoothing spline that e' and e'' are taken from; that of the marker filter.
    - `given`: rad/Nm for joints (or degrees of freedom) whose compliance is already known from other recordings
      (section 8.2); it replaces the estimate in the reference trajectory.
    - `given_sd`: rad/Nm, standard deviation of the given values, zero where not stated.

    **Errors**: `ValueError` naming the argument and its value.

    Source: Kry and Pai 2006, sections 3.3, 3.4, 4.3, 8.2.
    """

    window_before: float = 0.1
    window_after: float = 0.1
    degree: int = 2
    coverage: float = 0.5
    excitation: float = 3.0
    least_torque: float = 1e-3
    pool_negative: bool = True
    source: Literal["event", "session"] = "event"
    blend: float = 0.05
    joints: tuple[str, ...] = ()
    inertia: bool = False
    inertia_cutoff: float = 20.0
    given: dict[str, float] = dataclasses.field(default_factory=dict)
    given_sd: dict[str, float] = dataclasses.field(default_factory=dict)

    def __post_init__(self):
        for name in ("window_before", "window_after"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} = {value}: a window must be longer than 0 s")
            if value > LONGEST_WINDOW:
                raise ValueError(
                    f"{name} = {value}: a window is at most {LONGEST_WINDOW:g} s (reflexes act after 0.1 s)"
                )
        if self.degree not in (1, 2):
            raise ValueError(f"degree = {self.degree}: must be 1 (linear) or 2 (quadratic)")
        if not 0 < self.coverage <= 1:
            raise ValueError(f"coverage = {self.coverage}: must be above 0 and at most 1")
        for name in ("excitation", "least_torque", "blend"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{name} = {value}: must be zero or more")
        if not (math.isfinite(self.inertia_cutoff) and self.inertia_cutoff > 0):
            raise ValueError(f"inertia_cutoff = {self.inertia_cutoff}: must be above 0 Hz")
        if self.source not in ("event", "session"):
            raise ValueError(f"source = {self.source!r}: must be 'event' or 'session'")
        for name in ("given", "given_sd"):
            for joint, value in getattr(self, name).items():
                if not (math.isfinite(value) and value >= 0):
                    raise ValueError(f"{name}[{joint!r}] = {value}: must be zero or more and finite")
        unmatched = set(self.given_sd) - set(self.given)
        if unmatched:
            raise ValueError(f"given_sd[{min(unmatched)!r}]: no value of that name is in given")
