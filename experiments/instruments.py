"""What instruments and clocks cost and what correction gives back, on simulated sessions, against their truth.

    python experiments/instruments.py --shared SHARED_DATA [--only clock top film grasp]

The data were simulated with MuJoCo, independently of icjax; no person was measured. The truth only judges. Writes
`results/instruments.json`:

- clock: trial00 of `explore` as a separately clocked acquisition recorded it, by sync pulses and by contacts alone; the
  same by contacts alone for trials on a shared clock (true offset zero), and simulated clocks of longer recordings.
- top: force error (N, RMS from 20 ms before to 150 ms after the platform's release, both forces at 60 Hz) without
  correction, with the mass that `hand_model.json` states (20 g), and with twice that.
- film: fingertip sensors of `grasp5`. There is no recording against a reference in that session, so the **true normal
  force stands for a reference sensor**, in every other tenth of a second; the rest judges. Gains differ from
  file to file in these data, so each file is calibrated by itself.
- grasp (some minutes): joint torque from normal forces alone, and how far the stated direction is off.
"""

import argparse
import dataclasses
import json
import os
from pathlib import Path

import jax
import numpy as np

HERE = Path(__file__).resolve().parent
FINGERS = ("thumb", "index", "middle", "ring", "little")
STEP = (0.02, 0.15)
"""s before and after the release of the platform: the step and the withdrawal that follows."""

LEAST = 0.15
"""N; a finger that presses less is not calibrated."""


def session(name: str):
    from icjax.capture import read_session

    return read_session(HERE / "sessions" / f"virtual_{name}.toml")


def judge_clock(shared: Path) -> dict:
    """Offset, drift and alignment of the separate acquisition; lags of contacts where the clock is shared."""
    from icjax.capture._align import _from_contacts
    from icjax.capture._load import load_trial
    from icjax.capture._spec import ClockSpec

    offset, drift = np.load(shared / "virtual_sessions" / "explore" / "trial00_truth.npz")["clock"]
    spec = session("explore_daq")
    when = np.linspace(0.0, 6.72, 200)
    found = {}
    contacts = dataclasses.replace(spec, clock=ClockSpec(correlate="plate"))
    for name, each in (("sync", spec), ("contacts", contacts)):
        clock = load_trial(each, each.trials[0]).metadata["clock"]
        aligned = clock.on_marker_clock((when + offset) * (1 + drift)) - when
        found[name] = {
            "offset_error_ms": round(1e3 * float(clock.offset - offset), 3),
            "offset_sd_ms": round(1e3 * clock.offset_sd, 3),
            "drift_ppm": round(1e6 * clock.drift, 1),
            "drift_error_ppm": round(1e6 * float(clock.drift - drift), 1),
            "drift_sd_ppm": round(1e6 * clock.drift_sd, 1),
            "largest_misalignment_ms": round(1e3 * float(np.abs(aligned).max()), 3),
        }
    lags, scaled = {}, []
    for name in ("explore", "scratch", "explore_cruise"):
        spec = session(name)
        lags[name] = []
        for trial in spec.trials:
            if trial.role != "trial":
                continue
            motion = load_trial(dataclasses.replace(spec, clock=None), trial)
            clock = _from_contacts(spec, ClockSpec(correlate="plate"), trial, motion)
            lags[name].append(round(1e3 * clock.offset, 2))
            scaled.append(clock.offset / clock.offset_sd)
    every = np.concatenate([np.array(item) for item in lags.values()])
    return found | {
        "contacts_on_a_shared_clock_ms": lags,
        "contacts_mean_ms": round(float(every.mean()), 2),
        "contacts_rms_ms": round(float(np.sqrt(np.mean(every**2))), 2),
        "contacts_largest_ms": round(float(np.abs(every).max()), 2),
        "contacts_rms_over_stated_sd": round(float(np.sqrt(np.mean(np.square(scaled)))), 2),
        "simulated_pulses": [simulated_pulses(seconds) for seconds in (7, 30, 120)],
    }


