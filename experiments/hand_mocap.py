"""Markers of a whole hand through a human-sized hand model: 40 s of a hand that grasps a pillow.

    python experiments/hand_mocap.py --shared SHARED_DATA

Data: github.com/dfki-ric/hand_embodiment (BSD-3-Clause), model: MyoHand (Apache-2.0); a real recording, without truth
and without forces. Writes `results/hand_mocap.json` beside this script and, with `--picture`, a picture of some frames.
Figures: marker distance to the calibrated model (mm RMS, all markers that were seen), frames that diverge (not solved,
or a marker more than 30 mm off), largest step of a joint between frames, gaps, standard deviations, and the number of
frames a minute, solved again after everything is compiled.
"""

import argparse
import dataclasses
import json
import os
import time
import warnings
from pathlib import Path

import jax
import numpy as np

HERE = Path(__file__).resolve().parent
FAR = 0.030
"""m; a marker that far from the model means a wrong pose."""


def solve(shared: Path):
    """The session, its only recording, and the seconds of a second pass over the trial with nothing to compile."""
    from icjax.capture import calibrate_session, capture_trial, read_session

    os.environ["ICJAX_SHARED_DATA"] = str(shared.resolve())
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*dropped.*")  # the meshes, which are not there
        spec = read_session(HERE / "sessions" / "dfki_hand.toml")
    calibration = calibrate_session(spec)
    spec = dataclasses.replace(spec, model=calibration.model)
    recording = capture_trial(spec, spec.trials[0], calibration=calibration)
    started = time.perf_counter()
    capture_trial(spec, spec.trials[0], calibration=calibration)
    return calibration, recording, time.perf_counter() - started


def figures(calibration, recording, seconds: float) -> dict:
    """What the docstring lists."""
    residual = np.asarray(recording.marker_residual)
    hinges = slice(7, None)
    q = np.degrees(np.asarray(recording.q)[:, hinges])
    sd = np.degrees(np.sqrt(np.diagonal(np.asarray(recording.q_covariance), axis1=1, axis2=2)))[:, 6:]
    offset = np.degrees(np.asarray(recording.q_offset_sd))[6:]
    missing = np.isnan(residual)
    lengths = [i for i, unit in enumerate(calibration.units) if unit == "1"]
    return {
        "frames": len(q),
        "seconds_of_recording": round(float(recording.time[-1] - recording.time[0]), 2),
        "residual_mm_rms": round(1e3 * float(np.sqrt(np.nanmean(residual**2))), 2),
        "residual_mm_rms_uncalibrated": round(1e3 * calibration.residual_before, 2),
        "residual_mm_by_marker": {
            name: round(1e3 * float(np.sqrt(np.nanmean(residual[:, i] ** 2))), 2)
            for i, name in enumerate(recording.marker_names)
        },
        "frames_without_pose": int((~np.asarray(recording.valid)).sum()),
        "frames_with_a_marker_far_off": int((np.nan_to_num(residual).max(axis=1) > FAR).sum()),
        "residual_mm_largest": round(1e3 * float(np.nanmax(residual)), 1),
        "largest_step_deg": round(float(np.abs(np.diff(q, axis=0)).max()), 2),
        "marker_samples_missing": int(missing.sum()),
        "frames_with_a_gap": int(missing.any(axis=1).sum()),
        "scale": {
            calibration.names[i]: [round(float(calibration.value[i]), 3), round(float(calibration.sd[i]), 3)]
            for i in lengths
        },
        "joints": {
            name: {
                "range_deg": np.percentile(q[:, j], [1, 99]).round(0).tolist(),
                "sd_deg": round(float(np.median(sd[:, j])), 1),
                "offset_sd_deg": round(float(offset[j]), 1),
            }
            for j, name in enumerate(recording.model.joint_names[1:])
        },
        "frames_a_minute": round(60 * len(q) / seconds, -2),
    }


def picture(recording, path: Path, times: tuple[float, ...] = (1.0, 10.0, 20.0, 30.0)) -> None:
    """Lines of the skeleton, measured markers (rings) and their places on the model (dots), in the hand's own axes."""
    import matplotlib.pyplot as plt
    from jax import numpy as jnp

    from icjax.model import forward_kinematics, site_positions

    model = recording.model
    sites = [model.site(name) for name in recording.marker_names]
    figure, axes = plt.subplots(2, len(times), figsize=(3.2 * len(times), 6.4), squeeze=False)
    for column, moment in enumerate(times):
        frame = int(np.argmin(np.abs(np.asarray(recording.time) - moment)))
        q = jnp.asarray(recording.q[frame])
        poses, places = forward_kinematics(model, q), np.asarray(site_positions(model, q))[sites]
        R, p = np.asarray(poses.rotation[1]), np.asarray(poses.position[1])
        joints, places, seen = (
            1e3 * (np.asarray(x) - p) @ R for x in (poses.position, places, recording.markers[frame])
        )
        for row, (across, up, title) in enumerate(((0, 1, "from the back"), (1, 2, "from the side"))):
            ax = axes[row, column]
            for body, parent in enumerate(model.body_parents[2:], start=2):
                ax.plot(*joints[[parent, body]][:, [across, up]].T, color="0.4", lw=2, solid_capstyle="round")
            for site, place in zip(sites, places, strict=True):
                ax.plot(*np.stack([joints[model.site_bodies[site]], place])[:, [across, up]].T, color="0.8", lw=1)
            ax.plot(*places[:, [across, up]].T, ".", color="C0")
            ax.plot(*seen[:, [across, up]].T, "o", mfc="none", color="C1")
            ax.set(aspect="equal", title=f"{moment:g} s, {title}", xlabel="mm")
    figure.tight_layout()
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--shared", type=Path, required=True, help="folder that holds hand_mocap_dfki and myohand_model"
    )
    parser.add_argument("--out", type=Path, default=HERE / "results" / "hand_mocap.json")
    parser.add_argument("--picture", type=Path, help="PNG file")
    arguments = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    calibration, recording, seconds = solve(arguments.shared)
    found = {"data": "real, without truth", **figures(calibration, recording, seconds)}
    print(json.dumps(found, indent=1))
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(found, indent=1) + "\n")
    if arguments.picture:
        picture(recording, arguments.picture)


if __name__ == "__main__":
    main()
