"""Figures 13 (a) to (e) and 14 of Kry and Pai (2006): a captured grasp on the same, a heavy and a wedge-shaped object.

    python experiments/kry_pai_2006/figure13.py [--cache DIR]

The grasp of the 12 g box is captured from `virtual_sessions/grasp5`, compliance and reference are estimated from it,
and the interaction meets

- (a) the box itself, 12 g;
- (b, c) a box of the same size and 120 g: it slips out of the fingers;
- (d) the same with `GripTightening`, 100 ms after the first slip: it is held;
- a wedge of 60 g, whose faces lean by 8 degrees: it slips out (left of Figure 14);
- (e) the same with `ImminentSlip` at 0.9 mu: it is held (right of Figure 14).

Simulated data (MuJoCo, independently of icjax); no person was measured. Writes figure13.png, figure14.png and
figure13.json.
"""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tyro
from grasp5 import LIFTED, interaction_of, scene_of, solids, with_forearm
from hand_drawing import plotting
from scipy.spatial import ConvexHull
from virtual_sessions import RESULTS, SIMULATED, trials_of, write

from icjax.geometry import Shape
from icjax.model import forward_kinematics, pad_positions
from icjax.rollout import Rollout
from icjax.synthesis import GripTightening, ImminentSlip, Policy, transfer
from icjax.view import save

FACETS = 8
"""Slip between two tangents begins at 0.98 mu, above the threshold of 0.9 mu."""

LEAST_FORCE = 0.2
"""N; below it no ratio is shown, nor used."""


@dataclasses.dataclass(frozen=True)
class Config:
    """`cache` keeps the captured session."""

    source: str = "box12g"
    cache: Path | None = None
    out: Path = RESULTS


def cases() -> dict[str, tuple[Shape, float, Policy | None]]:
    """Shape, mass (kg) and policy of each."""
    solid = solids()
    box, wedge = solid["box12g"][0], solid["wedge12g"][0]
    return {
        "a: box 12 g": (box, 0.012, None),
        "c: box 120 g": (box, 0.120, None),
        "d: box 120 g, tightening on slip": (box, 0.120, GripTightening()),
        "wedge 60 g": (wedge, 0.060, None),
        "e: wedge 60 g, imminent slip": (wedge, 0.060, ImminentSlip(floor=0.05)),
    }


def fingers(rollout: Rollout) -> tuple[np.ndarray, np.ndarray]:
    """Normal force (N) and ratio of friction to it, `[time, finger]`; no ratio below `LEAST_FORCE`."""
    of_hand = [
        number
        for number, (first, second) in enumerate(rollout.slot_bodies())
        if first in rollout.model.pad_names and second == "object"
    ]
    force, direction = np.asarray(rollout.contact_force)[:, of_hand], np.asarray(rollout.contact_normal)[:, of_hand]
    normal = np.sum(force * direction, axis=2)
    tangential = np.linalg.norm(force - normal[..., None] * direction, axis=2)
    shown = np.linalg.norm(force, axis=2) > LEAST_FORCE
    return normal, np.where(shown, tangential / np.where(shown, normal, 1.0), np.nan)


def numbers(rollout: Rollout, friction: float) -> dict[str, Any]:
    """What became of the object."""
    height = np.asarray(rollout.object_position)[:, 0, 2]
    normal, ratio = fingers(rollout)
    share = np.asarray(rollout.compliance)[:, 4] / np.asarray(rollout.compliance)[0, 4]
    return {
        "rise mm": 1e3 * (height[-1] - height[0]),
        "held": bool(height[-1] - height[0] > LIFTED),
        "grip at the end N": normal[-1],
        "largest ratio at the thumb over mu": float(np.nanmax(ratio[:, 0])) / friction,
        "compliance at the end, share": float(share[-1]),
        "unsolved steps": int(np.sum(np.asarray(rollout.status) > 0)),
    }


def main(config: Config) -> dict[str, Any]:
    """Capture, estimate, transfer five times, draw, write."""
    jax.config.update("jax_enable_x64", True)
    recording = next(item for item in trials_of("grasp5", config.cache) if item.name == config.source)
    interaction = with_forearm(interaction_of(recording), recording)
    friction = float(recording.friction)
    found: dict[str, Rollout] = {}
    result: dict[str, Any] = {"data": SIMULATED, "captured": config.source, "friction": friction, "cases": {}}
    for name, (shape, mass, policy) in cases().items():
        scene = dataclasses.replace(scene_of(recording, (shape, mass, 0.0)), facets=FACETS)
        found[name] = transfer(interaction, scene, policy=policy)
        result["cases"][name] = numbers(found[name], friction)
        print(name, result["cases"][name])
    save(figure13(found), config.out / "figure13.png")
    save(figure14(found, friction), config.out / "figure14.png")
    write(config.out / "figure13.json", result)
    return result


