"""Does the inertial correction of Eq. 2 help the paper's compliance estimate? On simulated sessions, against truth.

    python experiments/inertia_correction.py --shared SHARED_DATA

The data were simulated with MuJoCo, independently of icjax; no person was measured. Every contact of every trial is
estimated by section 3.3 with quadratic windows of 60 and 100 ms: with J^T f alone (`static`), with
`EstimationOptions(inertia=True)` and the session's model, which states masses of water-filled cylinders and no damping
(`inertia`), and with the true damping added to that model (`inertia and true damping`; a user would not know it).
Errors are |C - truth| / truth in per cent, the median over the events that give an estimate, negative ones included.
Writes `results/inertia_correction.json` beside this script.
"""

import argparse
import dataclasses
import json
import os
from pathlib import Path

import equinox as eqx
import jax
import numpy as np

HERE = Path(__file__).resolve().parent
JOINTS = ("wrist", "MP", "PIP", "DIP")


def judged(recordings, torques, options, truth) -> dict:
    """Error of the median event and counts, a joint."""
    from icjax.estimation import compliance_at_contact

    found = compliance_at_contact(recordings, options, torques)
    columns = [found.joint_names.index(joint) for joint in JOINTS]
    value = np.asarray(found.compliance)[:, columns]
    error = np.abs(value / truth - 1.0)
    return {
        "error_percent": np.round(100 * np.nanmedian(error, axis=0), 1).tolist(),
        "median_over_truth": np.round(np.nanmedian(value / truth, axis=0), 3).tolist(),
        "negative": np.sum(value < 0, axis=0).tolist(),
        "events": np.sum(np.isfinite(value), axis=0).tolist(),
    }


def judge(name: str, shared: Path) -> dict:
    """Figures of one session."""
    from icjax.capture import capture, read_session
    from icjax.estimation import EstimationOptions, joint_torque

    os.environ["ICJAX_SHARED_DATA"] = str(shared.resolve())
    spec = read_session(HERE / "sessions" / f"virtual_{name}.toml")
    trials = tuple(trial.name for trial in spec.trials if trial.role == "trial")
    recordings = capture(spec, trials=trials).recordings
    torques = tuple(np.asarray(joint_torque(recording)) for recording in recordings)
    truth = np.load(shared / "virtual_sessions" / name / f"{trials[0]}_truth.npz")
    damping = np.array(spec.model.damping)
    damping[[spec.model.dof_names.index(joint) for joint in JOINTS]] = truth["B"]
    damped = tuple(eqx.tree_at(lambda item: item.model.damping, recording, damping) for recording in recordings)
    figures = {}
    for window in (0.06, 0.1):
        static = EstimationOptions(window_before=window, window_after=window)
        moving = dataclasses.replace(static, inertia=True)
        rows = (
            ("static", recordings, static),
            ("inertia", recordings, moving),
            ("inertia and true damping", damped, moving),
        )
        for label, items, options in rows:
            figures[f"{label}, {1e3 * window:.0f} ms"] = judged(items, torques, options, truth["C"])
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path, required=True, help="folder that holds virtual_sessions")
    parser.add_argument("--sessions", nargs="+", default=["explore", "scratch"])
    parser.add_argument("--out", type=Path, default=HERE / "results" / "inertia_correction.json")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    figures = {}
    for name in arguments.sessions:
        figures[name] = judge(name, arguments.shared)
        print(f"\n{name}: median error, % (median over truth; negative)" + "".join(f"{joint:>20}" for joint in JOINTS))
        for label, row in figures[name].items():
            cells = zip(row["error_percent"], row["median_over_truth"], row["negative"], strict=True)
            print(f"{label:52}" + "".join(f"{f'{e:.0f} ({m:.2f}; {n})':>20}" for e, m, n in cells), flush=True)
    arguments.out.write_text(json.dumps({"data": "simulated", "joints": JOINTS, "sessions": figures}, indent=1) + "\n")


if __name__ == "__main__":
    main()