def simulated_pulses(seconds: int, clocks: int = 20) -> dict:
    """Digital pulses every second, sampled at 1 kHz by clocks that differ by 50 ppm (one standard deviation)."""
    from icjax.capture._clock import clock_from_pulses
    from icjax.capture._pulses import rising_edges

    rng = np.random.default_rng(seconds)
    errors, scaled = [], []
    for _ in range(clocks):
        offset, drift = rng.uniform(0.05, 0.95), rng.normal(0.0, 5e-5)
        time = np.arange(int((seconds + 1.5) * 1000)) * 1e-3
        on_marker = time / (1 + drift) - offset
        pulse = 5.0 * ((on_marker % 1.0 < 0.02) & (on_marker >= 0))
        clock = clock_from_pulses(rising_edges(pulse, time), np.arange(seconds + 2.0), 1e-3, 5e-5)
        errors.append((1e3 * (clock.offset - offset), 1e6 * (clock.drift - drift)))
        scaled.append((clock.offset - offset, clock.drift - drift) / np.array([clock.offset_sd, clock.drift_sd]))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    z = np.sqrt(np.mean(np.square(scaled), axis=0))
    return {
        "seconds": seconds,
        "offset_rms_ms": round(float(rms[0]), 3),
        "drift_rms_ppm": round(float(rms[1]), 2),
        "rms_over_stated_sd": z.round(2).tolist(),
    }


def judge_top(shared: Path) -> dict:
    """Vertical force error during the platform's step without the inertia of the top, with it, and with twice it."""
    from icjax.capture._filters import lowpass
    from icjax.capture._load import load_trial
    from icjax.capture._sensors import sensor_wrench
    from icjax.capture._spec import TopSpec
    from icjax.capture._synchronise import on_marker_clock

    result = {}
    for name in ("perturb_explore", "perturb_scratch"):
        spec = session(name)
        hand = json.loads((shared / "virtual_sessions" / name / "hand_model.json").read_text())
        stated = float(hand["sensor"]["top_plate_mass"])
        rows = []
        for trial in spec.trials:
            motion = load_trial(spec, trial)
            truth = np.load(shared / "virtual_sessions" / name / f"{trial.name}_truth.npz")
            true = lowpass(truth["f_contact"].astype(float), 500.0, 60.0)
            time, release = motion.marker_time, float(truth["release_time"])
            during = (time > release - STEP[0]) & (time < release + STEP[1])
            before = (time > 0.3) & (time < release - 0.05)
            row = {"trial": trial.name, "force_rms_n": round(float(np.sqrt(np.mean(true[during, 2] ** 2))), 3)}
            for label, mass in (("uncorrected", 0.0), ("corrected", stated), ("twice_the_mass", 2 * stated)):
                top = TopSpec(mass, ("PL1", "PL2", "PL3", "PL4"), (), None, 60.0)
                source = dataclasses.replace(spec.source("plate"), top=top if mass else None)
                sensor = sensor_wrench(motion, trial, source, spec.path)
                error = (on_marker_clock(sensor, time, 60.0)[:, 3:] - true)[:, 2]
                row[label + "_n"] = round(float(np.sqrt(np.mean(error[during] ** 2))), 3)
                row[label + "_at_rest_n"] = round(float(np.std(error[before])), 4)
            rows.append(row)
        result[name] = {"stated_mass_kg": stated, "trials": rows}
    return result


