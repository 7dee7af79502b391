"""MJX's part of the rollout benchmark, for a Python that has `mujoco-mjx`: prints one line of JSON."""

import json
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
from mujoco import mjx
from rollout_scene import FOREARM, OPEN, STEPS, mujoco_model, reference, start


def main(steps: int, repeats: int) -> None:
    """Scan the first `steps` steps of the lift; the best of some repeats."""
    model = mujoco_model()
    device = mjx.put_model(model)
    data = mjx.make_data(model).replace(qpos=jnp.asarray(start(model)))
    hand = FOREARM + len(OPEN)

    def step(data, slack):
        spring = device.qpos_spring.at[:hand].set(slack)
        return mjx.step(device.replace(qpos_spring=spring), data), data.qpos[-7:]

    targets = jnp.asarray(reference()[:steps], jnp.float32)
    run = jax.jit(lambda data, targets: jax.lax.scan(step, data, targets))
    begin = time.perf_counter()
    compiled = run.lower(data, targets).compile()
    compiling = time.perf_counter() - begin
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        _, box = jax.block_until_ready(compiled(data, targets))
        times.append(time.perf_counter() - begin)
    print(
        json.dumps(
            {
                "seconds a step": min(times) / steps,
                "compile s": compiling,
                "steps": steps,
                "box rises mm": 1e3 * float(np.asarray(box)[-1, 2] - np.asarray(box)[0, 2]),
                "device": jax.devices()[0].device_kind,
            }
        )
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else STEPS, 3)
