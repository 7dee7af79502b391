"""Joint torques of OpenSim's gait subject by inverse dynamics, against OpenSim's own.

    python experiments/gait_torques.py --shared SHARED_DATA

Reference: std_subject01_InverseDynamics.sto, which OpenSim computed from the same joint angles, ground forces and
masses, over 0.6 to 1.4 s. Writes `results/gait_torques.json` beside this script and prints a table. Per cent:

- rms: RMS error over RMS reference; range: RMS error over the reference's largest less its smallest value.

Rows: `contact` is -J^T f without gravity and inertia; `6 Hz` is `net_joint_torque` at the cut-off that OpenSim's set-up
file states; `5.2 Hz` is the same at the cut-off at which OpenSim's filter really has the gain 1/sqrt 2 (its third-order
Butterworth filter is applied twice without correction, so that 6 Hz is its half amplitude: 6 (sqrt 2 - 1)^(1/6) =
5.18); `markers` is the 6 Hz row with joint angles that icjax solved from the markers.
"""

import argparse
import json
import os
from pathlib import Path

import jax
import numpy as np

HERE = Path(__file__).resolve().parent
SPAN = (0.6, 1.4)
JOINTS = ("ankle_angle", "subtalar_angle", "knee_angle", "hip_flexion", "hip_adduction", "hip_rotation")


def compared(recording, torque, reference) -> dict[str, dict[str, float]]:
    """NRMSE of every leg coordinate, per cent."""
    time = reference.analog_time
    inside = (time >= SPAN[0]) & (time <= SPAN[1])
    figures = {}
    for name in (f"{joint}_{side}" for joint in JOINTS for side in "rl"):
        ours = np.interp(time, recording.time, torque[:, recording.model.dof_names.index(name)])[inside]
        theirs = reference.channels((f"{name}_moment",))[inside, 0]
        error = np.sqrt(np.mean((ours - theirs) ** 2))
        figures[name] = {
            "rms": round(100 * float(error / np.sqrt(np.mean(theirs**2))), 2),
            "range": round(100 * float(error / np.ptp(theirs)), 2),
        }
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path, required=True, help="folder that holds opensim_core_gait")
    parser.add_argument("--out", type=Path, default=HERE / "results" / "gait_torques.json")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    os.environ["ICJAX_SHARED_DATA"] = str(arguments.shared.resolve())
    from icjax.capture import capture, read_session
    from icjax.estimation import joint_torque, net_joint_torque
    from icjax.files import read_sto

    reference = read_sto(arguments.shared / "opensim_core_gait" / "subject01" / "std_subject01_InverseDynamics.sto")
    walk, solved = (
        capture(read_session(HERE / "sessions" / f"{name}.toml")).recordings[0]
        for name in ("opensim_subject01", "opensim_subject01_markers")
    )
    rows = {
        "contact": compared(walk, -np.asarray(joint_torque(walk)), reference),
        "6 Hz": compared(walk, net_joint_torque(walk, 6.0), reference),
        "5.2 Hz": compared(walk, net_joint_torque(walk, 5.18), reference),
        "markers": compared(solved, net_joint_torque(solved, 6.0), reference),
    }
    arguments.out.write_text(json.dumps({"span_s": SPAN, "nrmse_percent": rows}, indent=1) + "\n")
    print(f"{'rms / range, %':18}" + "".join(f"{name:>16}" for name in rows))
    for joint in rows["6 Hz"]:
        cells = (f"{row[joint]['rms']:.1f} / {row[joint]['range']:.1f}" for row in rows.values())
        print(f"{joint:18}" + "".join(f"{cell:>16}" for cell in cells))


if __name__ == "__main__":
    main()
