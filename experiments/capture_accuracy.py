"""Accuracy of capture and of the paper's estimate on the simulated sessions, against their truth.

    python experiments/capture_accuracy.py --shared SHARED_DATA --sessions explore scratch explore_cruise

The data were simulated with MuJoCo, independently of icjax; no person was measured. Nothing of the truth is used in
capture. Writes `results/capture_accuracy.json` beside this script and prints a table. Figures:

- angle: RMS (degrees) after one constant offset a joint, the mean over all trials of the session, is removed;
- offset z: that offset over the `q_offset_sd` that capture states;
- coverage z: RMS of (angle error - mean error of the trial) / stated standard deviation, 1 if the covariance is right;
- torque: RMS(J^T f - truth) / RMS(truth) over the samples with |truth| > 10 mNm;
- onset: detected minus true onset in ms, the true one being the first sample (500 Hz) with a contact force; true
  contacts separated by less than 25 ms are one (the fingertip chatters when it leaves);
- compliance: the pooled estimate (default options) over the true one, less one, with its 95 % interval. The estimator
  is biased there (docs/estimator.md); nothing is tuned to the truth.
"""

import argparse
import json
import os
import time
from pathlib import Path

import jax
import numpy as np

HERE = Path(__file__).resolve().parent
JOINTS = ("wrist", "MP", "PIP", "DIP")
LOADED = 0.010
"""Nm; torques below are not judged."""

CHATTER = 0.025
"""s; a shorter gap between true contacts does not separate them."""


def true_onsets(truth) -> np.ndarray:
    """First samples of the true contacts, s."""
    if "f_contact" not in truth:
        return np.zeros(0)
    touching = np.linalg.norm(truth["f_contact"], axis=1) > 0
    edges = np.diff(np.concatenate([[0], touching.astype(int), [0]]))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    keep = [i for i in range(len(starts)) if i == 0 or (starts[i] - stops[i - 1]) * 0.002 >= CHATTER]
    return truth["t"][starts[keep]]


def judge(name: str, shared: Path, trials: tuple[str, ...] | None = None) -> dict:
    """Figures of one session."""
    from icjax.capture import capture, read_session
    from icjax.estimation import estimate, joint_torque

    os.environ["ICJAX_SHARED_DATA"] = str(shared.resolve())
    spec = read_session(HERE / "sessions" / f"virtual_{name}.toml")
    started = time.perf_counter()
    session = capture(spec, trials=trials)
    took = time.perf_counter() - started
    errors, scaled, torque_errors, torques, onset_errors = [], [], [], [], []
    truths = []
    missed = invented = 0
    for recording in session.recordings:
        truth = np.load(shared / "virtual_sessions" / name / f"{recording.name}_truth.npz")
        truths.append(truth)
        dofs = [recording.model.dof_names.index(joint) for joint in JOINTS]
        columns = [recording.model.coordinate_slices[recording.model.joint(joint)].start for joint in JOINTS]
        error = np.asarray(recording.q)[:, columns] - truth["theta"]
        errors.append(error)
        sd = np.sqrt(np.diagonal(np.asarray(recording.q_covariance), axis1=1, axis2=2)[:, dofs])
        scaled.append((error - error.mean(axis=0)) / sd)
        expected = true_onsets(truth)
        found = np.asarray(recording.events.onset)
        near = np.abs(found[:, None] - expected[None, :]) < 0.1
        missed += int((~near.any(axis=0)).sum())
        invented += int((~near.any(axis=1)).sum()) + int((near.sum(axis=0) > 1).sum())
        onset_errors += [float(found[near[:, i]][0] - expected[i]) for i in range(len(expected)) if near[:, i].any()]
        if "tau" in truth:
            torques.append(truth["tau"])
            torque_errors.append(np.asarray(joint_torque(recording))[:, dofs] - truth["tau"])
    error = np.concatenate(errors)
    offset = error.mean(axis=0)
    offset_sd = np.mean([np.asarray(item.q_offset_sd)[dofs] for item in session.recordings], axis=0)
    torque, torque_error = np.concatenate(torques), np.concatenate(torque_errors)
    loaded = np.abs(torque) > LOADED
    nrmse = [
        np.sqrt(np.mean(torque_error[loaded[:, j], j] ** 2) / np.mean(torque[loaded[:, j], j] ** 2)) for j in range(4)
    ]
    onset = 1e3 * np.array(onset_errors)
    summary = estimate(session)[0].summary
    rows = [summary.joint_names.index(joint) for joint in JOINTS]
    ends = [np.asarray(item)[rows] for item in (summary.compliance, summary.lower, summary.upper)]
    true = next(truth["C"] for truth in truths if "C" in truth)
    return {
        "trials": len(session.recordings),
        "frames": len(error),
        "angle_rms_deg": np.degrees(np.sqrt(np.mean((error - offset) ** 2, axis=0))).round(3).tolist(),
        "offset_deg": np.degrees(offset).round(3).tolist(),
        "offset_z": (offset / offset_sd).round(2).tolist(),
        "coverage_z": np.sqrt(np.mean(np.concatenate(scaled) ** 2, axis=0)).round(2).tolist(),
        "torque_nrmse_percent": (100 * np.array(nrmse)).round(2).tolist(),
        "contacts": len(onset) + missed,
        "missed": missed,
        "invented": invented,
        "onset_error_ms_median_abs": round(float(np.median(np.abs(onset))), 2),
        "onset_error_ms_mean": round(float(np.mean(onset)), 2),
        "onset_error_ms_largest": round(float(np.max(np.abs(onset))), 2),
        "compliance_true": true.tolist(),
        "compliance_error_percent": _numbers(100 * (ends[0] / true - 1), 0),
        "compliance_interval": [_numbers(pair, 4) for pair in np.stack(ends[1:], axis=1)],
        "compliance_inside": int(np.sum((ends[1] <= true) & (true <= ends[2]))),
        "valid_percent": round(100 * float(np.mean([np.mean(item.valid) for item in session.recordings])), 2),
        "seconds": round(took, 1),
    }


def _numbers(values, digits: int) -> list:
    """Rounded; None where a value is not finite."""
    return [round(float(value), digits) if np.isfinite(value) else None for value in values]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path, required=True, help="folder that holds virtual_sessions")
    parser.add_argument("--sessions", nargs="+", default=["explore", "scratch", "explore_cruise"])
    parser.add_argument("--out", type=Path, default=HERE / "results" / "capture_accuracy.json")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    figures = {}
    for name in arguments.sessions:
        figures[name] = judge(name, arguments.shared)
        print(name, json.dumps(figures[name]), flush=True)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps({"data": "simulated", "joints": JOINTS, "sessions": figures}, indent=1) + "\n")
    print(f"\n{'session':16}{'angle RMS (deg)':>32}{'torque NRMSE (%)':>32}{'onset median, largest (ms)':>28}")
    for name, item in figures.items():
        angle = "".join(f"{value:8.3f}" for value in item["angle_rms_deg"])
        torque = "".join(f"{value:8.2f}" for value in item["torque_nrmse_percent"])
        onset = f"{item['onset_error_ms_median_abs']:.2f}, {item['onset_error_ms_largest']:.2f}"
        print(f"{name:16}{angle}{torque}{onset:>28}")
    print(f"\n{'session':16}{'pooled compliance, error (%)':>36}{'truth inside':>16}")
    for name, item in figures.items():
        error = "".join(
            f"{'none' if value is None else f'{value:.0f}':>9}" for value in item["compliance_error_percent"]
        )
        print(f"{name:16}{error}{item['compliance_inside']:>14} of {len(JOINTS)}")


if __name__ == "__main__":
    main()
