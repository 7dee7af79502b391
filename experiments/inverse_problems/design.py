"""Which contacts tell which joint: expected widths of 95 % intervals, held against those that fits find afterwards.

    python experiments/inverse_problems/design.py

1. Sessions of the virtual laboratory (a MuJoCo subject with skin, tremor, noise of cameras and sensor; other physics
   than ours): `design` is told what an experimenter would plan, posture, speed, depth and friction of every contact,
   and the model's nominal compliance or the subject's true one. Its standard deviations of log C are divided by those
   of `fit_session` on the recording: 1 is perfect.
2. The shipped index finger against a surface, for every flexion of PIP (DIP two thirds of it) and every angle between
   the surface and the distal segment; then one exploring and one better contact over number of contacts, catch trials
   and speed. Writes design.json and design.png.
"""

import dataclasses
import json
import tempfile
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from design_drawing import draw
from recovery import rounded
from scipy.optimize import root_scalar

from icjax.capture import capture, read_session
from icjax.fit import Probe, design, finger_candidates, finger_normal, finger_posture, fit_session
from icjax.laboratory import record
from icjax.model import Model, forward_kinematics, index_finger, pad_positions

BOUND = 1.5
"""Factor between expected and found standard deviations of log C that is called agreement; see `validate`."""

THICKNESS = 7e-3
"""m, half a finger between joint and skin."""

JOINTS = ("wrist", "MP", "PIP", "DIP")


@dataclasses.dataclass(frozen=True)
class Case:
    """A session: true compliance rad/Nm, catch trials of every trial, trials and contacts in each."""

    name: str
    seed: int
    compliance: tuple[float, float, float, float] = (0.25, 0.70, 0.45, 1.10)
    catch: int = 2
    trials: int = 4
    contacts: int = 3
    friction: float = 0.6


@dataclasses.dataclass(frozen=True)
class Config:
    """`cases` to validate; of the map: degrees of wrist and MP, of PIP, of the angle to the surface; of the curves:
    numbers of contacts and catch trials, speeds m/s."""

    cases: tuple[Case, ...] = (
        Case("two catch trials", 11),
        Case("one catch trial", 12, catch=1),
        Case("stiffer finger", 13, compliance=(0.15, 0.40, 0.30, 0.70)),
        Case("six trials, slippery", 14, trials=6, friction=0.3),
    )
    wrist: float = 3.0
    knuckle: float = 18.0
    flexions: tuple[float, ...] = tuple(range(0, 97, 8))
    angles: tuple[float, ...] = tuple(range(0, 91, 6))
    contacts: tuple[int, ...] = (3, 6, 12, 24, 48, 96)
    catches: tuple[int, ...] = (1, 2, 3, 4, 8)
    speeds: tuple[float, ...] = (0.03, 0.05, 0.1, 0.2, 0.3)
    out: Path = Path(__file__).resolve().parents[1] / "results" / "inverse_problems"


def main(config: Config) -> dict[str, Any]:
    """Validation, map, curves, best probes; JSON and figure."""
    jax.config.update("jax_enable_x64", True)
    config.out.mkdir(parents=True, exist_ok=True)
    stated = dataclasses.asdict(config)
    del stated["out"]
    result: dict[str, Any] = {"config": stated, "joints": JOINTS}
    result["map"] = landscape(config)
    result["curves"] = curves(config)
    result["candidates"] = best()
    result["validation"] = {case.name: validate(case) for case in config.cases}
    ratios = np.array([case["found / expected, own compliance"] for case in result["validation"].values()])
    print(f"found / expected sd of log C, own compliance: {ratios.min():.2f} to {ratios.max():.2f}")
    result["within"] = {"bound": BOUND, "share": float(np.mean((ratios < BOUND) & (ratios > 1 / BOUND)))}
    (config.out / "design.json").write_text(json.dumps(rounded(result), indent=1) + "\n")
    draw(result, config, BOUND, config.out / "design.png")
    return result


