"""The part of `mujoco.sysid` in the identification benchmark, for a Python that has `mujoco[sysid]`.

    python identify_sysid.py PROBLEM.json

The problem holds the model, the data, MuJoCo's step, damping and armature, the bounds, the starts and the options of
`mujoco.sysid.optimize`. Prints one line of JSON: of every start the candidates that the optimiser tried, with their
cost, wall and processor time since its start and the rollouts so far.
"""

import json
import sys
import time

import identify_scene as scene
import mujoco as mj
import numpy as np
from mujoco import sysid


class Told:
    """The toolbox's residual function, with a record of what was asked."""

    def __init__(self, residual):
        self.residual, self.rows, self.rollouts = residual, [], 0
        self.begin, self.work = time.perf_counter(), time.process_time()

    def __call__(self, x, params):
        columns = 1 if x.ndim == 1 else x.shape[1]
        found = self.residual(x, params)
        self.rollouts += columns
        if columns == 1:
            cost = 0.5 * float(np.sum(np.concatenate(found[0]) ** 2))
            value = np.ravel(x).tolist()
            spent = time.perf_counter() - self.begin, time.process_time() - self.work
            self.rows.append([spent[0], self.rollouts, cost, value, spent[1]])
        return found


def parameters(problem: dict, logarithm: bool):
    """Four gains between their bounds, or their logarithms."""
    found = sysid.ParameterDict()
    for name, nominal in zip(scene.JOINTS, problem["nominal"], strict=True):

        def modifier(spec, parameter, name=name):
            value = float(parameter.value[0])
            sysid.apply_pgain(spec, name, float(np.exp(value)) if logarithm else value)

        of = np.log if logarithm else float
        low, high = of(nominal / problem["widest"]), of(nominal * problem["widest"])
        found.add(sysid.Parameter(name, of(nominal), low, high, modifier=modifier))
    return found


def sequences(problem: dict):
    """The measured press as the toolbox wants it."""
    spec = scene.mujoco_spec(problem["mjcf"], problem["step"], problem["damping"], problem["armature"])
    model = spec.compile()
    count = round(scene.DURATION / problem["step"])
    times = problem["step"] * np.arange(count + 1)
    control = sysid.TimeSeries(times, scene.reference(times + problem["step"]))
    sensors = sysid.TimeSeries.from_names(scene.sample_times(), np.array(problem["data"]), model)
    return sysid.ModelSequences("finger", spec, "press", scene.start(model), control, sensors)


def whitened(problem: dict):
    """Measured minus predicted at the samples' times, over the noise: what the other side minimises, too."""
    every = round(scene.DURATION / scene.SAMPLES / problem["step"])
    deviations = scene.deviations()

    def residual(params, predicted, measured, model, return_pred_all, state=None, sensor_weights=None):
        # Row i is the state before step i.
        data = np.concatenate([predicted.data, predicted.data[-1:]])[every::every][: scene.SAMPLES]
        return (measured.data - data) / deviations, predicted, measured

    return residual


def main(problem: dict) -> dict:
    """From every start with the options of the problem."""
    logarithm, options = problem["logarithm"], dict(problem["options"])
    if options.get("x_scale") is None:
        options.pop("x_scale", None)
    residual = sysid.build_residual_fn(
        models_sequences=[sequences(problem)], modify_residual=whitened(problem), n_threads=problem["threads"]
    )
    found = []
    for start in problem["starts"]:
        params, told = parameters(problem, logarithm), Told(residual)
        params.update_from_vector(np.log(start) if logarithm else np.array(start))
        try:
            sysid.optimize(params, told, verbose=False, **options)
        except Exception as error:
            found.append({"error": f"{type(error).__name__}: {error}", "rows": told.rows, "CPU": told.rows[-1][4]})
            continue
        seconds, work = time.perf_counter() - told.begin, time.process_time() - told.work
        rows = [[*row[:3], np.exp(row[3]).tolist() if logarithm else row[3], row[4]] for row in told.rows]
        found.append({"rows": rows, "seconds": seconds, "CPU": work, "rollouts": told.rollouts})
    return {"version": mj.__version__, "runs": found}


if __name__ == "__main__":
    with open(sys.argv[1]) as file:
        print(json.dumps(main(json.load(file))))
