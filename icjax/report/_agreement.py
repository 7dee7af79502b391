"""Does the compliance depend on the choices that the method leaves open, and what speaks for or against each event."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from icjax import view
from icjax.estimation import EstimationOptions, Sensitivity, excitation, explain, joint_torque, sensitivity
from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.report._page import absent, figure, folded, paragraph

WINDOWS = (0.04, 0.06, 0.08, 0.1)
"""s; few, so that the page is quick."""


class Agreement(NamedTuple):
    """Estimates over windows and degrees, and a sentence an event and joint."""

    sensitivity: Sensitivity
    reasons: tuple[tuple[str, ...], ...]


def agreement(recordings: Sequence[Recording], interactions: Sequence[Interaction]) -> Agreement | None:
    """Repeat the first interaction's estimate over windows; None where its trials are not all at hand."""
    if not interactions:
        return None
    per_event = interactions[0].per_event
    names = set(per_event.recording)
    trials = tuple(item for item in recordings if item.role == "trial" and item.name in names)
    known = [item.name for item in trials for _ in np.asarray(item.events.onset)]
    onsets = [float(onset) for item in trials for onset in np.asarray(item.events.onset)]
    complete = tuple(known) == per_event.recording and np.array_equal(onsets, np.asarray(per_event.onset))
    if not known or not complete or not set(per_event.joint_names) <= set(trials[0].model.dof_names):
        return None
    before, after = (float(value) for value in np.asarray(per_event.window))
    degree = np.asarray(per_event.angle_before).shape[2] - 1
    options = EstimationOptions(
        window_before=before, window_after=after, degree=degree, joints=tuple(per_event.joint_names)
    )
    own = {item.name: np.asarray(item.torque) for item in interactions}
    torques = tuple(own[item.name] if item.name in own else np.asarray(joint_torque(item)) for item in trials)
    repeated = sensitivity(trials, WINDOWS, options=options, torques=torques)
    return Agreement(repeated, explain(per_event, excitation(trials, options, torques), repeated, options))


def agreement_text(found: Agreement | None, truth: Mapping[str, float], units: Mapping[str, str] | None = None) -> str:
    """The figure and every event's sentence, or a box that says what is missing."""
    heading = "<h3>Does it depend on the windows?</h3>"
    if found is None:
        return heading + absent("The recordings behind these estimates are not at hand, so they were not repeated.")
    repeated = found.sensitivity
    drawing = view.plot_sensitivity(repeated, truth, units)
    stable = ", ".join(
        f"{name} {int(count)}"
        for name, count in zip(repeated.joint_names, np.asarray(repeated.stable).sum(axis=0), strict=True)
    )
    body = heading + paragraph(
        "The method leaves the length of the windows and the degree of the polynomials open. Where the choice decides "
        "the answer, the contact has none. An estimate is called stable if its spread over the choices is below half "
        "of its value, its sign does not change and its error is below its value. Stable ones, of "
        f"{len(repeated.onset)} contacts: {stable}. A bias that all windows share does not show here."
    )
    body += figure(
        view.svg(drawing, "sensitivity", "compliance of every joint against the length of the windows"),
        "Thin lines are single contacts, thick ones the pooled value with its 95 % interval; a dotted line is its "
        "upper end where the pooled value is not positive."
        + (" The true compliance of the virtual subject is dashed." if truth else ""),
    )
    lines = [
        f"{name} {float(onset):8.3f} s  {joint}: {reason}"
        for name, onset, row in zip(repeated.recording, np.asarray(repeated.onset), found.reasons, strict=True)
        for joint, reason in zip(repeated.joint_names, row, strict=True)
    ]
    return body + folded("Why each estimate was accepted or not", "\n".join(lines))