def validate(case: Case) -> dict[str, Any]:
    """Expected against found: sd of log C from the plan alone, and from the fit of the recording."""
    with tempfile.TemporaryDirectory() as folder:
        paths = record(
            folder, seed=case.seed, trials=case.trials, contacts=case.contacts, compliance=case.compliance,
            catch=case.catch, friction=case.friction,
        )  # fmt: skip
        said = json.loads((paths.session.parent / "truth" / "subject.json").read_text())
        fit = fit_session(capture(read_session(paths.session)))
    model = index_finger(said["subject"]["hand_length"])
    probes = planned(said, case.friction)
    place = fit.made.problem.parameters.slices["compliance"]
    found = np.asarray(fit.laplace.sd)[place]
    own = np.array(model.compliance)
    own[-4:] = case.compliance
    told: dict[str, Any] = {"contacts fitted": len(fit.made.windows), "planned": len(probes), "found sd": found}
    told["found width"] = [joint.width for joint in fit.joints]
    told["found compliance"] = [joint.compliance for joint in fit.joints]
    for what, compliance in (("nominal", model.compliance), ("own", own)):
        plan = design(dataclasses.replace(model, compliance=compliance), probes, case.catch)
        known = plan.expected(range(len(probes)))
        told |= {f"expected width, {what} compliance": known.width, f"expected sd, {what} compliance": known.sd}
        told[f"found / expected, {what} compliance"] = found / known.sd
    measured = np.array([_peak(fit, window) for window in fit.made.windows])
    if len(measured) == len(probes):
        told["largest torque, measured / expected, median"] = np.median(measured / plan.torque, axis=0)
    for key in ("found width", "expected width, nominal compliance", "expected width, own compliance"):
        print(f"{case.name:22s} {key:36s} " + " ".join(f"{value:7.2f}" for value in told[key]), flush=True)
    return told


def _peak(fit, window) -> np.ndarray:
    return np.abs(fit.made.motions[window.trial].torque[window.onset : window.last + 1]).max(axis=0)


def planned(said: dict[str, Any], friction: float) -> list[Probe]:
    """The laboratory's planned touches as probes: each a straight least-jerk path onto the plate."""
    from icjax.laboratory import Subject, Surface
    from icjax.laboratory._movement import reach

    own = {key: tuple(value) if isinstance(value, list) else value for key, value in said["subject"].items()}
    subject, surface = Subject(**own), Surface(friction=friction)
    probes = []
    for trial, touches in enumerate(said["touches"]):
        for number, touch in enumerate(touches):
            way = touch["hover"] + touch["depth"]
            at = root_scalar(
                lambda u, part=touch["hover"] / way: 10 * u**3 - 15 * u**4 + 6 * u**5 - part, bracket=(0.0, 1.0)
            ).root
            speed = 30 * at**2 * (1 - at) ** 2 * way / touch["descent"]
            angles = reach(subject, surface, touch["x_from"] + touch["lead"] * touch["depth"] / way, 0.0)
            probes.append(
                Probe(
                    (0, 0, 0, 1, 0, 0, 0, *angles),
                    "fingertip",
                    speed=speed,
                    depth=touch["depth"],
                    slide=(-touch["lead"] / way * speed, 0.0, 0.0),
                    hover=touch["hover"],
                    friction=friction,
                    contacts=1,
                    name=f"trial {trial} touch {number}",
                )  # fmt: skip
            )
    return probes


