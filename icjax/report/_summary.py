"""What the page says first, in plain words."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from icjax.fit import FitRecord
from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.view import scene_name

Recordings = Sequence[Recording]
Interactions = Sequence[Interaction]
Rollouts = Sequence[Rollout]
Fits = Sequence[FitRecord]


def is_simulated(
    records: Sequence[Recording | Interaction | FitRecord], metrics: Mapping[str, Any] | None = None
) -> bool | None:
    """What the records' provenance says about the recording: simulated, not simulated, or nothing (None).

    Looked for: an entry `simulated` that is true or false, or metrics whose `data` begins with that word.
    """
    if str((metrics or {}).get("data", "")).startswith("simulated"):
        return True
    found = [_find(_parsed(item.provenance), "simulated") for item in records]
    found.append(_find(metrics, "simulated"))
    known = [value for value in found if isinstance(value, bool)]
    return any(known) if known else None


def lead(
    recordings: Recordings,
    interactions: Interactions,
    rollouts: Rollouts,
    simulated: bool | None,
    fits: Fits = (),
) -> str:
    """One paragraph: what was recorded, what was estimated from it, where it was carried."""
    parts = []
    kind = {True: "simulated ", False: "", None: ""}[simulated]
    trials = [item for item in recordings if item.role == "trial"]
    if recordings:
        others = len(recordings) - len(trials)
        contacts = sum(len(item.events.onset) for item in trials)
        seconds = sum(float(item.time[-1] - item.time[0]) for item in recordings)
        extra = f" and {_count(others, 'other recording')}" if others else ""
        duration = f"{seconds:.1f} s in all"
        parts.append(f"{_count(len(trials), kind + 'trial')}{extra} ({duration}) with {_count(contacts, 'contact')}.")
    if interactions:
        summary = interactions[0].summary
        found = [
            f"{joint} {_number(value)}"
            for joint, value in zip(summary.joint_names, np.asarray(summary.compliance), strict=True)
        ]
        listed = f": {', '.join(found)} rad/Nm." if 0 < len(found) <= 6 else f"; the table lists {len(found)}."
        parts.append(
            "From the change of joint angle and torque at each contact the compliance of the joints was estimated "
            "(biased: inertia, damping and planned deceleration; see the caution)" + listed + " With it follows the "
            "reference trajectory, where the joints would have gone without contact."
        )
    else:
        parts.append("No interaction has been estimated yet." if not fits else "")
    parts += [_fit_lead(item) for item in fits]
    if rollouts:
        names = ", ".join(scene_name(item) for item in rollouts)
        parts.append(
            f"The interaction was then carried by contact simulation to {_count(len(rollouts), 'scene')}: {names}."
        )
    return " ".join(part for part in parts if part)


def _fit_lead(fit: FitRecord) -> str:
    found = [
        f"{joint} {'refused' if refused else _number(float(value))}"
        for joint, value, refused in zip(fit.joint_names, fit.compliance, fit.refused, strict=True)
    ]
    listed = f": {', '.join(found)} rad/Nm" if len(found) <= 6 else f"; the table lists {len(found)}"
    parts = len(fit.periods.period_names)
    listed += f" (geometric means of {parts} parts in which it may differ)." if parts > 1 else "."
    against = _count(fit.catch_trials, "catch trial") if fit.catch_trials else "what was foretold (no catch trials)"
    return (
        f"All contacts of the session {fit.name} together, held against {against}, "
        "gave compliances with inertia, damping and planned movement accounted for" + listed
    )


def key_figures(
    recordings: Recordings, interactions: Interactions, rollouts: Rollouts, fits: Fits = ()
) -> list[tuple[str, str]]:
    """The tiles under the title."""
    figures = []
    if recordings:
        forces = [
            np.linalg.norm(np.nan_to_num(item.contact_force), axis=-1).max(initial=0.0)
            for item in recordings
            if item.role == "trial"
        ]
        scope = "the one trial" if len(forces) == 1 else f"all {len(forces)} trials"
        contacts = sum(len(item.events.onset) for item in recordings if item.role == "trial")
        figures.append((str(contacts), f"contacts, {scope}"))
        if any(item.contact_names for item in recordings):
            figures.append((f"{max(forces, default=0.0):.2f} N", f"largest contact force, {scope}"))
        every = "the one recording" if len(recordings) == 1 else f"all {len(recordings)} recordings"
        residual = np.concatenate([np.asarray(item.marker_residual).ravel() for item in recordings])
        if np.isfinite(residual).any():
            figures.append((f"{1e3 * np.nanmedian(residual):.2f} mm", f"median marker residual, {every}"))
    if interactions:
        summary, trials = interactions[0].summary, len(set(interactions[0].per_event.recording))
        pooled = f"events of {_count(trials, 'trial')}"
        accepted, events = int(np.sum(summary.accepted)), int(np.sum(summary.events))
        figures.append((f"{accepted} of {events}", f"joint estimates accepted, {pooled}"))
    for fit in fits:
        given = sum(not reason for reason in fit.refused)
        figures.append((f"{given} of {len(fit.refused)}", f"joints fitted, not refused, session {fit.title}"))
    if rollouts:
        failed = sum(int((np.asarray(item.status) != 0).sum()) for item in rollouts)
        scenes = "the one rollout" if len(rollouts) == 1 else f"all {len(rollouts)} rollouts"
        steps = sum(len(item.time) for item in rollouts)
        figures.append((f"{failed} of {steps}", f"simulation steps failed, {scenes}"))
    return figures


def cautions(interactions: Interactions, rollouts: Rollouts, simulated: bool | None, fits: Fits = ()) -> list[str]:
    """What a reader must know before using the numbers."""
    said = {
        True: "The recording is simulated: no person was measured. It shows"
        " that the program works, not how people move.",
        False: "The recording is said to be of a real subject.",
        None: "The recording does not say whether it was measured or simulated.",
    }
    points = [said[simulated]]
    if interactions:
        points.append(
            f"The intervals {'of the estimates ' if fits else ''}cover the scatter between contacts, not the bias of "
            "the estimator: inertia, damping and a planned change of movement at contact look like compliance and "
            "shift every event the same way."
        )
        blind = _find(_parsed(interactions[0].provenance), "normal_only")
        if blind and isinstance(blind, list):
            points.append(
                f"Normal force only: {', '.join(map(str, blind))}. No tangential force was measured there, so joint "
                "torques and everything made from them are biased, and friction is unknown."
            )
        negative = int(np.sum(interactions[0].summary.negative))
        if negative:
            points.append(
                f"Negative estimates: {negative}. They are kept and shown; leaving them out of the summary would bias "
                "it upward."
            )
    if fits:
        points.append(
            "The intervals of the fit hold if its model does: compliance constant wherever the fit takes it for one, "
            "trials that vary as catch trials or free movement do. A refused joint has bounds and no number."
        )
    if rollouts:
        points.append(
            "The transfer is quasi-static: no inertia and no damping. Expect the largest errors in the first 100 ms of "
            "a contact."
        )
        if any(item.object_names for item in rollouts):
            points.append(
                "That is said of the hand: objects have inertia and are rigid. A hand that would carry on with its own "
                "momentum gives way at once, and blows last one time step."
            )
        failed = sum(int((np.asarray(item.status) != 0).sum()) for item in rollouts)
        if failed:
            steps = _count(failed, "simulation step")
            points.append(f"Not solved: {steps}; the table of rollouts gives times and causes.")
    return points


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _number(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "not estimated"


def _parsed(content: str) -> object:
    try:
        return json.loads(content)
    except (json.JSONDecodeError, TypeError):
        return None


def _find(value: object, key: str) -> object:
    """The first entry named `key` anywhere in nested dictionaries and lists, else None."""
    if isinstance(value, Mapping):
        if key in value:
            return value[key]
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            found = _find(item, key)
            if found is not None:
                return found
    return None
