"""Figure 1 of Kry and Pai (2006), "Interaction capture explained": one grasp, captured, measured, transferred twice.

    python experiments/kry_pai_2006/figure1.py [--cache DIR]

- (a) The grasp of a box of 30 x 70 x 50 mm and 12 g, captured from `virtual_sessions/grasp5` with markers and with
  film sensors on the fingertips, which measure the normal force only. Nobody tracked the box: the picture takes its
  place from the truth of the simulated session, which nothing else of (a) to (c) uses but its rise in the json.
- (b) The measured normal forces. Compliance and reference are estimated from this recording alone.
- (c) The interaction meets a similar box: as wide, so that the measured grip force is what to expect, but 60 mm deep,
  60 mm high and 20 g.
- (d) It meets a ball of 54 mm and 12 g, which only thumb, middle and ring finger reach. The session has this ball too:
  its truth judges.

Simulated data (MuJoCo, independently of icjax); no person was measured. Writes figure1.png and figure1.json.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import tyro
from grasp5 import LIFTED, interaction_of, nrmse, scene_of, solids, with_forearm
from hand_drawing import (
    COLOURS,
    GREY,
    INK,
    View,
    draw_arrow,
    draw_hand,
    draw_solid,
    draw_table,
    framed,
    plotting,
)
from scipy.spatial.transform import Rotation
from virtual_sessions import RESULTS, SIMULATED, trials_of, truth_of, write

from icjax.geometry import Box, Shape
from icjax.model import Model
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.synthesis import transfer
from icjax.view import save, solid

VIEW = View(np.radians(-84.0), np.radians(28.0))
SHOWN = 2.8
"""s after the start; everything hangs in the air."""

LONGEST = 60.0
"""mm, the longest arrow of a picture."""

BALL = "sphere12g"


@dataclasses.dataclass(frozen=True)
class Config:
    """`cache` keeps the captured session."""

    source: str = "box12g"
    cache: Path | None = None
    out: Path = RESULTS


class Course(NamedTuple):
    """A hand and a thing over time: coordinates, pose of the thing, forces on the thing (N) and where they act (m).

    `normal` `[time, finger]` is the normal force, N; `entry` describes the shape as a rollout does.
    """

    model: Model
    time: np.ndarray
    q: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    force: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    entry: dict[str, Any]


def similar_box() -> tuple[Shape, float, float]:
    """As wide as the captured one; shape, mass (kg), height of the table that lets it stand (m)."""
    return Box(np.array([0.015, 0.030, 0.030])), 0.020, -0.005


def measured(recording: Recording, pose: np.ndarray, entry: dict[str, Any]) -> Course:
    """What was recorded; `pose` of the box [time, 7] is not."""
    force = np.asarray(recording.contact_force)
    turn = Rotation.from_quat(pose[:, [4, 5, 6, 3]]).as_matrix()
    return Course(
        recording.model,
        np.asarray(recording.time) - float(recording.time[0]),
        np.asarray(recording.q),
        turn,
        pose[:, :3],
        -force,
        np.asarray(recording.contact_point),
        np.linalg.norm(force, axis=2),
        entry,
    )


def synthesised(rollout: Rollout) -> Course:
    """What happened in a transfer."""
    slots = [rollout.slot_names.index(f"{pad}/object") for pad in rollout.model.pad_names]
    force = np.asarray(rollout.contact_force)[:, slots]
    return Course(
        rollout.model,
        np.asarray(rollout.time) - float(rollout.time[0]),
        np.asarray(rollout.q),
        Rotation.from_quat(np.asarray(rollout.object_quaternion)[:, 0][:, [1, 2, 3, 0]]).as_matrix(),
        np.asarray(rollout.object_position)[:, 0],
        -force,
        np.asarray(rollout.contact_point)[:, slots],
        np.sum(force * np.asarray(rollout.contact_normal)[:, slots], axis=2),
        json.loads(rollout.scene)["objects"][0],
    )


def numbers(course: Course) -> dict[str, Any]:
    """Rise of the thing and forces of the grip, the sum of all fingertips' normal forces."""
    rise = course.position[-1, 2] - course.position[0, 2]
    total = course.normal.sum(axis=1)
    return {
        "rise mm": 1e3 * rise,
        "held": bool(rise > LIFTED),
        "peak grip N": total.max(),
        "grip while held N": total[-150:].mean(),
        "peak of a finger N": dict(zip(course.model.pad_names, course.normal.max(axis=0), strict=True)),
    }