def landscape(config: Config) -> dict[str, Any]:
    """Widths of every joint over flexion of PIP and angle to the surface, 12 contacts and 2 catch trials."""
    model = index_finger()
    probes = []
    for flexion in config.flexions:
        degrees = (config.wrist, config.knuckle, float(flexion), 2 / 3 * flexion)
        for angle in config.angles:
            name = f"PIP {flexion:g}, {angle:g} degrees to the surface"
            probes.append(Probe(finger_posture(model, degrees), "fingertip", finger_normal(degrees, angle), name=name))
    plan = design(model, probes)
    shape = (len(config.flexions), len(config.angles), len(JOINTS))
    worst, order = plan.widths.max(axis=1), plan.ranking()
    print("best of the map:")
    for item in order[:5]:
        print(f"  {probes[item].name:44s} " + " ".join(f"{value:6.2f}" for value in plan.widths[item]))
    clear = np.array([on_a_plate(model, probe) for probe in probes])
    plate = [item for item in order if clear[item]]
    print("best of the map against a plate that ends nowhere:")
    for item in plate[:5]:
        print(f"  {probes[item].name:44s} " + " ".join(f"{value:6.2f}" for value in plan.widths[item]))
    chosen = plan.best_set(3, 12)
    print("best three together, 12 contacts: " + "; ".join(probes[item].name for item in chosen))
    return {
        "width": plan.widths.reshape(shape),
        "torque Nm": plan.torque.reshape(shape),
        "clear of a whole plate": clear.reshape(shape[:2]),
        "best on a whole plate": [{"probe": probes[item].name, "width": plan.widths[item]} for item in plate[:5]],
        "share with a number of every joint": float(np.mean(worst <= plan.options.widest)),
        "share with a number": {
            joint: float(np.mean(plan.widths[:, j] <= plan.options.widest)) for j, joint in enumerate(JOINTS)
        },
        "best": [{"probe": probes[item].name, "width": plan.widths[item]} for item in order[:5]],
        "best three, 12 contacts": {
            "probes": [probes[item].name for item in chosen],
            "width": plan.expected(chosen, 12).width,
        },
    }


def on_a_plate(model: Model, probe: Probe) -> bool:
    """Whether the plane could go on behind the pad: every other joint stays `THICKNESS` away from it."""
    poses = forward_kinematics(model, jnp.asarray(probe.q))
    n, pad = np.asarray(probe.normal), model.pad("fingertip")
    surface = n @ np.asarray(pad_positions(model, jnp.asarray(probe.q)))[pad] - model.pad_radius[pad]
    joints = np.asarray(poses.position)[[model.body(name) for name in ("hand", "proximal", "middle", "distal")]]
    return bool(np.min(joints @ n - surface) >= THICKNESS)


CURVES = ("exploring, level plate", "exploring, on the tip")


def curves(config: Config) -> dict[str, Any]:
    """Widths of an exploring contact and of a better one over contacts, catch trials and speed."""
    model = index_finger()
    known = {probe.name: probe for probe in finger_candidates(model)}
    chosen = [known[name] for name in CURVES]
    plan = design(model, chosen)
    catches = [design(model, chosen, count).widths for count in config.catches]
    faster = [
        dataclasses.replace(probe, speed=speed, name=f"{probe.name} {speed}")
        for probe in chosen
        for speed in config.speeds
    ]
    speeds = design(model, faster).widths.reshape(len(chosen), len(config.speeds), -1)
    told = {}
    for item, name in enumerate(CURVES):
        told[name] = {
            "contacts": [plan.expected([item], count).width for count in config.contacts],
            "catch trials": [widths[item] for widths in catches],
            "speed": speeds[item],
        }
        print(f"{name}: 12 contacts " + " ".join(f"{value:6.2f}" for value in plan.expected([item], 12).width))
    return told


def best() -> dict[str, Any]:
    """The shipped candidates, best first: widths, and what the exploring finger's PIP is loaded with."""
    plan = design(index_finger(), finger_candidates(index_finger()))
    table = [
        {"probe": plan.probes[item].name, "width": plan.widths[item], "torque Nm": plan.torque[item]}
        for item in plan.ranking()
    ]
    print("candidates, best first:")
    for row in table:
        print(f"  {row['probe']:26s} " + " ".join(f"{value:6.2f}" for value in row["width"]))
    level = next(row for row in table if row["probe"] == CURVES[0])
    cures = [table[0], next(row for row in table if row["probe"] == CURVES[1])]
    for row in (level, *cures):
        print(f"PIP, {row['probe']}: {1e3 * row['torque Nm'][2]:.1f} mNm, factor {row['width'][2]:.2f}")
    return {"ranking": table}


if __name__ == "__main__":
    main(tyro.cli(Config))
