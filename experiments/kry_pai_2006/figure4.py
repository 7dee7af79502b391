"""Figure 4 of Kry and Pai (2006): one captured interaction on the same surface, on a bump and at other friction.

    python experiments/kry_pai_2006/figure4.py

A simulated subject (`icjax.laboratory`: MuJoCo, with inertia and damping) taps and strokes a flat plate. The
recording is captured, estimated and transferred; the laboratory then repeats the same commanded movement on each
surface, and the transfer is compared with that. All data are simulated. Writes figure4.png and figure4.json.
"""

import dataclasses
import json
import tempfile
from pathlib import Path

import jax
import numpy as np
import tyro

from icjax.capture import capture, read_session
from icjax.estimation import EstimationOptions, estimate
from icjax.geometry import Ellipsoid, Plane
from icjax.interaction import Interaction
from icjax.laboratory import Bump, Truth, bump_under, load_truth, record, replay
from icjax.model import pad_positions
from icjax.rollout import Rollout
from icjax.synthesis import Scene, Surface, transfer

HERE = Path(__file__).resolve().parent
JOINTS = ("wrist", "MP", "PIP", "DIP")
COLOURS = {"true C and reference": "tab:green", "true C": "tab:blue", "estimated C": "tab:orange"}


@dataclasses.dataclass(frozen=True)
class Config:
    """What is recorded and where it is taken."""

    seed: int = 0
    trials: int = 2
    contacts: int = 3
    friction: float = 0.6
    other_friction: float = 0.2
    bump_height: float = 0.003
    step: float = 0.002
    facets: int = 4
    out: Path = HERE.parent / "results" / "kry_pai_2006"


