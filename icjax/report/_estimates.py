"""The sections about the estimate: compliance of every joint, and what happened at the moment of contact."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from icjax import view
from icjax.interaction import STATUS, Interaction
from icjax.model import Model
from icjax.recording import Recording
from icjax.report._agreement import agreement, agreement_text
from icjax.report._page import Section, absent, figure, paragraph, table

Interactions = Sequence[Interaction]


def true_compliance(metrics: Mapping[str, Any] | None) -> dict[str, float]:
    """What the metrics say of a virtual subject: metrics["estimate"][joint]["true_compliance"], by joint."""
    entries = (metrics or {}).get("estimate")
    found: dict[str, float] = {}
    for joint, entry in entries.items() if isinstance(entries, Mapping) else ():
        value = entry.get("true_compliance") if isinstance(entry, Mapping) else None
        if isinstance(value, int | float) and np.isfinite(value):
            found[str(joint)] = float(value)
    return found


def compliance(
    interactions: Interactions, metrics: Mapping[str, Any] | None = None, recordings: Sequence[Recording] = ()
) -> Section:
    """Table of joint compliance with intervals and counts, every event behind it, and how far windows decide it."""
    heading = "Joint compliance"
    if not interactions:
        return Section("compliance", heading, absent("No interaction was given, so there is no compliance to show."))
    interaction = interactions[0]
    summary, per_event = interaction.summary, interaction.per_event
    truth, repeated = true_compliance(metrics), agreement(recordings, interactions)
    slides = {joint.name for joint in view.scalar_joints(interaction.model) if joint.kind == "slide"}
    units = dict.fromkeys(slides, "m/N")
    rows = []
    stable = dict.fromkeys(summary.joint_names, "")
    if repeated is not None:
        counts = np.asarray(repeated.sensitivity.stable).sum(axis=0)
        stable |= dict(zip(repeated.sensitivity.joint_names, map(str, counts), strict=True))
    for column, joint in enumerate(summary.joint_names):
        status = np.asarray(per_event.status)[:, column] if joint in per_event.joint_names else np.zeros(0, int)
        counts = [int((status == STATUS.index(name)).sum()) for name in STATUS]
        low, high = float(summary.lower[column]), float(summary.upper[column])
        name = f"{joint} (m/N)" if joint in slides else joint
        known = [f"{truth[joint]:#.3g}" if joint in truth else "not stated"] if truth else []
        numbers = [str(count) for count in (*counts, int(summary.events[column]))]
        numbers += [stable[joint]] if repeated is not None else []
        rows.append([name, value_text(float(summary.compliance[column])), interval_text(low, high), *known, *numbers])
    extra = ["truth (virtual subject)"] if truth else []
    head = [
        "joint",
        "compliance (rad/Nm)" if not slides else "compliance (rad/Nm where no unit is named)",
        "95 % interval",
        *extra,
        *STATUS,
        "events",
    ]
    head += ["stable"] if repeated is not None else []
    body = paragraph(
        "Compliance is how far a joint yields for each newton metre that contact puts on it (Eq. 1). A contact that "
        "barely loads a joint says nothing about it and is counted as not excited. Here and below, figure and equation "
        "numbers are those of Kry and Pai 2006."
    )
    body += table(head, rows)
    if len(per_event.onset) and per_event.joint_names == summary.joint_names:
        body += figure(
            view.svg(
                view.plot_compliance(per_event, summary, units),
                "compliance",
                "compliance of every joint at every contact",
            ),
            "Every contact event, numbered in order of onset. Bars are 95 % intervals of the single fit, with an "
            "arrowhead where they reach beyond the panel; the band is that of the summary. Open marks at the "
            "bottom are events without a usable estimate.",
        )
        body += agreement_text(repeated, truth, units)
    return Section("compliance", heading, body)


def contact(interactions: Interactions) -> Section:
    """Figure 3 for a good event and Figure 8 for a rejected one."""
    heading = "At the moment of contact"
    choices = [(item, *choice) for item in interactions for choice in [representative(item)]]
    chosen = next(((item, good) for item, good, _ in choices if good is not None), None)
    rejected = next(((item, bad) for item, _, bad in choices if bad is not None), None)
    if chosen is None and rejected is None:
        words = absent("There is no contact event with an estimate to show.")
        return Section("contact", heading, words + _joints_left_out(interactions))
    body = ""
    if chosen is not None:
        item, (event, joint) = chosen
        drawing = view.plot_contact_event(item, event, joint)
        body += figure(
            view.svg(drawing, "accepted", f"{joint} angle and torque at contact"),
            "As in Figure 3: straight or curved fits before and after contact; the difference of their slopes over the "
            "slope of the torque is the compliance. The dotted line carries the movement before contact on.",
        )
    if rejected is not None:
        item, (event, joint) = rejected
        drawing = view.plot_contact_event(item, event, joint)
        body += figure(
            view.svg(drawing, "negative", f"{joint} angle and torque at a contact with a negative estimate"),
            "As in Figure 8: here the joint moves the wrong way for any positive compliance to explain it. The "
            "coloured line is the reference that 1 rad/Nm would need. The estimate is kept and marked.",
        )
    return Section("contact", heading, body + _joints_left_out(interactions))


def _joints_left_out(interactions: Interactions) -> str:
    return not_drawn(interactions[0].model, interactions[0].per_event.joint_names) if interactions else ""


def representative(interaction: Interaction) -> tuple[tuple[int, str] | None, tuple[int, str] | None]:
    """The accepted event with the best fits, and the negative one with the largest excitation (event, joint).

    Only events of this interaction's own recording are considered, since only its time series is at hand, and
    only hinges and slides, which have one coordinate to draw.
    """
    per_event = interaction.per_event
    own = np.array([name == interaction.name for name in per_event.recording], dtype=bool)
    status, error = np.asarray(per_event.status), np.asarray(per_event.standard_error)
    if not own.any() or not status.size:
        return None, None
    drawn = {joint.name for joint in view.scalar_joints(interaction.model)}
    own = own[:, None] & np.array([name in drawn for name in per_event.joint_names], dtype=bool)
    accepted = own & (status == STATUS.index("accepted"))
    negative = own & (status == STATUS.index("negative"))
    precision = np.abs(np.asarray(per_event.compliance)) / np.maximum(error, 1e-9)
    worst_fit = np.nan_to_num(np.asarray(per_event.r_squared), nan=0.0).min(axis=2)
    quality = np.where(np.isfinite(precision), precision, 0.0) * worst_fit
    excitation = np.abs(np.nan_to_num(np.asarray(per_event.torque_change)))
    return _best(accepted, quality, per_event.joint_names), _best(negative, excitation, per_event.joint_names)


def _best(mask: np.ndarray, score: np.ndarray, joints: tuple[str, ...]) -> tuple[int, str] | None:
    if not mask.any():
        return None
    event, joint = np.unravel_index(int(np.argmax(np.where(mask, score, -np.inf))), mask.shape)
    return int(event), joints[int(joint)]


def not_drawn(model: Model, names: Sequence[str]) -> str:
    """A box that names what has no single coordinate to draw over time, empty where nothing is left out."""
    drawn = {joint.name for joint in view.scalar_joints(model)}
    left = [name for name in names if name not in drawn]
    if not left:
        return ""
    return absent(f"Only hinges and slides are drawn over time. Left out: {', '.join(left)}.")


def value_text(value: float) -> str:
    """A compliance as text."""
    return f"{value:#.3g}" if np.isfinite(value) else "not estimated"


def interval_text(low: float, high: float) -> str:
    """Its interval as text, a bound where it has one end only."""
    if low > 0 and np.isfinite(high):
        return f"{low:#.3g} to {high:#.3g}"
    if low > 0:
        return f"above {low:#.3g}"
    return f"below {high:#.3g}" if np.isfinite(high) else "unbounded"
