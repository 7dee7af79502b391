"""How long a ten-minute session takes, and how much memory: 500 Hz, 40 markers, four six-axis sensors, 24 joints.

    python experiments/benchmarks/long_session.py [--minutes 10] [--folder DIR]

writes a made-up session (joint angles that swing, four fingers that press four plates, 0.2 mm of noise; no dynamics,
only the amount of data matters), runs `icjax capture` and `icjax estimate --all` on it as a user would, each in a
process of its own with two CPU cores, and writes the seconds and the largest resident memory of each to
experiments/results/long_session.json. The second run has a warm compilation cache; both are reported.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

from icjax.files import write_c3d
from icjax.model import Model, load_model, neutral, pad_positions, site_positions

RESULT = Path(__file__).resolve().parents[1] / "results" / "long_session.json"
FINGERS = ("index", "middle", "ring", "little")
LENGTHS = (0.045, 0.028, 0.022)
RATE, ANALOG_RATE, TRIAL_SECONDS = 500.0, 1000.0, 30.0
NOISE, FORCE_NOISE = 2e-4, 0.01


def hand() -> str:
    """Forearm on a free joint, wrist of two hinges, four fingers of four: 24 degrees of freedom, 40 sites, 4 pads."""
    inertial = '<inertial pos="0 0 0" mass="0.02" diaginertia="1e-5 1e-5 1e-5"/>'

    def sites(prefix, *places):
        return "".join(f'<site name="{prefix}{n}" pos="{x} {y} {z}"/>' for n, (x, y, z) in enumerate(places, 1))

    fingers = ""
    for number, name in enumerate(FINGERS):
        chain = f'<geom name="pad_{name}" class="pad" type="sphere" size="0.0075" pos="{LENGTHS[2] - 0.003} 0 -0.001"/>'
        for part in (2, 1, 0):
            length = LENGTHS[part]
            places = [(0.2 * length, 0.005, 0.012), (0.5 * length, -0.006, 0.016), (0.9 * length, 0.003, 0.011)]
            places = places if part < 2 else places[:2]
            hinges = f'<joint name="{name}_flex{part}" axis="0 1 0" range="-0.6 1.9" stiffness="1"/>'
            if part == 0:
                hinges = f'<joint name="{name}_spread" axis="0 0 1" range="-0.4 0.4" stiffness="2"/>' + hinges
            offset = f"0.09 {0.03 - 0.02 * number} 0" if part == 0 else f"{LENGTHS[part - 1]} 0 0"
            marks = sites(f"{name}{part}_", *places)
            chain = f'<body name="{name}{part}" pos="{offset}">{hinges}{inertial}{marks}{chain}</body>'
        fingers += chain
    back = sites(
        "HA", (0.02, 0, 0.018), (0.03, 0.035, 0.02), (0.07, 0.03, 0.019), (0.08, -0.01, 0.018), (0.05, -0.03, 0.02)
    )
    arm = sites("FA", (-0.16, -0.02, 0.035), (-0.1, 0.025, 0.038), (-0.05, -0.01, 0.036))
    wrist = '<joint name="wrist_flex" axis="0 1 0" stiffness="4"/><joint name="wrist_turn" axis="0 0 1" stiffness="4"/>'
    return (
        '<mujoco model="four_fingers"><compiler angle="radian"/><worldbody>'
        f'<body name="forearm"><freejoint name="root"/>{inertial}{arm}<body name="hand">{wrist}{inertial}{back}'
        f"{fingers}</body></body></worldbody>"
        '<default><default class="pad"><geom mass="0"/></default></default></mujoco>'
    )


def write_session(folder: Path, minutes: float) -> Path:
    """The files of the session. Returns its TOML file."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "hand.xml").write_text(hand())
    model = load_model(folder / "hand.xml")
    trials = max(1, round(60 * minutes / TRIAL_SECONDS))
    for number in range(trials):
        _write_trial(folder / f"trial{number:02d}.c3d", model, np.random.default_rng(number))
    text = ['name = "long"', "[model]", 'file = "hand.xml"', "[markers]"]
    text += [f'{site} = "{site}"' for site in model.site_names]
    for name in FINGERS:
        text += ["[[source]]", f'name = "plate_{name}"', 'kind = "six_axis"', 'sign = "on_subject"']
        text += [f"channels = {json.dumps(_channels(name))}", "position = [0, 0, 0]", "tare = [0.0, 0.2]"]
    touches = ", ".join(f'plate_{name} = "pad_{name}"' for name in FINGERS)
    for number in range(trials):
        text += ["[[trial]]", f'name = "trial{number:02d}"', f'file = "trial{number:02d}.c3d"']
        text += [f"touches = {{ {touches} }}", "friction = 0.8"]
    (folder / "session.toml").write_text("\n".join(text) + "\n")
    return folder / "session.toml"


