"""The sections of the page, each from the records it is about; a missing record is said to be missing."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from icjax import view
from icjax.fit import FitRecord
from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.report._estimates import not_drawn
from icjax.report._page import Section, absent, figure, folded, pairs, paragraph, player, table, text
from icjax.results import RESULTS
from icjax.rollout import SLIP_STATES, Rollout

Recordings = Sequence[Recording]
Interactions = Sequence[Interaction]
Rollouts = Sequence[Rollout]

KEY = (
    '<ul class="key"><li><i style="background:#708aac"></i>finger</li>'
    '<li><i style="background:#e69f00;opacity:.55"></i>reference pose</li>'
    '<li><i style="background:#0072b2"></i>measured force</li>'
    '<li><i style="background:#009e73"></i>simulated force, sticking</li>'
    '<li><i style="background:#d55e00"></i>simulated force, sliding</li>{}</ul>'
)

HAND_ONLY = " Forces on objects are further below."
OUTLINES = " Objects are dashed where they began and filled where they ended."


def shown_first(recordings: Recordings, interactions: Interactions) -> tuple[str, Recording | Interaction] | None:
    """What the 3-D view shows before the rollouts, with its name: the first interaction, else the first trial."""
    if interactions:
        return f"measured ({interactions[0].name})", interactions[0]
    if not recordings:
        return None
    first = next((item for item in recordings if item.role == "trial"), recordings[0])
    return f"measured ({first.name})", first


def view_page(item: Recording | Interaction | Rollout) -> str | None:
    """A record in 3-D as a page of its own; None where no frame has a pose."""
    return view.export_scene(item, frames=120) if _has_pose(item) else None


def scene(pages: Sequence[tuple[str, str | None]], rollouts: Rollouts = ()) -> tuple[Section, str]:
    """The 3-D view: what was measured, then every rollout, behind tabs. Returns the section and its script.

    **Arguments**: `pages` names and what `view_page` made of them; `rollouts` whose objects the key names.
    """
    unseen = [name for name, page in pages if page is None]
    shown = [(name, page) for name, page in pages if page is not None]
    heading = "In three dimensions"
    if not shown:
        words = "Nothing to show: no recording, interaction or rollout."
        if unseen:
            words = f"Nothing to show: no frame of {', '.join(unseen)} has a pose."
        return Section("view", heading, absent(words)), ""
    missing = absent(f"Not shown, since no frame has a pose: {', '.join(unseen)}.") if unseen else ""
    frame, script = player(*zip(*shown, strict=True))
    words = (
        "Drag to turn, scroll to zoom, use the bar below the picture to move through time. Arrows are contact "
        "forces on the subject, the longer the stronger. The plate under a measured movement is a "
        "level plane through the contact points."
    )
    colours = dict.fromkeys(
        (name, view.object_colour(number)) for item in rollouts for number, name in enumerate(item.object_names)
    )
    if colours:
        words += (
            " Forces of surfaces and other objects on an object are drawn as well, those of one pair as one arrow, cut "
            "where they exceed the largest on the subject."
        )
    key = KEY.format("".join(f'<li><i style="background:{colour}"></i>{text(name)}</li>' for name, colour in colours))
    return Section("view", heading, paragraph(words) + frame + key + missing), script


def _has_pose(item: Recording | Interaction | Rollout) -> bool:
    return bool(np.isfinite(np.asarray(item.q, dtype=float)).all(axis=1).any())


def motion(recordings: Recordings, interactions: Interactions, fitted: bool = False) -> Section | None:
    """Angles with the reference, and the recording's quality; None of fits alone, which hold their own windows."""
    if fitted and not recordings and not interactions:
        return None
    body = ""
    if interactions and view.scalar_joints(interactions[0].model):
        valid = next((item.valid for item in recordings if item.name == interactions[0].name), None)
        body += figure(
            view.svg(view.plot_angles(interactions[0], valid), "angles", "joint angles and reference trajectory"),
            "Measured joint angles and their reference trajectory, where Eq. 1 says the joints would have gone without "
            "contact. Shaded: contact. Band: 95 % of the reference's stated uncertainty. Blank: "
            "frames without a pose.",
        )
    if interactions:
        model = interactions[0].model
        kinds = zip(model.joint_names, model.joint_types, strict=True)
        body += not_drawn(model, [name for name, kind in kinds if kind == "ball"])
    elif not fitted:
        body += absent("No interaction was given, so there is no reference trajectory to show.")
    if recordings:
        first = next((item for item in recordings if item.role == "trial"), recordings[0])
        if not interactions and view.scalar_joints(first.model):
            body += figure(
                view.svg(view.plot_angles(first, first.valid), "angles", "joint angles"),
                f"Joint angles of {first.name}. Shaded: contact. Blank: frames without a pose.",
            )
        if first.contact_names:
            drawing = view.plot_measured_forces(first)
            body += figure(view.svg(drawing, "measured", "measured contact force"),
                           f"Contact force of {first.name} with the contacts found in it (shaded).")  # fmt: skip
        body += table(
            [
                "recording",
                "role",
                "duration (s)",
                "rate (Hz)",
                "contacts",
                "frames without pose",
                "median marker residual (mm)",
            ],
            [_recording_row(item) for item in recordings],
            words=(0, 1),
        )
    else:
        body += absent("No recording was given.")
    return Section("motion", "Movement and reference", body)


def _recording_row(item: Recording) -> list[str]:
    residual = np.asarray(item.marker_residual, dtype=float)
    typical = f"{1e3 * np.nanmedian(residual):.2f}" if np.isfinite(residual).any() else "no markers"
    duration = float(item.time[-1] - item.time[0])
    missing = int((~np.asarray(item.valid)).sum())
    return [item.name, item.role.replace("_", " "), f"{duration:.2f}", f"{item.rate:g}", str(len(item.events.onset)),
            str(missing), typical]  # fmt: skip