def main(config: Config) -> dict:
    """Record, capture, estimate, transfer, compare, draw."""
    jax.config.update("jax_enable_x64", True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "session"
        paths = record(
            folder, seed=config.seed, trials=config.trials, contacts=config.contacts, friction=config.friction
        )
        session = capture(read_session(paths.session))
        bump = bump_under(folder, height=config.bump_height)
        truths = {
            "flat": load_truth(folder / "truth" / "trial00.npz"),
            "bump": replay(folder, bump=bump),
            "friction": replay(folder, friction=config.other_friction),
        }
    flat = truths["flat"]
    given = dict(zip(JOINTS, (float(value) for value in flat.C), strict=True))
    exact = estimate(session, EstimationOptions(given=given))[0]
    interactions = {
        "true C and reference": with_reference(exact, flat),
        "true C": exact,
        "estimated C": estimate(session)[0],
    }
    scenes = {
        "flat": scene("flat", config, config.friction, None),
        "bump": scene("bump", config, config.friction, bump),
        "friction": scene("friction", config, config.other_friction, None),
    }
    rollouts = {
        (surface, variant): transfer(interaction, scenes[surface])
        for surface in scenes
        for variant, interaction in interactions.items()
    }
    result = {
        "data": "simulated by icjax.laboratory; no person was measured",
        "measure": "NRMSE: RMS error over RMS of the laboratory's force, where either touches; path: RMS distance "
        "of the undeformed fingertip's centre there",
        "config": {**dataclasses.asdict(config), "out": None},
        "compliance": {
            "true": given,
            "source of the estimated one": json.loads(interactions["estimated C"].provenance)["sources"],
            "estimated": dict(
                zip(
                    interactions["estimated C"].summary.joint_names,
                    (float(value) for value in interactions["estimated C"].summary.compliance),
                    strict=True,
                )
            ),
        },
        "surfaces": {
            surface: {variant: compare(rollouts[surface, variant], truths[surface]) for variant in interactions}
            | {"the recording itself, not transferred": unchanged(flat, truths[surface])}
            for surface in scenes
        },
    }
    config.out.mkdir(parents=True, exist_ok=True)
    draw(config.out / "figure4.png", truths, rollouts, bump)
    (config.out / "figure4.json").write_text(json.dumps(rounded(result), indent=1) + "\n")
    return result


def with_reference(interaction: Interaction, truth: Truth) -> Interaction:
    """The interaction with the subject's true joint reference, the root as it truly moved."""
    x, z, pitch = truth.root[: len(interaction.time)].T
    nothing = np.zeros_like(pitch)
    root = (x, nothing, z, np.cos(pitch / 2), nothing, np.sin(pitch / 2), nothing)
    reference = np.column_stack([*root, truth.theta_free[: len(pitch)]])
    return dataclasses.replace(interaction, reference=reference)


def scene(name: str, config: Config, friction: float, bump: Bump | None) -> Scene:
    """The laboratory's plate, with or without the bump."""
    surfaces = [Surface("plate", Plane(np.zeros(3), np.array([0.0, 0.0, 1.0])), friction)]
    if bump is not None:
        shape = Ellipsoid(np.asarray(bump.centre), np.eye(3), np.asarray(bump.radii))
        surfaces.append(Surface("bump", shape, friction))
    return Scene(name=name, surfaces=tuple(surfaces), facets=config.facets, step=config.step)


def fingertip(rollout: Rollout) -> np.ndarray:
    """Centre of the undeformed fingertip [time, 3], m."""
    return np.asarray(jax.vmap(lambda q: pad_positions(rollout.model, q))(rollout.q))[:, 0]


def compare(rollout: Rollout, truth: Truth) -> dict:
    """Measures of a transfer against the laboratory on the same surface."""
    force = np.stack([np.interp(truth.t, rollout.time, total) for total in rollout.contact_force.sum(axis=1).T], 1)
    path = np.stack([np.interp(truth.t, rollout.time, axis) for axis in fingertip(rollout).T], 1)
    unsolved = int(np.sum(rollout.status != 0))
    return measures(force, path, truth) | {"steps not solved": unsolved}


def unchanged(flat: Truth, truth: Truth) -> dict:
    """The same measures for a transfer that changes nothing: what happened on the recorded surface."""
    return measures(flat.f_contact, flat.bone, truth)


def measures(force: np.ndarray, path: np.ndarray, truth: Truth) -> dict:
    """Normalised errors of force [time, 3] and fingertip path [time, 3] where something touches."""
    touching = (force[:, 2] > 0.0) | (truth.f_contact[:, 2] > 0.0)
    started = np.flatnonzero(np.diff(touching.astype(int)) == 1)
    early = np.zeros_like(touching)
    for start in started:
        early |= (truth.t > truth.t[start]) & (truth.t <= truth.t[start] + 0.1)
    late = touching & ~early

    def nrmse(where: np.ndarray, axis: int) -> float:
        error = force[where, axis] - truth.f_contact[where, axis]
        return float(np.sqrt(np.mean(error**2) / np.mean(truth.f_contact[where, axis] ** 2)))

    distance = np.linalg.norm((path - truth.bone)[touching][:, [0, 2]], axis=1)
    return {
        "normal force NRMSE": nrmse(touching, 2),
        "normal force NRMSE after 100 ms": nrmse(late, 2),
        "tangential force NRMSE": nrmse(touching, 0),
        "path RMS mm": float(1e3 * np.sqrt(np.mean(distance**2))),
    }


def draw(path: Path, truths: dict[str, Truth], rollouts: dict[tuple[str, str], Rollout], bump: Bump) -> None:
    """Forces over time and fingertip paths, one column a surface."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, len(truths), figsize=(13, 8), sharey="row", layout="constrained")
    touched = np.flatnonzero(truths["flat"].f_contact[:, 2] > 0.0)
    start, end = truths["flat"].t[touched[0]] - 0.15, truths["flat"].t[touched[-1]] + 0.15
    for column, (surface, truth) in enumerate(truths.items()):
        normal, tangential, plane = axes[:, column]
        shown = (truth.t >= start) & (truth.t <= end)
        normal.plot(truth.t, truth.f_contact[:, 2], "k", lw=1.2, label="laboratory")
        tangential.plot(truth.t, truth.f_contact[:, 0], "k", lw=1.2)
        plane.plot(1e3 * truth.bone[shown, 0], 1e3 * truth.bone[shown, 2], "k", lw=1.2)
        for variant, colour in COLOURS.items():
            rollout = rollouts[surface, variant]
            force, tip = rollout.contact_force.sum(axis=1), fingertip(rollout)
            inside = (rollout.time >= start) & (rollout.time <= end)
            style = {"color": colour, "lw": 0.9, "alpha": 0.9}
            normal.plot(rollout.time, force[:, 2], label=variant, **style)
            tangential.plot(rollout.time, force[:, 0], **style)
            plane.plot(1e3 * tip[inside, 0], 1e3 * tip[inside, 2], **style)
        if surface == "bump":
            x = np.linspace(-bump.radii[0], bump.radii[0], 200)
            z = bump.radii[2] * np.sqrt(1.0 - (x / bump.radii[0]) ** 2)
            plane.fill_between(1e3 * (x + bump.centre[0]), 1e3 * z, color="0.8")
        plane.axhline(0.0, color="0.6", lw=0.8)
        normal.set(title=surface, xlim=(start, end))
        tangential.set(xlabel="time (s)", xlim=(start, end))
        plane.set(xlabel="x (mm)", ylim=(-1.0, 16.0))
    axes[0, 0].set_ylabel("normal force (N)")
    axes[1, 0].set_ylabel("tangential force (N)")
    axes[2, 0].set_ylabel("fingertip centre z (mm)")
    axes[0, 0].legend(fontsize=8)
    figure.suptitle("Transfer to other surfaces against an independent simulation of the subject (simulated data)")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def rounded(value):
    """Three significant digits, so that the committed file does not change with the machine; null for no number."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, float):
        return float(f"{value:.3g}") if np.isfinite(value) else None
    return value


if __name__ == "__main__":
    print(json.dumps(rounded(main(tyro.cli(Config)))["surfaces"], indent=1))