def main(config: Config) -> dict[str, Any]:
    """Capture, estimate, transfer twice, judge, draw, write."""
    jax.config.update("jax_enable_x64", True)
    trials = {item.name: item for item in trials_of("grasp5", config.cache)}
    recording, solid_of = trials[config.source], solids()
    interaction = with_forearm(interaction_of(recording), recording)
    shape, mass, _ = solid_of[config.source]
    scenes = {
        "c: similar box": scene_of(recording, similar_box()),
        "d: ball": scene_of(recording, solid_of[BALL]),
    }
    rollouts = {name: transfer(interaction, scene) for name, scene in scenes.items()}
    found = {name: synthesised(rollout) for name, rollout in rollouts.items()}
    entry = {"shape": "box", "half_sizes": np.asarray(shape.half_sizes).tolist()}
    seen = measured(recording, truth_of("grasp5", config.source)["object_pose"], entry)
    real = truth_of("grasp5", BALL)
    box, ball = found.values()
    result: dict[str, Any] = {
        "figure": "Kry and Pai 2006, Figure 1",
        "data": SIMULATED,
        "captured": config.source,
        "mass kg": mass,
        "a, b: captured box (its rise is the truth's)": numbers(seen),
    }
    for (name, rollout), course in zip(rollouts.items(), found.values(), strict=True):
        unsolved = int(np.sum(np.asarray(rollout.status) > 0))
        result[name] = numbers(course) | {"unsolved steps": unsolved, "steps": len(course.time)}
    result["c: similar box"]["total grip NRMSE against measured"] = nrmse(box.normal.sum(1), seen.normal.sum(1))
    result["d: ball"]["total grip NRMSE against the independent hand on that ball"] = nrmse(
        ball.normal.sum(1), real["f_normal"].sum(1)
    )
    result["d: ball"]["rise mm of the independent hand"] = 1e3 * (
        real["object_pose"][-1, 2] - real["object_pose"][0, 2]
    )
    print(json.dumps(result, indent=1, default=np.ndarray.tolist))
    save(drawn(recording, seen, box, ball, real["f_normal"]), config.out / "figure1.png")
    write(config.out / "figure1.json", result)
    return result


def drawn(recording: Recording, seen: Course, box: Course, ball: Course, truth: np.ndarray) -> Any:
    """A column each: above hand and thing while it hangs in the air, below the normal forces."""
    pyplot = plotting()
    figure, axes = pyplot.subplots(2, 3, figsize=(8.6, 5.9), height_ratios=[1.5, 1.0], layout="constrained")
    figure.get_layout_engine().set(h_pad=0.07)
    titles = (
        "a  grasp on a small box, captured",
        "c  transferred to a similar box",
        "d  transferred to a ball",
    )
    for axis, title, course in zip(axes[0], titles, (seen, box, ball), strict=True):
        picture(axis, course, recording if course is seen else None)
        axis.set_title(title, loc="left", fontsize=9.5, fontweight="bold", color=INK)
    columns = (("b  contact forces, measured", seen, None), ("synthesised; pale: measured (b)", box, seen.normal),
               ("synthesised; pale: independent hand", ball, truth))  # fmt: skip
    for axis, (title, course, pale) in zip(axes[1], columns, strict=True):
        for number, finger in enumerate(course.model.pad_names):
            if pale is not None:
                axis.plot(course.time[::4], pale[::4, number], color=COLOURS[finger], linewidth=3.0, alpha=0.3)
            axis.plot(course.time[::4], course.normal[::4, number], color=COLOURS[finger], linewidth=1.1, label=finger)
        axis.axvline(SHOWN, ymax=0.8, color=GREY, linewidth=0.8, linestyle="--", zorder=0)
        axis.set_title(title, loc="left", fontsize=9, fontweight="bold" if pale is None else "normal", color=INK)
        axis.set_xlim(0.7, course.time[-1])
        axis.set_ylim(0.0, 1.3 * ball.normal.max() if course is ball else 1.3 * box.normal.max())
        axis.set_xlabel("time, s", fontsize=9)
        axis.tick_params(labelsize=8)
        axis.spines[["top", "right"]].set_visible(False)
    axes[1, 0].set_ylabel("normal force, N", fontsize=9)
    axes[1, 0].legend(frameon=False, fontsize=8.5, ncols=3, loc="upper left", columnspacing=1.0, handlelength=1.2)
    figure.supxlabel(
        f"S{SIMULATED[1:]}. Arrows: contact forces on the thing\nat {SHOWN} s (dashed below); in (a) what the sensors "
        "measure, the normal part. Small circles: markers. Dark rims: fingertips with sensors.\nThe axis of forces on "
        "the ball differs: it is wider than the box, and the same intention presses harder.",
        fontsize=8.0, color="#5B616B")  # fmt: skip
    return figure


def picture(axis: Any, course: Course, recording: Recording | None) -> None:
    """Hand, thing and forces on it; of a recording the markers and the sensors too."""
    row = int(np.argmin(np.abs(course.time - SHOWN)))
    draw_table(axis, VIEW, (-0.104, -0.040), (0.104, 0.075))
    thing = solid(course.entry | {"position": [0.0] * 3, "rotation": np.eye(3).tolist()}, "object")
    draw_solid(axis, VIEW, thing, course.rotation[row], course.position[row], "#DCE9F4")
    pressing = course.normal[row] > 0.05
    rim = None if recording is None else INK
    draw_hand(axis, VIEW, course.model, course.q[row], pressing, course.position[row], rim)
    if recording is not None:
        place, _ = VIEW.seen(np.asarray(recording.markers)[row])
        axis.plot(*place.T, "o", color=INK, markerfacecolor="white", markersize=3.2, markeredgewidth=0.8, zorder=8)
    size = np.linalg.norm(course.force[row], axis=1)
    scale = LONGEST / size.max()
    for number in np.flatnonzero(pressing):
        end, force = VIEW.seen(course.point[row, number][None])[0][0], 1e-3 * course.force[row, number]
        draw_arrow(axis, end - scale * VIEW.seen(force[None])[0][0], end)
    unit = 0.5 if size.max() < 2.0 else 2.0
    low = np.array([-108.0, -34.0])
    draw_arrow(axis, low, low + [scale * unit, 0.0])
    axis.text(*(low + [0.0, 5.0]), f"{unit:g} N", fontsize=8.5, color=INK)
    framed(axis, (-112, -45), (112, 198))


if __name__ == "__main__":
    main(tyro.cli(Config))
