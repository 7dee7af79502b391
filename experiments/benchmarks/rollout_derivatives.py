"""Derivatives of a grasp's rollout against central differences: forces, object and joint angles after 1, 10, 100 steps.

    python experiments/benchmarks/rollout_derivatives.py

The lift of `rollout_scene.py` (five fingers, a box on a table) is entered at several moments: before the
first touch, while the fingers close, at rest in the grip, while it is lifted, and held. From there the derivative with
respect to all compliances together, one compliance, the whole reference, friction, mass and size of the box is taken in
forward mode and compared with a central difference. A comparison counts where all slip states of the two perturbed
rollouts agree in every step (elsewhere the difference crosses a change of contact state); how many do is printed. The
error is relative to the largest derivative of each output. Every derivative must be finite. Writes
results/rollout_derivatives.json.
"""

import dataclasses
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import rollout_scene as lift

from icjax.geometry import Box, Plane
from icjax.model import load_model
from icjax.spatial import Pose
from icjax.synthesis import Object, Scene, State, Surface, Target, rollout

RESULT = Path(__file__).resolve().parents[1] / "results" / "rollout_derivatives.json"

MOMENTS = {"before touch": 40, "closing": 110, "gripped": 160, "lifting": 250, "held": 380}
"""Steps of 2 ms after the start."""

HORIZONS = (1, 10, 100)
PARAMETERS = ("compliance", "one compliance", "reference", "friction", "mass", "size")
OUTPUTS = ("forces N", "object m", "angles rad")
EPSILON = 3e-5
"""Relative step of the differences; the reference is shifted by as many rad.

A box on four corners shares its weight among them in more ways than one, and with the way that is met forces scatter by
1e-10 N: with steps of 1e-6 that is 4e-5 of a derivative.
"""


def setting():
    """A function of six numbers, a state and a reference: outputs at the end, and every slip state."""
    model = dataclasses.replace(load_model(lift.MODEL), pad_compliance=np.full(5, 1 / 750))
    table = Surface("table", Plane(np.zeros(3), np.array([0.0, 0.0, 1.0])), lift.TABLE_FRICTION)
    direction = np.random.default_rng(3).normal(size=len(lift.COMPLIANCE))

    def advance(x, state: State | None, reference):
        half = np.array(lift.HALF_SIZES) * (1.0 + x[5])
        pose = Pose(np.eye(3), np.array([0.0, 0.0, lift.HALF_SIZES[2]]))
        box = Object("box", Box(half), lift.FRICTION * (1.0 + x[3]), mass=lift.MASS * (1.0 + x[4]), pose=pose)
        scene = Scene("lift", (table,), facets=4, step=lift.STEP, objects=(box,), contacts=10)
        compliance = jnp.array(lift.COMPLIANCE) * (1.0 + x[0])
        compliance = compliance.at[5].mul(1.0 + x[1])
        compliance = jnp.concatenate([jnp.zeros(lift.FOREARM), compliance])
        shifted = reference + x[2] * jnp.concatenate([jnp.zeros(lift.FOREARM), direction])[None]
        targets = Target(shifted, jnp.broadcast_to(compliance, reference.shape))
        state, info = rollout(model, scene, targets, state)
        forces = jnp.sum(info.contact_force[-1, ::2][:5], axis=0), info.contact_force[-1, :10].reshape(-1)
        pose = jnp.concatenate([info.object_position[-1, 0], info.object_quaternion[-1, 0]])
        return (jnp.concatenate(forces), pose, info.q[-1, lift.FOREARM :]), (info.slip_state, state)

    return advance


def comparison(advance, state: State, targets):
    """Derivative, central difference, and whether all slip states agree, a row for each parameter."""

    def value(x):
        return advance(x, state, targets)

    def along(direction):
        _, exact, _ = jax.jvp(value, (jnp.zeros_like(direction),), (direction,), has_aux=True)
        up, (slip_up, _) = value(EPSILON * direction)
        down, (slip_down, _) = value(-EPSILON * direction)
        difference = jax.tree.map(lambda high, low: (high - low) / (2 * EPSILON), up, down)
        return exact, difference, jnp.all(slip_up == slip_down)

    return jax.lax.map(along, jnp.eye(len(PARAMETERS)))


def main() -> None:
    """Compare, print, write."""
    jax.config.update("jax_enable_x64", True)
    advance, reference = setting(), jnp.asarray(lift.reference())
    zero = jnp.zeros(len(PARAMETERS))
    found: dict = {"epsilon": EPSILON, "rows": []}
    states, state, done = {}, None, 0
    enter = jax.jit(advance)
    for name, at in MOMENTS.items():
        _, (_, state) = enter(zero, state, reference[done:at])
        states[name], done = state, at
    compare = jax.jit(lambda state, targets: comparison(advance, state, targets))
    for horizon in HORIZONS:
        for name, at in MOMENTS.items():
            exact, difference, same = compare(states[name], reference[at : at + horizon])
            for number, parameter in enumerate(PARAMETERS):
                row = {"moment": name, "steps": horizon, "parameter": parameter, "same states": bool(same[number])}
                for output, a, b in zip(OUTPUTS, exact, difference, strict=True):
                    a, b = np.asarray(a[number]), np.asarray(b[number])
                    assert np.isfinite(a).all(), (name, horizon, parameter)
                    row[output] = float(f"{np.max(np.abs(a - b)) / max(np.max(np.abs(a)), 1.0):.2g}")
                found["rows"].append(row)
    told(found)
    RESULT.write_text(json.dumps(found, indent=1) + "\n")


def told(found: dict) -> None:
    """How many comparisons count, and the worst of them."""
    for horizon in HORIZONS:
        rows = [row for row in found["rows"] if row["steps"] == horizon]
        counted = [row for row in rows if row["same states"]]
        worst = {output: max((row[output] for row in counted), default=0.0) for output in OUTPUTS}
        found[f"{horizon} steps"] = {"compared": len(counted), "of": len(rows), "largest error": worst}
        print(f"{horizon:4d} steps: {len(counted)} of {len(rows)} share their contact states; largest error {worst}")
        for row in counted:
            if max(row[output] for output in OUTPUTS) > 1e-5:
                print("     ", row)


if __name__ == "__main__":
    main()
