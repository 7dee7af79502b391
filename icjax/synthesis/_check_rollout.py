"""Does a stored rollout keep the laws of contact?"""

import json
from collections.abc import Iterator

import numpy as np

from icjax.results import RESULTS
from icjax.rollout import Rollout
from icjax.synthesis._stepper import STATUSES

PULL = 1e-9
"""Share of the largest force below which a pulling normal force is rounding."""

CONE = 1e-6
"""Relative slack of the friction cone."""


IMBALANCE = 0.05
"""rad or m; what Eq. 7 leaves after a step of a movement that the linearisation follows is a hundred times less."""

JUMP = 0.5
"""rad or m in one step."""

BEYOND = 0.2
"""rad or m beyond a joint's limits."""

OVERLAP = 5e-4
"""m; rigid things that overlap more than this at the start were put there by mistake."""

LOST = 1.0
"""m below its start: an object has left the laboratory."""


def check_rollout(rollout: Rollout) -> list[str]:
    """Lines about a stored rollout: what it holds, then lines that begin with "suspicious: " and "error: ".

    A solved step must not pull (normal force of at least zero) and must keep every force within the circular cone
    of its surface's friction, which holds the polyhedral one. Steps that were not solved are told, not judged.
    """
    failed = np.asarray(rollout.status) != 0
    lines = [
        f"rollout '{rollout.name}': {len(rollout.time)} steps, contacts {_listed(rollout)}; "
        f"{int(failed.sum())} steps not solved, largest residual of the others "
        f"{float(np.max(np.asarray(rollout.residual)[~failed], initial=0.0)):.2g}"
    ]
    return lines + [f"{kind}: rollout '{rollout.name}': {text}" for kind, text in _findings(rollout, ~failed)]


def why_unsolved(rollout: Rollout) -> str:
    """What `Rollout.status` means where it is not 0: each reason, and for how many steps."""
    numbers, counts = np.unique(np.asarray(rollout.status), return_counts=True)
    found = [(RESULTS[STATUSES[number]], count) for number, count in zip(numbers, counts, strict=True) if number]
    return " ".join(message if len(found) == 1 else f"{count} steps: {message}" for message, count in found)


def _listed(rollout: Rollout) -> str:
    """Who may touch whom, the corners of an object together."""
    return ", ".join(dict.fromkeys("/".join(filter(None, bodies)) for bodies in rollout.slot_bodies()))


def _findings(rollout: Rollout, solved: np.ndarray) -> Iterator[tuple[str, str]]:
    if not solved.all():
        first = rollout.time[~solved][0]
        yield (
            "suspicious",
            f"{int((~solved).sum())} steps are not solved, the first at {first:g} s. {why_unsolved(rollout)}",
        )
    yield from _implausible(rollout, solved)
    yield from _implausible_objects(rollout)
    force, normal = np.asarray(rollout.contact_force)[solved], np.asarray(rollout.contact_normal)[solved]
    if not np.isfinite(force).all():
        yield "error", "contact_force is not finite in a solved step"
        return
    pressing = np.sum(force * normal, axis=2)
    size = float(np.abs(force).max(initial=0.0))
    if np.any(pressing < -PULL * max(size, 1.0)):
        yield "error", "a contact pulls in a solved step"
    sliding = np.linalg.norm(force - pressing[:, :, None] * normal, axis=2)
    for slot, (name, bodies) in enumerate(zip(rollout.slot_names, rollout.slot_bodies(), strict=True)):
        friction = rollout.friction_of(*bodies)
        if friction is None:
            yield "error", f"slot '{name}' names no surface or object of the scene"
        elif np.any(sliding[:, slot] > friction * pressing[:, slot] * (1 + CONE) + CONE * max(size, 1e-12)):
            yield "error", f"a force of slot '{name}' leaves the friction cone of {friction:g}"


def _implausible(rollout: Rollout, solved: np.ndarray) -> Iterator[tuple[str, str]]:
    """What a solved step may be and no movement is: out of balance, jumping, through a surface, beyond a limit."""
    model, time = rollout.model, np.asarray(rollout.time)
    error = np.abs(np.asarray(rollout.equilibrium_error)).max(axis=1, initial=0.0)
    wrong = solved & (error > IMBALANCE)
    if wrong.any():
        joint = model.dof_names[int(np.argmax(np.abs(np.asarray(rollout.equilibrium_error)[np.argmax(error)])))]
        yield (
            "suspicious",
            f"{int(wrong.sum())} steps are far from equilibrium (Eq. 7), by up to {error.max():.2g} in {joint}, the "
            f"first at {time[wrong][0]:g} s: is the surface where the movement can reach it?",
        )
    joints = zip(model.joint_names, model.joint_types, model.coordinate_slices, strict=True)
    columns = {name: part.start for name, kind, part in joints if kind in ("hinge", "slide")}
    names, scalar = list(columns), list(columns.values())
    q = np.asarray(rollout.q)[:, scalar]
    steps = np.abs(np.diff(q, axis=0))
    if steps.size and np.nanmax(steps) > JUMP:
        row, column = np.unravel_index(int(np.nanargmax(steps)), steps.shape)
        yield "suspicious", f"{names[column]} jumps by {steps[row, column]:.2g} in the step to {time[row + 1]:g} s"
    outside = np.maximum(np.asarray(model.lower)[scalar] - q, q - np.asarray(model.upper)[scalar])
    if outside.size and np.nanmax(outside) > BEYOND:
        row, column = np.unravel_index(int(np.nanargmax(outside)), outside.shape)
        yield (
            "suspicious",
            f"{names[column]} goes {outside[row, column]:.2g} beyond its limits, most at {time[row]:g} s: it is driven "
            "there, or the scene has no room for its limit",
        )
    gap, deepest = np.asarray(rollout.gap), 2 * float(np.max(np.asarray(model.pad_radius), initial=0.0))
    if deepest and np.nanmin(gap, initial=0.0) < -deepest:
        row, slot = np.unravel_index(int(np.nanargmin(gap)), gap.shape)
        yield (
            "suspicious",
            f"{rollout.slot_names[slot]} is pressed {-1e3 * gap[row, slot]:.0f} mm into the surface at {time[row]:g} "
            "s, deeper than a pad is thick",
        )


def _implausible_objects(rollout: Rollout) -> Iterator[tuple[str, str]]:
    """Objects that begin inside something, or fall without end."""
    gap, told = np.asarray(rollout.gap)[0], set()
    for slot in np.argsort(gap):
        bodies, on_hand = rollout.slot_bodies()[slot], rollout.on_hand()[slot]
        if not on_hand and gap[slot] < -OVERLAP and bodies not in told:
            told.add(bodies)
            yield "suspicious", f"{bodies[0]} begins {-1e3 * gap[slot]:.2g} mm inside {bodies[1]}: see its position"
    if rollout.object_position is None:
        return
    gravity = np.asarray(json.loads(rollout.scene).get("gravity", (0.0, 0.0, 0.0)), float)
    if not gravity.any():
        return
    moved = np.asarray(rollout.object_position) - np.asarray(rollout.object_position)[:1]
    for name, fallen in zip(rollout.object_names, (moved @ gravity / np.linalg.norm(gravity)).T, strict=True):
        if fallen[-1] > LOST:
            yield "suspicious", f"{name} has fallen {fallen[-1]:.2g} m: is there a surface under it?"
