"""The ankle's compliance at heel strike, by the paper's estimate, on every gait contact that the sessions hold.

    python experiments/gait_ankle.py --shared SHARED_DATA

Real recordings, without any truth. Each contact of a foot is estimated over windows of 30 to 200 ms and polynomials of
both degrees (`icjax.estimation.sensitivity`), whose rule says which contacts are stable and why the others are not.
Apart from it a contact is *unusable* where the person's heel or toe stands beside the plate in mid stance, or where the
movement begins less than 30 ms before it. Writes `results/gait_ankle.json` beside this script and prints a table
(mrad/Nm; a dash where the estimate gives none).

The axis: flexion of the ankle in the foot's axes (`*_ankle_y`, to the left; `*_ankle_z`, to the right), or OpenSim's
ankle coordinate. Compliance does not depend on the axis's direction, only on its line.
"""

import argparse
import json
import os
from pathlib import Path

import jax
import numpy as np

HERE = Path(__file__).resolve().parent
WINDOWS = (0.03, 0.05, 0.07, 0.1, 0.15, 0.2)
SESSIONS = {
    "opensim_walking2": ("{side}_ankle_y", ("CAL", "MT2")),
    "opensim_test_walking": ("{side}_ankle_y", ("CAL", "MT2")),
    "opensim_walk3d": ("{side}_ankle_z", None),
    "opensim_subject01": ("ankle_angle_{side}", None),
    "btk_pig_47kg": ("{side}_ankle_y", ("HEE", "TOE")),
    "btk_pig_66kg": ("{side}_ankle_y", ("HEE", "TOE")),
}
"""Name of the ankle's degree of freedom, and the heel and toe markers that show whether the foot is on the plate."""

MARGIN = 0.015
"""m; heel and toe markers may stand this far beside the plate: a marker's radius and the skin behind the heel."""


def against(recording, event: int, trial, spec, ends) -> str:
    """Why a contact cannot be used whatever the estimate says; empty if it can."""
    from icjax.capture import plate_frame
    from icjax.files import read_c3d

    onset, release = float(recording.events.onset[event]), float(recording.events.release[event])
    valid = recording.time[recording.valid]
    if not np.any((valid < onset) & (valid >= onset - WINDOWS[0])) or onset - valid[0] < WINDOWS[0]:
        return "the movement is not known before it"
    if ends is None:
        return ""
    contact = int(recording.events.contact[event])
    side = recording.contact_bodies[contact][0].upper()
    motion = read_c3d(trial.markers)
    plate = motion.plates[spec.source(recording.contact_names[contact]).plate - 1]
    rotation, position = plate_frame(plate)
    middle = np.argmin(np.abs(motion.marker_time - 0.5 * (onset + release)))
    feet = np.stack([motion.marker(side + end)[middle] for end in ends])
    half = np.abs((plate.corners - position) @ rotation).max(axis=0)
    outside = (np.abs((feet - position) @ rotation)[:, :2] - half[None, :2]).max(axis=1)
    worst = int(np.argmax(outside))
    beside = f"marker {side + ends[worst]} stands {1e3 * outside[worst]:.0f} mm beside the plate"
    return beside if outside[worst] > MARGIN else ""


def contacts(name: str) -> list[dict]:
    """Every contact of a session."""
    from icjax.capture import capture, read_session
    from icjax.estimation import EstimationOptions, sensitivity
    from icjax.interaction import STATUS

    spec = read_session(HERE / "sessions" / f"{name}.toml")
    label, ends = SESSIONS[name]
    joints = tuple(label.format(side=side) for side in "rl")
    rows = []
    for recording, trial in zip(capture(spec).recordings, spec.trials, strict=True):
        found = sensitivity((recording,), WINDOWS, (1, 2), EstimationOptions(joints=joints))
        for event, contact in enumerate(recording.events.contact):
            body = recording.contact_bodies[contact]
            side = body[-1] if body.startswith("calcn") else body[0]
            column = found.joint_names.index(label.format(side=side))
            reason = against(recording, event, trial, spec, ends)
            value = np.asarray(found.compliance)[event, column]
            rows.append(
                {
                    "session": name,
                    "trial": recording.name,
                    "side": side.upper(),
                    "rate_hz": round(recording.rate, 1),
                    "onset_s": round(float(recording.events.onset[event]), 4),
                    "usable": not reason,
                    "against": reason,
                    "compliance": _rounded(value),
                    "standard_error": _rounded(np.asarray(found.standard_error)[event, column]),
                    "status": [[STATUS[code] for code in row] for row in np.asarray(found.status)[event, column]],
                    "stable": bool(found.stable[event, column]),
                    "reason": found.reason[event][column],
                }
            )
    return rows


def _rounded(table: np.ndarray) -> list[list[float | None]]:
    return [[float(f"{value:.3g}") if np.isfinite(value) else None for value in row] for row in table]


def _cell(value: float | None) -> str:
    return f"{'-':>7}" if value is None else f"{1e3 * value:7.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path, required=True, help="folder that holds opensim_core_gait and btk_pig")
    parser.add_argument("--sessions", nargs="+", default=list(SESSIONS))
    parser.add_argument("--out", type=Path, default=HERE / "results" / "gait_ankle.json")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    os.environ["ICJAX_SHARED_DATA"] = str(arguments.shared.resolve())
    rows = []
    print("windows (ms)".ljust(52) + "".join(f"{1e3 * window:7.0f}" for window in WINDOWS))
    for name in arguments.sessions:
        for row in contacts(name):
            rows.append(row)
            head = f"{row['session']} {row['trial']} {row['side']} {row['onset_s']:.3f} s"
            for degree in range(2):
                cells = "".join(_cell(item[degree]) for item in row["compliance"])
                print(f"{head if degree == 0 else '':48}{('lin ', 'quad')[degree]}{cells}")
            verdict = "STABLE" if row["stable"] else "unstable"
            print(f"    {verdict}: {row['reason']}; {row['against'] or 'usable'}", flush=True)
    usable = [row for row in rows if row["usable"]]
    stable = sum(row["stable"] for row in usable)
    print(f"\n{len(rows)} contacts, {len(usable)} usable, {stable} of them stable")
    figures = {"unit": "rad/Nm", "windows_s": WINDOWS, "degrees": [1, 2], "contacts": rows}
    arguments.out.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
