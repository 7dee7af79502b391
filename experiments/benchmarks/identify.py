"""Four joint stiffnesses from a slow press: icjax beside `mujoco.sysid`, with the same data and weights.

    uv venv sysid && uv pip install --python sysid "mujoco[sysid]"
    uv run --all-extras python experiments/benchmarks/identify.py --sysid sysid/bin/python

The finger, the press and the data are those of `identify_scene.py`: angles and contact force of a damped simulation by
MuJoCo C in steps of 0.2 ms, with noise; neither side knows its damping. Data are equal, and so are the whitened
residuals that are minimised, but for those of "measured".

- equilibrium: icjax's forces and angles against MuJoCo's, moved twenty times more slowly;
- measured: icjax puts the measured force into theta = theta_r + C tau at the measured angles, sample by sample, and
  compares the angles (`icjax.fit.StaticEquilibrium`): what was measured need not be simulated;
- static: icjax takes every sample by itself, from the measured angles in `SETTLING` contact problems at its reference
  (a frictionless equilibrium has no memory); Levenberg-Marquardt of `icjax.inference` with the exact Jacobian;
- both: static, each start first moved to where `measured` ends;
- solve: static through `icjax.fit.solve`;
- rollout: the press as one rollout of two contact problems a sample, which is what friction would need;
- sysid: `mujoco.sysid.optimize` by logarithms of the stiffnesses with its parallel differences, the fastest of its
  optimisers here, and with its defaults; steps, armature and damping are chosen for it;
- gradient: reverse mode through the rollout against central differences, by 4 to 400 numbers of the reference.

A start has succeeded if it ends within 1 % of the best fit in every stiffness; the time is that until it first stays
there. Every part is a process of its own. Written to experiments/results/identify.json and .png; `--part` does one.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import identify_gradient
import identify_scene as press
import numpy as np
from identify_problem import finger, predictions, problem
from identify_runs import CLOSE, near, reached, told

RESULT = Path(__file__).resolve().parents[1] / "results" / "identify.json"
PARTS = ("equilibrium", "measured", "both", "static", "solve", "rollout", "sysid", "gradient")
STARTS, FACTOR, WIDEST = 100, 5.0, 10.0
STEPWISE = 10
"""Starts of icjax whose time to 1 % is measured, a run for every number of steps."""

TOLERANCE = 1e-4
MUJOCO = {"step": 2e-3, "damping": 0.004, "armature": 2e-5}
"""s, Nms/rad, kg m2: a round step that is stable at ten times the stiffness, little lag and artificial inertia."""

OPTIMISERS = {
    "logarithms, scipy_parallel_fd": (True, {"optimizer": "scipy_parallel_fd"}, STARTS),
    "defaults": (False, {"optimizer": "mujoco"}, 10),
}


def starts(nominal: np.ndarray) -> np.ndarray:
    """Log-uniform within a factor of five."""
    wide = np.log(FACTOR)
    return nominal * np.exp(np.random.default_rng(0).uniform(-wide, wide, (STARTS, 4)))


def equilibrium() -> dict:
    """Largest differences at MuJoCo's true stiffnesses, N and rad, and of MuJoCo's own model, in deviations."""
    import jax

    model, scene, _, mjcf = finger()
    slow = press.simulate(mjcf, press.TRUE_STEP, press.TRUE_DAMPING * press.STIFFNESS, press.TRUE_ARMATURE, held=20)
    reference = press.reference(press.sample_times())
    rows = {"largest force N": float(slow[:, 4].max()), "samples in contact": int(np.sum(slow[:, 4] > 0))}
    for name, function in zip(("static", "rollout"), predictions(model, scene, 2), strict=True):
        found = np.asarray(jax.jit(function)(press.STIFFNESS, reference, press.measured(mjcf)[:, :4]))
        rows[name] = compared(found, slow)
    own = press.simulate(mjcf, held=20, **MUJOCO)
    rows["MuJoCo in steps of sysid, slowly"] = compared(own, slow)
    rows["MuJoCo in steps of sysid"] = compared(press.simulate(mjcf, **MUJOCO), slow)
    return rows


def compared(found, true) -> dict:
    """Largest differences, and the root mean square in deviations of the noise."""
    error = found - true
    return {
        "force N": float(np.abs(error[:, 4]).max()),
        "angle rad": float(np.abs(error[:, :4]).max()),
        "rms in deviations": float(np.sqrt(np.mean((error / press.deviations()) ** 2))),
    }


def measured() -> dict:
    """With the measured forces, from every start."""
    return fitted("measured", STARTS)


def static() -> dict:
    """Sample by sample, from every start."""
    return fitted("static", STARTS)


def both() -> dict:
    """The residuals of `static`, each start first moved by `measured`."""
    return fitted("static", STARTS, first="measured")


def rollout() -> dict:
    """One rollout, from some starts."""
    return fitted("rollout", 10)


def fitted(kind: str, count: int, first: str = "") -> dict:
    """`icjax.inference.least_squares`; time of the shortest run that ends within 1 % of where the longest ends.

    With `first` the fit of that kind goes before it, and its time counts.
    """
    import equinox as eqx
    import jax
    import jax.numpy as jnp

    from icjax.inference import least_squares

    stated, nominal = problem(kind)
    before = problem(first)[0] if first else None

    @eqx.filter_jit
    def fit(stated, start, steps):
        nothing = jnp.zeros(1)
        found = least_squares(
            lambda x, _: stated.residual(x), start[None], nothing, nv=4, tolerance=TOLERANCE, max_steps=steps
        )
        return jnp.exp(found.value.value[0]), found.value.cost[0] / 2, found.stats["steps"]

    def timed(start, steps):
        begin, work = time.perf_counter(), time.process_time()
        if before is not None:
            start = fit(before, jnp.log(start), jnp.asarray(40))[0]
        found = jax.block_until_ready(fit(stated, jnp.log(start), jnp.asarray(steps)))
        return np.asarray(found[0]), found, time.perf_counter() - begin, time.process_time() - work

    _, _, cold, _ = timed(nominal, 40)
    ends, runs = [], []
    for start in starts(nominal)[:count]:
        ends.append((start, *timed(start, 40)))
    costs = [float(end[2][1]) for end in ends]
    best = ends[int(np.nanargmin(costs))][1]
    for start, value, found, wall, work in ends:
        row = {"value": value.tolist(), "cost": float(found[1]), "whole s": wall, "whole CPU s": work}
        row["whole evaluations"] = int(found[2]) + 1
        measured = near(value, best) and len(runs) < STEPWISE
        for steps in range(0 if first else 1, int(found[2]) + 1) if measured else ():
            value, _, wall, work = timed(start, steps)
            if near(value, best):
                runs.append({**row, "s": wall, "CPU s": work, "evaluations": steps + 1})
                break
        else:
            runs.append(row)
    return {"first call, with compilation, s": cold, **told(runs, best), "rollouts an evaluation": "1 and 4 tangents"}


def solve() -> dict:
    """`icjax.fit.solve`: the first call, and later ones until the cost is within 1 % of the optimum."""
    import jax.numpy as jnp

    from icjax.fit import solve as minimise

    stated, nominal = problem("static")
    begin = time.perf_counter()
    minimise(stated, tolerance=TOLERANCE)
    rows: dict = {"first call, with compilation, s": time.perf_counter() - begin}
    times, whole, steps = [], [], []
    for start in starts(nominal)[:20]:
        heard: list = []
        begin = time.perf_counter()
        found = minimise(stated, jnp.log(start), tolerance=TOLERANCE, progress=heard.append)
        whole.append(time.perf_counter() - begin)
        close = [step.cost < (1 + CLOSE) * float(found.value.cost) for step in heard]
        times.append(heard[close.index(True)].seconds)
        steps.append(close.index(True) + 1)
    rows |= {"to 1 % of the cost s, median": float(np.median(times)), "whole s, median": float(np.median(whole))}
    return rows | {"steps to 1 % of the cost, median": float(np.median(steps))}


def sysid(python: Path) -> dict:
    """Two optimisers of the toolbox, in its environment."""
    *_, nominal, mjcf = finger()
    rows = {}
    for name, (logarithm, options, count) in OPTIMISERS.items():
        stated = {"mjcf": mjcf, "data": press.measured(mjcf).tolist(), "nominal": nominal.tolist(), "widest": WIDEST}
        stated |= {**MUJOCO, "logarithm": logarithm, "options": options, "threads": os.cpu_count()}
        stated["starts"] = starts(nominal)[:count].tolist()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "problem.json"
            path.write_text(json.dumps(stated))
            command = [str(python.absolute()), str(Path(__file__).with_name("identify_sysid.py")), str(path)]
            answer = subprocess.run(command, capture_output=True, text=True, check=True)
        found = json.loads(answer.stdout.splitlines()[-1])
        rows["version"] = found["version"]
        tried = [row for run in found["runs"] for row in run["rows"] if np.isfinite(row[2])]
        best = min(tried, key=lambda row: row[2])[3]
        rows[name] = told([reached(run, best) for run in found["runs"]], best)
    return rows


def gradient() -> dict:
    """`identify_gradient.gradient` of one contact problem a sample."""
    model, scene, nominal, mjcf = finger()
    return identify_gradient.gradient(predictions(model, scene, 1)[1], nominal, press.measured(mjcf))


def rounded(value):
    """To four digits."""
    if isinstance(value, dict):
        return {name: rounded(item) for name, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", choices=PARTS, help="measure one part and write it among the others")
    parser.add_argument("--sysid", type=Path, help="Python of an environment with mujoco[sysid]")
    arguments = parser.parse_args()
    if arguments.part is None:
        for part in PARTS:
            if part != "sysid" or arguments.sysid:
                extra = ["--sysid", str(arguments.sysid)] if part == "sysid" else []
                subprocess.run([sys.executable, __file__, "--part", part, *extra], check=True)
        return
    found = sysid(arguments.sysid) if arguments.part == "sysid" else globals()[arguments.part]()
    rows = json.loads(RESULT.read_text()) if RESULT.exists() else {}
    rows[arguments.part] = {**rounded(found), "load": rounded(os.getloadavg()[0])}
    print(arguments.part, json.dumps(rows[arguments.part]), flush=True)
    RESULT.write_text(json.dumps({name: rows[name] for name in PARTS if name in rows}, indent=1) + "\n")
    if "gradient" in rows:
        identify_gradient.drawn(rows["gradient"], RESULT.with_suffix(".png"))


if __name__ == "__main__":
    main()
