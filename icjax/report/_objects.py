"""The section about the objects that were pushed around."""

from collections.abc import Sequence

import numpy as np

from icjax import view
from icjax.report._page import Section, absent, figure, paragraph, table
from icjax.rollout import Rollout

MOST = 12
"""Objects of a rollout that are drawn over time."""


def objects(rollouts: Sequence[Rollout]) -> Section | None:
    """What became of every object, in numbers and over time; None where no rollout has any."""
    moved = [item for item in rollouts if item.object_names]
    if not moved:
        return None
    rows, figures = [], ""
    for number, rollout in enumerate(moved):
        names = rollout.object_names
        rows += [_row(rollout, view.object_course(rollout, name)) for name in names]
        for start in range(0, min(len(names), MOST), view.OBJECT_PANELS):
            shown = names[start : min(start + view.OBJECT_PANELS, MOST)]
            drawing = view.plot_objects(rollout, shown)
            words = f"place, tilt, speed and forces of {', '.join(shown)} over time"
            figures += figure(
                view.svg(drawing, f"objects-{number}-{start}", words),
                f"{view.scene_name(rollout)}: {', '.join(shown)}. Forces are means over 20 ms.",
            )
        if len(names) > MOST:
            figures += absent(f"Not drawn: {', '.join(names[MOST:])}.")
        figures += _grip(number, rollout)
    body = paragraph(
        "Moved is the horizontal distance from the start, lifted the height above it. The sum of all contact forces, "
        "upward, is the weight while an object rests or slides on something level. Bodies are rigid: a blow lasts one "
        "time step. Overlap is the deepest between an object and anything but a pad, which is soft."
    )
    head = ["object", "rollout", "weight (N)", "mean contact force up (N)", "moved (mm)", "most lifted (mm)",
            "most tilted (deg)", "fastest (mm/s)", "hand's largest net force (N)", "overlap (mm)"]  # fmt: skip
    return Section("objects", "Objects", body + table(head, rows, words=(0, 1)) + figures)


def _grip(number: int, rollout: Rollout) -> str:
    """How the fingertips hold, over time."""
    name = view.scene_name(rollout)
    on_hand = np.array(rollout.on_hand())
    if not np.asarray(rollout.contact_force)[:, on_hand].any():
        return absent(f"{name}: nothing touches the hand, so there is no grip to show.")
    return figure(
        view.svg(view.plot_grip(rollout), f"grip-{number}", f"normal force and friction of the fingertips, {name}"),
        f"{name}: force of every fingertip on what it touches, and friction over μ times the normal force, which "
        "reaches one where it slides (on a polyhedral cone between the dotted lines); none below a twentieth of the "
        "largest force. The lowest panel, where there is one, is the compliance that a policy or the interaction "
        "changed.",
    )


def _row(rollout: Rollout, course: view.ObjectCourse) -> list[str]:
    tilt = "a ball" if course.ball else f"{np.degrees(course.tilt.max()):.0f}"
    return [
        course.name,
        view.scene_name(rollout),
        "not stated" if course.weight is None else f"{course.weight:.3g}",
        f"{course.carried.mean():.3g}",
        f"{1e3 * course.moved[-1]:.1f}",
        f"{1e3 * course.lifted.max():.1f}",
        tilt,
        f"{1e3 * course.speed.max():.0f}",
        f"{course.pushed.max():.2f}" if course.pushed.any() else "not touched",
        f"{1e3 * course.overlap:.3f}",
    ]