def judge_film(shared: Path) -> dict:
    """Gain of every fingertip sensor: half of the samples calibrate, the other half judges."""
    from icjax.capture import fit_curve
    from icjax.files import read_c3d

    folder = shared / "virtual_sessions" / "grasp5"
    rows = []
    for trial in [item["trial"] for item in json.loads((folder / "session.json").read_text())["trials"]]:
        motion, truth = read_c3d(folder / f"{trial}.c3d"), np.load(folder / f"{trial}_truth.npz")
        for index, finger in enumerate(FINGERS):
            volts, true = motion.channels([f"Fn_{finger}"])[:, 0], truth["f_normal"][:, index].astype(float)
            first = (np.floor(motion.analog_time / 0.1) % 2) == 0
            row = {"trial": trial, "finger": finger, "largest_n": round(float(true.max()), 2)}
            rows.append(row)
            if true.max() < LEAST:
                continue
            try:
                curve = fit_curve(f"Fn_{finger}", motion.analog_time[first], volts[first], true[first], 0.0)
            except ValueError as error:
                row["refused"] = str(error)
                continue
            loaded = ~first & (true > 0.1 * true.max())
            gain = float(volts[loaded] @ true[loaded] / (true[loaded] @ true[loaded]))
            noise = float(np.std(volts[loaded] - gain * true[loaded]))
            corrected = curve(volts[loaded])
            knots = curve.voltage[1:] @ curve.force[1:] / (curve.force[1:] @ curve.force[1:])
            left = float(corrected @ true[loaded] / (true[loaded] @ true[loaded]))
            row |= {
                "gain_error_percent": round(100 * (gain - 1), 2),
                "recovered_gain_error_percent": round(100 * float(knots - 1), 2),
                "left_after_correction_percent": round(100 * (left - 1), 2),
                "gain_sd_percent": round(100 * noise / float(np.sqrt(np.sum(true[loaded] ** 2))), 2),
                "noise_n": round(noise, 4),
                "rms_before_n": round(float(np.sqrt(np.mean((volts - true)[loaded] ** 2))), 4),
                "rms_after_n": round(float(np.sqrt(np.mean((corrected - true[loaded]) ** 2))), 4),
            }
    used = [row for row in rows if "gain_error_percent" in row]
    before = np.array([row["gain_error_percent"] for row in used])
    difference = before - [row["recovered_gain_error_percent"] for row in used]
    return {
        "reference": "the true normal force of the simulation stands for a reference force sensor",
        "calibrated": len(used),
        "gain_error_rms_percent": round(float(np.sqrt(np.mean(before**2))), 2),
        "recovered_minus_true_gain_rms_percent": round(float(np.sqrt(np.mean(difference**2))), 2),
        "left_after_correction_rms_percent": round(
            float(np.sqrt(np.mean([row["left_after_correction_percent"] ** 2 for row in used]))), 2
        ),
        "rms_after_over_noise": round(float(np.median([row["rms_after_n"] / row["noise_n"] for row in used])), 2),
        "sensors": rows,
    }


def judge_grasp(shared: Path, name: str = "box60g") -> dict:
    """Joint torque from normal forces alone, directions stated in world axes, on one trial of five fingers."""
    from icjax.capture import capture
    from icjax.estimation import joint_torque

    recording = capture(session("grasp5"), trials=(name,)).recordings[0]
    truth = np.load(shared / "virtual_sessions" / "grasp5" / f"{name}_truth.npz")
    true, found = truth["f_contact"].astype(float), np.asarray(recording.contact_force)
    touching = np.asarray(recording.touching) & (np.linalg.norm(true, axis=2) > 0.05)
    angles = {}
    for index, finger in enumerate(recording.contact_names):
        on = touching[:, index]
        cosine = np.sum(true[on, index] * found[on, index], axis=1)
        cosine /= np.linalg.norm(true[on, index], axis=1) * np.linalg.norm(found[on, index], axis=1)
        angles[finger] = round(float(np.degrees(np.median(np.arccos(np.clip(cosine, -1, 1))))), 1)
    torque = np.asarray(joint_torque(recording))
    joints = [str(item) for item in truth["joints"]]
    columns = [recording.model.dof_names.index(joint) for joint in joints]
    error = torque[:, columns] - truth["tau"]
    size = np.sqrt(np.mean(truth["tau"].astype(float) ** 2, axis=0))
    nrmse = 100 * np.sqrt(np.mean(error**2, axis=0)) / size
    return {
        "trial": name,
        "onsets": len(recording.events.onset),
        "angle_between_stated_normal_and_true_force_deg": angles,
        "torque_nrmse_percent": dict(zip(joints, nrmse.round(1).tolist(), strict=True)),
        "torque_rms_mnm": dict(zip(joints, (1e3 * size).round(2).tolist(), strict=True)),
    }


JUDGES = {"clock": judge_clock, "top": judge_top, "film": judge_film, "grasp": judge_grasp}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path, required=True, help="folder that holds virtual_sessions")
    parser.add_argument("--only", nargs="+", choices=JUDGES, default=list(JUDGES), help="others keep their figures")
    parser.add_argument("--out", type=Path, default=HERE / "results" / "instruments.json")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    os.environ["ICJAX_SHARED_DATA"] = str(arguments.shared.resolve())
    figures = {"data": "simulated"}
    if arguments.out.is_file():
        figures |= json.loads(arguments.out.read_text())
    for name in arguments.only:
        figures[name] = JUDGES[name](arguments.shared)
        print(name, json.dumps(figures[name]), flush=True)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
