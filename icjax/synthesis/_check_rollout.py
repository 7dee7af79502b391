"""Does a stored rollout keep the laws of contact?"""

import json
from collections.abc import Iterator

import numpy as np

from icjax.rollout import Rollout

PULL = 1e-9
"""Share of the largest force below which a pulling normal force is rounding."""

CONE = 1e-6
"""Relative slack of the friction cone."""


def check_rollout(rollout: Rollout) -> list[str]:
    """Lines about a stored rollout: what it holds, then lines that begin with "suspicious: " and "error: ".

    A solved step must not pull (normal force of at least zero) and must keep every force within the circular cone
    of its surface's friction, which holds the polyhedral one. Steps that were not solved are told, not judged.
    """
    failed = np.asarray(rollout.status) != 0
    lines = [
        f"rollout '{rollout.name}': {len(rollout.time)} steps, slots {', '.join(rollout.slot_names)}; "
        f"{int(failed.sum())} steps not solved, largest residual of the others "
        f"{float(np.max(np.asarray(rollout.residual)[~failed], initial=0.0)):.2g}"
    ]
    return lines + [f"{kind}: rollout '{rollout.name}': {text}" for kind, text in _findings(rollout, ~failed)]


def _findings(rollout: Rollout, solved: np.ndarray) -> Iterator[tuple[str, str]]:
    if not solved.all():
        yield "suspicious", f"{int((~solved).sum())} steps are not solved, the first at {rollout.time[~solved][0]:g} s"
    force, normal = np.asarray(rollout.contact_force)[solved], np.asarray(rollout.contact_normal)[solved]
    if not np.isfinite(force).all():
        yield "error", "contact_force is not finite in a solved step"
        return
    pressing = np.sum(force * normal, axis=2)
    size = float(np.abs(force).max(initial=0.0))
    if np.any(pressing < -PULL * max(size, 1.0)):
        yield "error", "a contact pulls in a solved step"
    surfaces = {item["name"]: float(item["friction"]) for item in json.loads(rollout.scene)["surfaces"]}
    sliding = np.linalg.norm(force - pressing[:, :, None] * normal, axis=2)
    for slot, name in enumerate(rollout.slot_names):
        friction = surfaces.get(name.split("/")[-1])
        if friction is None:
            yield "error", f"slot '{name}' names no surface of the scene"
        elif np.any(sliding[:, slot] > friction * pressing[:, slot] * (1 + CONE) + CONE * max(size, 1e-12)):
            yield "error", f"a force of slot '{name}' leaves the friction cone of {friction:g}"