def _channels(name: str) -> list[str]:
    return [f"{name}_{axis}" for axis in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")]


def _write_trial(path: Path, model: Model, random: np.random.Generator) -> None:
    time = np.arange(int(TRIAL_SECONDS * RATE)) / RATE
    q = np.tile(np.asarray(neutral(model)), (len(time), 1))
    hinges = [
        part.start for kind, part in zip(model.joint_types, model.coordinate_slices, strict=True) if kind == "hinge"
    ]
    for column in hinges:
        rate, phase = random.uniform(0.2, 1.2), random.uniform(0, 2 * np.pi)
        q[:, column] = 0.25 + 0.2 * np.sin(2 * np.pi * rate * time + phase)
    places = jax.jit(jax.vmap(lambda row: (site_positions(model, row), pad_positions(model, row))))
    markers, pads = (np.asarray(value) for value in places(q))
    markers = markers + NOISE * random.normal(size=markers.shape)
    markers[random.random(markers.shape[:2]) < 0.002] = np.nan
    fine = np.arange(int(TRIAL_SECONDS * ANALOG_RATE)) / ANALOG_RATE
    analog = FORCE_NOISE * random.normal(size=(len(fine), 6 * len(FINGERS)))
    for number in range(len(FINGERS)):
        press = np.clip(2.0 * np.sin(2 * np.pi * 0.5 * (fine - 0.5 - 0.1 * number)), 0, None) * (fine > 0.6)
        tip = np.stack([np.interp(fine, time, pads[:, number, axis]) for axis in range(3)], axis=1)
        force = np.stack([0.2 * press, 0.0 * press, press], axis=1)
        analog[:, 6 * number : 6 * number + 3] += force
        analog[:, 6 * number + 3 : 6 * number + 6] = 0.1 * analog[:, 6 * number + 3 : 6 * number + 6] + np.cross(
            tip, force
        )
    write_c3d(
        path,
        marker_names=model.site_names,
        markers=markers,
        marker_rate=RATE,
        analog_names=[channel for name in FINGERS for channel in _channels(name)],
        analog_units=(["N"] * 3 + ["Nm"] * 3) * len(FINGERS),
        analog=analog,
        analog_rate=ANALOG_RATE,
    )


def measured(arguments: list[str], cache: Path) -> dict:
    """Seconds of one verb on two cores; largest memory (GB, Linux) of its process and of the one that helps."""
    code = (
        "import os, sys; os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2]); "
        "from icjax.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    start = time.perf_counter()
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(cache)}
    with tempfile.TemporaryFile("w+") as told:
        process = subprocess.Popen([sys.executable, "-c", code, *arguments], stdout=told, stderr=told, env=environment)
        peaks = [0.0, 0.0]
        while process.poll() is None:
            children = _read(f"/proc/{process.pid}/task/{process.pid}/children").split()
            for which, pids in enumerate(([str(process.pid)], children)):
                peaks[which] = max([peaks[which], *map(_peak, pids)])
            time.sleep(0.2)
        told.seek(0)
        if process.returncode:
            sys.exit(f"{' '.join(arguments)} failed: {told.read()[-500:]}")
    seconds = round(time.perf_counter() - start, 1)
    return {"seconds": seconds, "peak_gb": round(peaks[0], 2), "peak_gb_second_process": round(peaks[1], 2)}


def _peak(pid: str) -> float:
    """GB; the kernel's own record of the largest resident memory of a running process, 0 where it has ended."""
    lines = [line for line in _read(f"/proc/{pid}/status").splitlines() if line.startswith("VmHWM")]
    return int(lines[0].split()[1]) / 2**20 if lines else 0.0


def _read(path: str) -> str:
    try:
        return Path(path).read_text()
    except OSError:
        return ""


def main() -> None:
    """Write, run twice, report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--folder", type=Path, default=None, help="keep the files here; default: a temporary folder")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        session = write_session(folder / "session", options.minutes)
        result: dict = {"minutes": options.minutes, "markers": 40, "sensors": 4, "dofs": 24, "marker_rate_hz": RATE}
        for run in ("cold", "warm"):
            out = folder / "out"
            capture = measured(["capture", str(session), "--out", str(out)], folder / "cache")
            estimate = measured(["estimate", str(out / "recording.nc"), "--all"], folder / "cache")
            total = round(capture["seconds"] + estimate["seconds"], 1)
            result[run] = {"capture": capture, "estimate": estimate, "seconds": total}
            print(run, json.dumps(result[run]))
    if options.minutes == 10.0:
        RESULT.write_text(json.dumps(result, indent=1) + "\n")
        print(f"wrote {RESULT}")


if __name__ == "__main__":
    main()
