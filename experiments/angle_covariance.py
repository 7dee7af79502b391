"""Whether the stated covariance of the joint angles is that of their errors, on the simulated sessions.

    python experiments/angle_covariance.py --shared SHARED_DATA

The data were simulated with MuJoCo, independently of icjax; no person was measured. Nothing of the truth is used in
capture. Writes `results/angle_covariance.json` beside this script; sessions that it holds already stay unless they
are asked for. With e = q - truth for wrist, MP, PIP, DIP:

- frame, per joint: RMS of (e - mean of e over the session) / sd of the frame-to-frame error;
- frame, joint: sqrt(mean of e' Sigma^-1 e / 4), the same with the whole covariance of a frame;
- total, per joint: RMS of e / sqrt(frame variance + offset variance), the constant offset left in;
- total, joint: sqrt(mean of e' (Sigma + Sigma_offset)^-1 e / 4);
- offset: o' Sigma_offset^-1 o for the mean error o of a session: chi-square with 4 degrees of freedom.

An offset is one draw a joint and subject, so one session says little: explore and explore_cruise are of one subject
whose markers stay where they are, scratch of another. The pooled offset takes each subject once, 8 degrees of freedom
in all: sqrt(chi-square / 8), whose 95 % range for a right covariance is 0.52 to 1.48.
"""

import argparse
import dataclasses
import json
import os
from pathlib import Path

import jax
import numpy as np

HERE = Path(__file__).resolve().parent
JOINTS = ("wrist", "MP", "PIP", "DIP")
SUBJECTS = {"explore": "A", "explore_cruise": "A", "scratch": "B"}


def quadratic(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """e' Sigma^-1 e of every row."""
    return np.einsum("fi,fi->f", errors, np.linalg.solve(covariances, errors[:, :, None])[:, :, 0])


def judge(name: str, shared: Path, trials: tuple[str, ...] | None = None, calibrate: bool = False) -> dict:
    """Figures of one session, with `calibrate` on a model calibrated by its first four trials."""
    from icjax.capture import CalibrationOptions, capture, read_session

    os.environ["ICJAX_SHARED_DATA"] = str(shared.resolve())
    spec = read_session(HERE / "sessions" / f"virtual_{name}.toml")
    if calibrate:
        options = CalibrationOptions(tuple(trial.name for trial in spec.trials[:4]))
        spec = dataclasses.replace(spec, calibration=options)
    session = capture(spec, trials=trials)
    errors, frame, offsets = [], [], []
    for recording in session.recordings:
        truth = np.load(shared / "virtual_sessions" / name / f"{recording.name}_truth.npz")
        model = recording.model
        dofs = [model.dof_names.index(joint) for joint in JOINTS]
        columns = [model.coordinate_slices[model.joint(joint)].start for joint in JOINTS]
        errors.append(np.asarray(recording.q)[:, columns] - truth["theta"])
        frame.append(np.asarray(recording.q_covariance)[:, dofs][:, :, dofs])
        offsets.append(np.asarray(recording.q_offset_covariance)[np.ix_(dofs, dofs)])
    error, covariance, left = np.concatenate(errors), np.concatenate(frame), np.mean(offsets, axis=0)
    offset = error.mean(axis=0)
    moving = error - offset
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    return {
        "trials": len(session.recordings),
        "frame_per_joint": np.sqrt(np.mean(moving**2 / variance, axis=0)).round(3).tolist(),
        "frame_joint": round(float(np.sqrt(np.mean(quadratic(moving, covariance)) / 4)), 3),
        "total_per_joint": np.sqrt(np.mean(error**2 / (variance + np.diag(left)), axis=0)).round(3).tolist(),
        "total_joint": round(float(np.sqrt(np.mean(quadratic(error, covariance + left[None])) / 4)), 3),
        "offset_deg": np.degrees(offset).round(3).tolist(),
        "offset_sd_deg": np.degrees(np.sqrt(np.diag(left))).round(3).tolist(),
        "offset_chi_square": round(float(quadratic(offset[None], left[None])[0]), 3),
    } | (_lengths(session.recordings[0].provenance) if calibrate else {})


def _lengths(provenance: str) -> dict:
    """Relative changes of the segments and their deviations; the model's lengths are the true ones."""
    items = json.loads(provenance)["calibration"]["parameters"]
    return {
        item["name"]: [round(item["value"], 4), round(item["sd"], 4)]
        for item in items
        if item["name"].startswith("length")
    }


def pooled(figures: dict) -> dict:
    """Over sessions: the total error, and the offsets with each subject once (its first session)."""
    chosen = {SUBJECTS[name]: item for name, item in reversed(list(figures.items()))}
    square = sum(item["offset_chi_square"] for item in chosen.values())
    return {
        "total_per_joint": np.sqrt(np.mean([np.square(item["total_per_joint"]) for item in figures.values()], axis=0))
        .round(3)
        .tolist(),
        "total": round(float(np.sqrt(np.mean([np.square(item["total_per_joint"]) for item in figures.values()]))), 3),
        "total_joint": round(float(np.sqrt(np.mean([item["total_joint"] ** 2 for item in figures.values()]))), 3),
        "offset": round(float(np.sqrt(square / (4 * len(chosen)))), 3),
        "subjects": len(chosen),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path, required=True, help="folder that holds virtual_sessions")
    parser.add_argument("--sessions", nargs="+", default=list(SUBJECTS))
    parser.add_argument("--calibrate", action="store_true", help="calibrate the model first, by four trials")
    parser.add_argument("--out", type=Path, default=HERE / "results" / "angle_covariance.json")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    held = json.loads(arguments.out.read_text()) if arguments.out.is_file() else {}
    figures, calibrated = held.get("sessions", {}), held.get("calibrated", {})
    for name in arguments.sessions:
        found = judge(name, arguments.shared, calibrate=arguments.calibrate)
        (calibrated if arguments.calibrate else figures)[name] = found
        print(name, json.dumps(found), flush=True)
    result = {"data": "simulated", "joints": JOINTS, "sessions": figures, "calibrated": calibrated}
    if figures:
        result["pooled"] = pooled(figures)
        print("pooled", json.dumps(result["pooled"]))
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