def figure13(found: dict[str, Rollout]) -> Any:
    """A column a case: hand and object from the side at the end, height, grip force."""
    pyplot = plotting()
    figure, axes = pyplot.subplots(3, len(found), figsize=(12.5, 6.2), height_ratios=[1.6, 1, 1], layout="constrained")
    solid = {"box": solids()["box12g"][0], "wedge": solids()["wedge12g"][0]}
    for column, (name, rollout) in zip(axes.T, found.items(), strict=True):
        time = np.asarray(rollout.time) - float(rollout.time[0])
        side_view(column[0], rollout, solid["wedge" if "wedge" in name else "box"], -1)
        column[0].set_title(name.replace(", ", "\n"), loc="left", fontsize=9, fontweight="bold")
        column[1].plot(time, 1e3 * np.asarray(rollout.object_position)[:, 0, 2], color="#0072B2")
        column[1].set_ylim(15, 112)
        normal, _ = fingers(rollout)
        column[2].plot(time, normal[:, 0], color="#D55E00", label="thumb")
        column[2].plot(time, normal[:, 1:].sum(axis=1), color="#009E73", label="four fingers")
        column[2].set_ylim(0, 2.2)
        column[2].set_xlabel("time, s")
        for axis in column[1:]:
            axis.set_xlim(0.6, time[-1])
            axis.spines[["top", "right"]].set_visible(False)
    axes[1, 0].set_ylabel("height, mm")
    axes[2, 0].set_ylabel("normal force, N")
    axes[2, 0].legend(frameon=False, fontsize=8)
    figure.supxlabel(f"Captured on the 12 g box; {SIMULATED}.", fontsize=7.5, color="#5B616B")
    return figure


def figure14(found: dict[str, Rollout], friction: float) -> Any:
    """Forces and their ratio at the thumb on the wedge, without and with adjustment."""
    pyplot = plotting()
    names = ("wedge 60 g", "e: wedge 60 g, imminent slip")
    figure, axes = pyplot.subplots(2, 2, figsize=(8, 4.6), sharex=True, sharey="row", layout="constrained")
    for column, name, title in zip(axes.T, names, ("no adjustment", "imminent slip adjustment"), strict=True):
        rollout = found[name]
        time = np.asarray(rollout.time) - float(rollout.time[0])
        normal, ratio = fingers(rollout)
        thumb = next(i for i, bodies in enumerate(rollout.slot_bodies()) if bodies == ("thumb", "object"))
        column[0].plot(time, normal[:, 0], color="#0072B2", label="normal")
        friction_force = np.linalg.norm(np.asarray(rollout.contact_force)[:, thumb], axis=1) ** 2 - normal[:, 0] ** 2
        column[0].plot(time, np.sqrt(np.maximum(friction_force, 0.0)), color="#D55E00", label="friction")
        column[0].set_title(title, loc="left", fontsize=9.5, fontweight="bold")
        column[1].plot(time, ratio[:, 0], color="#1F2430")
        for level, text in ((friction, "$\\mu$"), (0.9 * friction, "0.9 $\\mu$")):
            column[1].axhline(level, color="#8A8F98", linewidth=0.8, linestyle="--")
            column[1].text(time[-1], level, f" {text}", va="center", fontsize=8, color="#5B616B")
        column[1].set_xlabel("time, s")
        column[1].set_xlim(0.9, time[-1])
        for axis in column:
            axis.spines[["top", "right"]].set_visible(False)
    axes[0, 0].set_ylabel("force at the thumb, N")
    axes[1, 0].set_ylabel("friction / normal force")
    axes[0, 0].legend(frameon=False, fontsize=8)
    figure.supxlabel(f"S{SIMULATED[1:]}.", fontsize=7.5, color="#5B616B")
    return figure


def side_view(axis: Any, rollout: Rollout, shape: Shape, row: int) -> None:
    """Bones, pads and the object's outline, seen along the table."""
    model, q = rollout.model, np.asarray(rollout.q)[row]
    origins = np.asarray(forward_kinematics(model, q).position)
    pads = np.asarray(pad_positions(model, q))
    for body, parent in enumerate(model.body_parents):
        if parent > 0:
            axis.plot(*origins[[parent, body]][:, [0, 2]].T * 1e3, color="#C9A58B", linewidth=5, solid_capstyle="round")
    for pad, body in zip(pads, model.pad_bodies, strict=True):
        line = np.stack([origins[body], pad])
        axis.plot(*line[:, [0, 2]].T * 1e3, color="#C9A58B", linewidth=5, solid_capstyle="round")
        axis.plot(*pad[[0, 2]] * 1e3, "o", color="#8C5A3C", markersize=6)
    w, *v = np.asarray(rollout.object_quaternion)[row, 0]
    K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    turn = np.eye(3) + 2 * w * K + 2 * K @ K
    corners = np.asarray(shape.probes(np.array([0.0, 0.0, -1.0])).centre) @ turn.T
    corners = 1e3 * (corners + np.asarray(rollout.object_position)[row, 0])[:, [0, 2]]
    outline = corners[ConvexHull(corners).vertices]
    axis.fill(*outline.T, facecolor="#DCE6EE", edgecolor="#0072B2", alpha=0.9, zorder=0)
    axis.axhline(0.0, color="#9AA0A8")
    axis.set_xlim(-110, 80)
    axis.set_ylim(-12, 215)
    axis.set_aspect("equal")
    axis.axis("off")


if __name__ == "__main__":
    main(tyro.cli(Config))
