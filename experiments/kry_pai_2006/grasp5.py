"""Five fingers grasp and lift seven objects: icjax against the independent simulation of `virtual_sessions/grasp5`.

    python experiments/kry_pai_2006/grasp5.py [--cache DIR]

The same interaction meets every object: once with the true compliances and the true reference (the joint angles of the
run without contact), once with both estimated from the recording of the 12 g box alone. Forearm position comes from the
markers in both. Judged are the normal forces (NRMSE: RMS error over RMS truth), the rise of the object and whether it
is lifted. Writes grasp5.json and grasp5.png.

What differs by design: the subject has inertia and damping, icjax's hand is quasi-static; MuJoCo's pad is a spring of
1 200 N/m behind a soft contact, together 330 N/m at 17 mN, 740 N/m above 0.2 N (`pad_press.py`), ours is linear, with
the stiffness at the mean force that the finger's sensor showed in the recorded grasp; its contacts resist twisting
(0.004 m), ours are points; its friction of object and table is the larger of both.
"""

import dataclasses
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tyro
from pad_press import secant_stiffness
from virtual_sessions import RESULTS, SIMULATED, trials_of, truth_of, write

from icjax.estimation import estimate
from icjax.geometry import Box, Placed, Plane, Shape, Sphere, wedge
from icjax.interaction import Interaction
from icjax.recording import Recording, Session
from icjax.rollout import Rollout
from icjax.spatial import Pose
from icjax.synthesis import Object, PairFriction, Scene, Surface, transfer
from icjax.view import save

LIFTED = 0.03
"""m; the forearm rises by 0.08."""

TABLE_FRICTION = 0.6


@dataclasses.dataclass(frozen=True)
class Config:
    """`source` is the trial that compliance and reference are estimated from; `cache` keeps the captured session."""

    source: str = "box12g"
    cache: Path | None = None
    out: Path = RESULTS


def solids() -> dict[str, tuple[Shape, float, float]]:
    """Shape, mass (kg) and height of the table (m) of every variant, as hand_model.json has them."""
    box = Box(np.array([0.015, 0.035, 0.025]))
    upright = Pose(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), np.zeros(3))
    return {
        "box12g": (box, 0.012, 0.0),
        "box60g": (box, 0.060, 0.0),
        "box120g": (box, 0.120, 0.0),
        "wide12g": (Box(np.array([0.019, 0.035, 0.025])), 0.012, 0.0),
        "wedge12g": (Placed(wedge(0.03, 0.05, 0.07, np.radians(8.0)), upright), 0.012, 0.0),
        "sphere12g": (Sphere(np.array(0.027)), 0.012, -0.002),
        "slip60g": (box, 0.060, 0.0),
    }


def scene_of(recording: Recording, solid: tuple[Shape, float, float]) -> Scene:
    """A table with the object on it, as it stood when it was recorded."""
    shape, mass, height = solid
    friction = float(recording.friction)
    return Scene(
        name=recording.name,
        surfaces=(Surface("table", Plane(np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 1.0])), TABLE_FRICTION),),
        objects=(Object("object", shape, friction, mass=mass, pose=Pose(np.eye(3), np.array([0.0, 0.0, 0.025]))),),
        frictions=(PairFriction(("object", "table"), max(friction, TABLE_FRICTION)),),
        contacts=10,
    )


def with_forearm(interaction: Interaction, recording: Recording) -> Interaction:
    """The interaction with the forearm of another recording of the same movement."""
    reference = np.array(interaction.reference)
    reference[:, :3] = np.asarray(recording.q)[:, :3]
    return dataclasses.replace(interaction, name=recording.name, reference=reference)


def interaction_of(recording: Recording) -> Interaction:
    """Estimated, with a pad as stiff at every finger as it is at the finger's mean recorded force."""
    estimated = estimate(Session("grasp5", "C", (recording,)))[0]
    pads = 1.0 / secant_stiffness(pad_force(recording))
    return dataclasses.replace(estimated, model=dataclasses.replace(estimated.model, pad_compliance=pads))


def pad_force(recording: Recording) -> np.ndarray:
    """Mean force of every finger while its sensor reports a contact, N."""
    force, touching = np.linalg.norm(recording.contact_force, axis=2), np.asarray(recording.touching)
    return np.sum(force, axis=0, where=touching) / np.sum(touching, axis=0)


def true_interaction(interaction: Interaction, truth: dict[str, np.ndarray]) -> Interaction:
    """With the true compliances and reference; joints in the model's order after the three of the forearm."""
    compliance = np.broadcast_to(np.concatenate([np.zeros(3), truth["C"]]), np.shape(interaction.compliance))
    reference = np.concatenate([np.asarray(interaction.q)[:, :3], truth["theta_free"]], axis=1)
    return dataclasses.replace(interaction, compliance=compliance, reference=reference)