def forces(interactions: Interactions, rollouts: Rollouts) -> Section:
    """Forces and fingertip path before and after transfer."""
    heading = "Before and after transfer"
    if not rollouts:
        return Section("forces", heading, absent("No rollout was given, so nothing was transferred."))
    measured = interactions[0] if interactions else None
    with_objects = any(item.object_names for item in rollouts)
    body = figure(
        view.svg(view.plot_forces(measured, tuple(rollouts)), "forces", "contact forces before and after transfer"),
        "As in Figure 4: contact force on each new surface over the force measured on the original one."
        + (HAND_ONLY if with_objects else ""),
    )
    if any(_has_pose(item) for item in (*interactions[:1], *rollouts)):
        body += figure(
            view.svg(view.plot_path(measured, tuple(rollouts)), "path", "path of the fingertip over each surface"),
            "Lowest point of the undeformed fingertip, seen from the side; below the surface the soft pad is pressed "
            "in. Heights are those of the world." + (OUTLINES if with_objects else ""),
        )
    else:
        body += absent("No frame has a pose, so there is no path to show.")
    if measured is None:
        body += absent("No interaction was given, so the measured forces are not shown.")
    return Section("forces", heading, body)


def rollout_table(rollouts: Rollouts) -> Section:
    """Whether the simulation can be trusted, a row a rollout, and every failed step."""
    heading = "Can the simulation be trusted?"
    if not rollouts:
        return Section("rollouts", heading, absent("No rollout was given."))
    head = ["rollout", "steps", "failed", "largest residual", "largest equilibrium error (rad, m)", "deepest gap (mm)",
            "sticking", "sliding"]  # fmt: skip
    rows, causes = [], []
    for item in rollouts:
        on_hand = np.array(item.on_hand())
        status, state = np.asarray(item.status), np.asarray(item.slip_state)[:, on_hand]
        failed = np.flatnonzero(status != 0)
        closed = max(int((state > 0).any(axis=1).sum()), 1)
        share = [(state == SLIP_STATES.index(name)).any(axis=1).sum() / closed for name in ("sticking", "sliding")]
        rows.append([view.scene_name(item), str(len(status)), str(len(failed)), _largest(item.residual, ".1e"),
                     _largest(item.equilibrium_error, ".1e"), _deepest(np.asarray(item.gap)[:, on_hand]),
                     f"{share[0]:.0%}", f"{share[1]:.0%}"])  # fmt: skip
        causes += [[view.scene_name(item), f"{float(item.time[k]):.3f}", _cause(int(status[k]))] for k in failed[:20]]
        if len(failed) > 20:
            causes.append([view.scene_name(item), "", f"and {len(failed) - 20} more"])
    body = paragraph(
        "The residual is that of the complementarity problem, recomputed from its solution. The equilibrium error "
        "is what Eq. 7 leaves after a step. The gap is that of the undeformed pad, negative where it is pressed in. "
        "Sticking and sliding are shares of the steps in contact."
    )
    body += table(head, rows)
    body += (
        table(["rollout", "time (s)", "cause"], causes, words=(0, 2)) if causes else paragraph("Every step was solved.")
    )
    return Section("rollouts", heading, body)


def _largest(values: Any, form: str) -> str:
    numbers = np.abs(np.asarray(values, dtype=float))
    return format(float(np.nanmax(numbers)), form) if np.isfinite(numbers).any() else "none"


def _deepest(gap: Any) -> str:
    numbers = np.asarray(gap, dtype=float)
    return f"{1e3 * float(np.nanmin(numbers)):.2f}" if np.isfinite(numbers).any() else "none"


def _cause(status: int) -> str:
    """What a status number means: the name and message of the member of `RESULTS` with that value."""
    known = {int(np.asarray(member._value)): (name, RESULTS[member]) for name, member in RESULTS._name_to_item.items()}
    if status not in known:
        return f"status {status}"
    name, message = known[status]
    return f"{name.replace('_', ' ')}: {message}"


def provenance(
    recordings: Recordings,
    estimates: Sequence[Interaction | FitRecord],
    rollouts: Rollouts,
    metrics: Mapping[str, Any] | None,
    versions: Mapping[str, str],
    seed: int | None,
) -> Section:
    """Seed, versions, metrics, and everything the records say about where they come from."""
    body = pairs([("seed", "none stated" if seed is None else str(seed)), *((k, str(v)) for k, v in versions.items())])
    if metrics:
        body += "<h3>Metrics</h3>" + table(["metric", "value"], [[k, v] for k, v in _flatten(metrics)])
    body += "<h3>What the records say</h3>"
    for item in (*recordings, *estimates):
        kind = {Recording: "recording", Interaction: "interaction", FitRecord: "fit"}[type(item)]
        body += folded(f"{kind} {item.name}", _pretty(item.provenance))
    for item in rollouts:
        body += folded(f"scene of rollout {view.scene_name(item)}", _pretty(item.scene))
    return Section("provenance", "Where the numbers come from", body)


def _pretty(content: str) -> str:
    try:
        return json.dumps(json.loads(content), indent=1, ensure_ascii=False)
    except json.JSONDecodeError:
        return content or "nothing"


def _flatten(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    flat: list[tuple[str, str]] = []
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            flat += _flatten(value, f"{name} › ")
        else:
            flat.append((name, f"{value:.4g}" if isinstance(value, float) else str(value)))
    return flat
