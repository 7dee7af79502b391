"""What the facets of the friction cone do to sliding and to the onset of slip, against the circular cone.

    uv run --extra viz python experiments/facets.py

One contact pressed with f_n = 1 at mu = 0.5, pulled along 180 directions. Sliding: angle between the friction force and
the slip. Onset: the pull at which the contact stops sticking over mu f_n, by bisection of slip states. Solved by
Lemke's method with m = 2 to 16 pairs of tangents, and by `InteriorPoint` on the circular cone.
Written to experiments/results/facets.json and docs/facets.png.
"""

import json
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from icjax.contact import STICKING, ContactProblem, InteriorPoint, solve
from icjax.lcp import Lemke

FOLDER = Path(__file__).resolve().parents[1]
PAIRS = (2, 3, 4, 6, 8, 12, 16)
FRICTION = 0.5


def answered(facets: int | None, angle, pull):
    """Force of a contact with W = 1, normal z, pressed by 1 and pulled along an angle."""
    problem = ContactProblem(
        jnp.eye(3),
        jnp.stack([pull * jnp.cos(angle), pull * jnp.sin(angle), -jnp.ones_like(pull)]),
        jnp.zeros(1),
        jnp.asarray(np.eye(3)[None][:, :, [2, 0, 1]]),
        jnp.array([FRICTION]),
        jnp.array([True]),
    )
    solver = Lemke() if facets else InteriorPoint(1e-10)
    found = solve(problem, facets=facets, solver=solver).value
    return found.force[0], found.displacement[0], found.slip_state[0]


@partial(jax.jit, static_argnums=0)
def measured(facets: int | None, angles):
    """Angle between friction and slip, and the largest sticking pull over mu f_n."""

    def one(angle):
        force, moved, _ = answered(facets, angle, jnp.array(3.0))
        against = -force[:2]
        cross, along = moved[0] * against[1] - moved[1] * against[0], moved[:2] @ against
        low, high = jnp.array(0.1), jnp.array(1.0)
        for _ in range(20):
            middle = (low + high) / 2
            sticks = answered(facets, angle, middle)[2] == STICKING
            low, high = jnp.where(sticks, middle, low), jnp.where(sticks, high, middle)
        return jnp.arctan2(cross, along), low / FRICTION

    return jax.lax.map(one, angles)


def main() -> None:
    """Measure, print, draw."""
    jax.config.update("jax_enable_x64", True)
    angles = jnp.asarray(np.linspace(0.0, np.pi, 181)[:-1] + 1e-3)
    rows, curves = [], {}
    for facets in (*PAIRS, None):
        error, onset = (np.asarray(x) for x in measured(facets, angles))
        curves[facets] = np.rad2deg(error), onset
        row = {
            "pairs": facets or "circle",
            "largest direction error, deg": round(float(np.max(np.abs(np.rad2deg(error)))), 3),
        }
        row |= {"expected, deg": round(90.0 / facets, 3) if facets else 0.0}
        row |= {"least onset": round(float(onset.min()), 4)}
        row |= {"expected onset": round(float(np.cos(np.pi / (2 * facets))), 4) if facets else 1.0}
        rows.append(row)
        print(row)
    (FOLDER / "experiments" / "results" / "facets.json").write_text(json.dumps(rows, indent=1) + "\n")
    draw(np.rad2deg(np.asarray(angles)), curves)


def draw(angles, curves) -> None:
    """Both figures over the direction of the pull."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    for facets, (error, onset) in curves.items():
        if facets in (2, 4, 8, 16, None):
            style = {"color": "black", "linewidth": 2} if facets is None else {}
            label = "circle" if facets is None else f"m = {facets}"
            left.plot(angles, error, label=label, **style)
            right.plot(angles, onset, label=label, **style)
    left.set(xlabel="direction of pull, deg", ylabel="friction off the slip, deg")
    right.set(xlabel="direction of pull, deg", ylabel="onset of slip over mu f_n")
    right.legend(loc="lower right", fontsize=8)
    figure.savefig(FOLDER / "docs" / "facets.png", dpi=110)


if __name__ == "__main__":
    main()