def judged(rollout: Rollout, truth: dict[str, np.ndarray]) -> tuple[dict[str, Any], np.ndarray]:
    """Figures, and the normal force of every finger `[time, finger]`, N."""
    on_object = [number for number, name in enumerate(rollout.slot_names) if name.endswith("/object")][:5]
    force, normal = np.asarray(rollout.contact_force)[:, on_object], np.asarray(rollout.contact_normal)[:, on_object]
    found, true = np.sum(force * normal, axis=2), truth["f_normal"]
    rise = np.asarray(rollout.object_position)[-1, 0, 2] - np.asarray(rollout.object_position)[0, 0, 2]
    true_rise = truth["object_pose"][-1, 2] - truth["object_pose"][0, 2]
    of_fingers = [nrmse(found[:, i], true[:, i]) for i in range(5)]
    return {
        "total NRMSE": nrmse(found.sum(axis=1), true.sum(axis=1)),
        "finger NRMSE": of_fingers,
        "largest true force N": true.max(axis=0),
        "held N": found[-150:].mean(axis=0),
        "held N, truth": true[-150:].mean(axis=0),
        "rise mm": 1e3 * rise,
        "rise mm, truth": 1e3 * true_rise,
        "lifted": bool(rise > LIFTED),
        "lifted, truth": bool(true_rise > LIFTED),
        "unsolved steps": int(np.sum(np.asarray(rollout.status) > 0)),
    }, found


def nrmse(found: np.ndarray, true: np.ndarray) -> float:
    """RMS error over RMS truth; nan where nothing touched (10 mN are below the sensors' noise of 20 mN)."""
    size = np.sqrt(np.mean(true**2))
    return float(np.sqrt(np.mean((found - true) ** 2)) / size) if true.max() > 0.01 else float("nan")


def main(config: Config) -> dict[str, Any]:
    """Capture, estimate, transfer to the seven objects twice, judge, draw, write."""
    jax.config.update("jax_enable_x64", True)
    trials = {item.name: item for item in trials_of("grasp5", config.cache)}
    solid = solids()
    estimated = interaction_of(trials[config.source])
    result: dict[str, Any] = {
        "data": SIMULATED,
        "estimated from": config.source,
        "pads N/m": 1.0 / np.asarray(estimated.model.pad_compliance),
        "objects": {},
    }
    curves = {}
    for name, recording in trials.items():
        truth = truth_of("grasp5", name)
        scene = scene_of(recording, solid[name])
        own = with_forearm(estimated, recording)
        start = time.perf_counter()
        runs = {"true C": true_interaction(own, truth), "estimated C": own}
        figures = {kind: judged(transfer(item, scene), truth) for kind, item in runs.items()}
        result["objects"][name] = {kind: numbers for kind, (numbers, _) in figures.items()}
        curves[name] = truth, {kind: force for kind, (_, force) in figures.items()}
        print(f"{name:10s}", *(line(kind, numbers) for kind, (numbers, _) in figures.items()), sep="\n  ")
        print(f"  {time.perf_counter() - start:.1f} s for two transfers, compilation included")
    save(drawn(curves), config.out / "grasp5.png")
    write(config.out / "grasp5.json", result)
    return result


def line(kind: str, numbers: dict[str, Any]) -> str:
    """For the terminal."""
    fingers = " ".join(f"{100 * value:.0f}" for value in numbers["finger NRMSE"])
    return (
        f"{kind:12s} total {100 * numbers['total NRMSE']:.1f} %, fingers {fingers} %, rise {numbers['rise mm']:.1f} mm "
        f"(truth {numbers['rise mm, truth']:.1f})"
    )


def drawn(curves: dict[str, Any]) -> Any:
    """A panel an object: grip force of thumb and of the four fingers together, found and true."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 4, figsize=(11, 4.6), sharex=True, layout="constrained")
    colours = {"true C": "#009E73", "estimated C": "#D55E00"}
    for axis, (name, (truth, found)) in zip(axes.flat, curves.items(), strict=False):
        seconds = truth["t"] - truth["t"][0]
        for part in (slice(0, 1), slice(1, 5)):
            axis.plot(seconds, truth["f_normal"][:, part].sum(axis=1), color="#1F2430", linewidth=2.2, alpha=0.35)
            for kind, force in found.items():
                axis.plot(seconds, force[:, part].sum(axis=1), color=colours[kind], linewidth=1.0)
        axis.set_title(name, loc="left", fontsize=9, fontweight="bold")
        axis.spines[["top", "right"]].set_visible(False)
        axis.set_xlim(0.6, seconds[-1])
    for axis in axes[1]:
        axis.set_xlabel("time, s")
    for axis in axes[:, 0]:
        axis.set_ylabel("normal force, N")
    handles = [pyplot.Line2D([], [], color="#1F2430", linewidth=2.2, alpha=0.35, label="independent simulation")]
    handles += [pyplot.Line2D([], [], color=colour, label=f"icjax, {kind}") for kind, colour in colours.items()]
    axes.flat[-1].axis("off")
    axes.flat[-1].legend(handles=handles, loc="center", frameon=False, fontsize=9)
    note = (
        "Upper curve: thumb; lower: four fingers together. Simulated data (MuJoCo subject C); no person was measured."
    )
    figure.supxlabel(note, fontsize=7.5, color="#5B616B")
    return figure


if __name__ == "__main__":
    main(tyro.cli(Config))
