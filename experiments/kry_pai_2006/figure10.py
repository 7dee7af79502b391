"""Figure 10 of Kry and Pai (2006): the effective end-point compliance of several contacts is coupled by shared joints.

    python experiments/kry_pai_2006/figure10.py

The shipped hand (`human_hand`: 22 hinges, wrist, arm) in the posture of a grasp. G = J C J^T of the five fingertips
(Eq. 5) is taken three times: with all joints, with the arm driven (its compliance zero) and with arm and wrist driven.
A joint is shared if it moves more than one fingertip; it alone makes the blocks off the diagonal.

The check shares neither Jacobian nor G. The equilibrium under forces f on the tips is a minimum of the potential
energy d^T C^-1 d / 2 - sum f_i . p_i(theta_r + d), found by Newton's method with derivatives that JAX takes of the
positions of the tips. G says how the tips move to first order: a small force on one tip, the displacements of all.
With a preload, that of a grip, G is taken in the loaded posture; it leaves out that J changes with the posture (as
the paper does), and the check says how much that is.

No data are used. The pads' own compliance (1/750 m/N) is not in G. Writes figure10.png and figure10.json.
"""

import dataclasses
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import tyro
from figure10_drawing import block_norms, drawn
from virtual_sessions import RESULTS, write

from icjax.estimation import endpoint_compliance
from icjax.model import Model, human_hand, integrate, pad_positions
from icjax.view import save

POSTURE = {
    "wrist_flexion": -20.0,
    "thumb_CM_flexion": 10.0,
    "thumb_CM_abduction": -8.0,
    "thumb_MP": 20.0,
    "thumb_IP": 25.0,
    "MP": 40.0,
    "PIP": 45.0,
    "DIP": 25.0,
}
"""Degrees; the last three are the fingers'. About what closes on a box of 6 cm."""

DIGITS = ("index", "middle", "ring", "little")


@dataclasses.dataclass(frozen=True)
class Config:
    """`force` (N) is the small one of the check; `grip` (N) the thumb's preload, shared by the others."""

    force: float = 1e-3
    grip: float = 1.0
    out: Path = RESULTS


def posture(model: Model) -> np.ndarray:
    """Coordinates of the grasp."""
    q = np.asarray(model.rest).copy()
    for name, angle in POSTURE.items():
        for joint in [f"{digit}_{name}" for digit in DIGITS] if name in ("MP", "PIP", "DIP") else [name]:
            q[model.coordinate_slices[model.joint(joint)]] = np.radians(angle)
    return q


def kinds(model: Model) -> dict[str, np.ndarray]:
    """Degrees of freedom by what they move: all fingertips through arm or wrist, or one."""
    moved = model.path_mask[np.asarray(model.pad_bodies)].sum(axis=0)
    arm = np.array([name.startswith("root") for name in model.dof_names])
    return {"own": moved == 1, "wrist": (moved > 1) & ~arm, "arm": (moved > 1) & arm}


def coupled(model: Model, q: np.ndarray, compliance: np.ndarray) -> np.ndarray:
    """G by fingertips `[tip, 3, tip, 3]`, m/N."""
    count = len(model.pad_names)
    points = pad_positions(model, jnp.asarray(q))
    return np.asarray(endpoint_compliance(model, q, model.pad_bodies, points, compliance)).reshape(count, 3, count, 3)


@eqx.filter_jit
def energy(d: jax.Array, model: Model, q: jax.Array, force: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Of springs and dead loads at the displacement d: value, gradient and Hessian."""

    def potential(d):
        tips = pad_positions(model, integrate(model, q, d))
        return 0.5 * jnp.sum(d**2 / model.compliance) - jnp.sum(force * tips)

    return potential(d), jax.grad(potential)(d), jax.hessian(potential)(d)


def equilibrium(model: Model, q: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Displacement of the degrees of freedom under forces `[tip, 3]` on the tips, to rounding.

    **Errors**: `RuntimeError` where Newton's method does not settle.
    """
    d, here = np.zeros(model.nv), (model, jnp.asarray(q), jnp.asarray(force))
    for _ in range(50):
        _, slope, curvature = (np.asarray(part) for part in energy(jnp.asarray(d), *here))
        step = np.linalg.solve(curvature, -slope)
        d = d + step * min(1.0, 0.5 / np.abs(step).max()) if np.abs(step).max() > 0 else d
        if np.abs(step).max() < 1e-13:
            return d
    raise RuntimeError(f"no equilibrium under {force.tolist()} N after 50 steps of Newton's method")


def tips_under(model: Model, q: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Where the tips are in equilibrium `[tip, 3]`, m."""
    return np.asarray(pad_positions(model, integrate(model, jnp.asarray(q), equilibrium(model, q, force))))


def grip_on(tips: np.ndarray, size: float) -> np.ndarray:
    """Forces of a thing on thumb and fingers, apart from each other: `size` on the thumb, a quarter on every finger."""
    across = tips[1:].mean(axis=0) - tips[0]
    across /= np.linalg.norm(across)
    return size * np.array([-1.0, 0.25, 0.25, 0.25, 0.25])[:, None] * across


def differences(model: Model, q: np.ndarray, preload: np.ndarray, size: float) -> np.ndarray:
    """G by central differences of equilibria about the one under `preload`, `[tip, 3, tip, 3]`."""
    found = np.empty((len(preload), 3, len(preload), 3))
    for tip, axis in np.ndindex(len(preload), 3):
        change = np.zeros_like(preload)
        change[tip, axis] = size
        ahead, back = (tips_under(model, q, preload + sign * change) for sign in (1.0, -1.0))
        found[:, :, tip, axis] = (ahead - back) / (2.0 * size)
    return found


def parted(found: np.ndarray, G: np.ndarray) -> dict[str, float]:
    """Error of G against differences, blocks of the tips themselves and of the others: relative, Frobenius norm."""
    same = np.eye(len(G), dtype=bool)
    error, size = (found - G).transpose(0, 2, 1, 3), found.transpose(0, 2, 1, 3)
    return {
        "own blocks": float(np.linalg.norm(error[same]) / np.linalg.norm(size[same])),
        "blocks of other tips": float(np.linalg.norm(error[~same]) / np.linalg.norm(size[~same])),
    }


def orders(model: Model, q: np.ndarray, G: np.ndarray) -> dict[str, float]:
    """Relative error of G f for the other tips under a force on the index finger, by its size: falls as the force."""
    tip, direction = model.pad("index"), np.array([-0.48, 0.36, 0.8])
    others = np.arange(len(model.pad_names)) != tip
    start, found = np.asarray(pad_positions(model, jnp.asarray(q))), {}
    for size in (1.0, 0.1, 0.01, 0.001):
        force = np.zeros((len(others), 3))
        force[tip] = size * direction
        moved = (tips_under(model, q, force) - start)[others]
        linear = (G[:, :, tip] @ force[tip])[others]
        found[f"{size:g} N"] = float(np.linalg.norm(linear - moved) / np.linalg.norm(moved))
    return found


def main(config: Config) -> dict[str, Any]:
    """Matrices, shares, checks, picture."""
    jax.config.update("jax_enable_x64", True)
    model = human_hand()
    q, C, kind = posture(model), np.asarray(model.compliance), kinds(model)
    matrices = {
        "all joints": coupled(model, q, C),
        "arm driven": coupled(model, q, np.where(kind["arm"], 0.0, C)),
        "arm and wrist driven": coupled(model, q, np.where(kind["own"], C, 0.0)),
    }
    G = matrices["all joints"]
    parts = {name: coupled(model, q, np.where(chosen, C, 0.0)) for name, chosen in kind.items()}
    share = {name: np.einsum("iaia->i", part) / np.einsum("iaia->i", G) for name, part in parts.items()}
    tips = np.asarray(pad_positions(model, jnp.asarray(q)))
    none = np.zeros_like(tips)
    preload = grip_on(tips, config.grip)
    loaded = np.asarray(integrate(model, jnp.asarray(q), equilibrium(model, q, preload)))
    pulled = pull(model, tips)
    moved = tips_under(model, q, pulled) - tips
    result: dict[str, Any] = {
        "figure": "Kry and Pai 2006, Figure 10 and Eq. 5",
        "data": "none: the shipped hand, human_hand(), in a stated posture",
        "posture degrees": POSTURE,
        "tips": model.pad_names,
        "joints that move": {name: [model.dof_names[i] for i in np.flatnonzero(chosen)] for name, chosen in kind.items()
                             if name != "own"},
        "block norms mm/N": {name: 1e3 * block_norms(matrix) for name, matrix in matrices.items()},
        "share of the trace of G_ii": {name: dict(zip(model.pad_names, value, strict=True))
                                       for name, value in share.items()},
        "shared joints, mean share": float((share["wrist"] + share["arm"]).mean()),
        "coupling, Frobenius norm of other blocks over own blocks": {
            name: coupling(matrix) for name, matrix in matrices.items()},
        "smallest eigenvalue of G mm/N": {
            name: 1e3 * float(np.linalg.eigvalsh(matrix.reshape(15, 15))[0]) for name, matrix in matrices.items()},
        "check: G against central differences of equilibria": {
            "unloaded": parted(differences(model, q, none, config.force), G),
            f"under a grip of {config.grip:g} N, G of the loaded posture": parted(
                differences(model, q, preload, config.force), coupled(model, loaded, C)),
            "force N": config.force,
        },
        "check: error of G f for the other tips, force on the index": orders(model, q, G),
    }  # fmt: skip
    save(drawn(model, q, matrices, share, (pulled, moved)), config.out / "figure10.png")
    write(config.out / "figure10.json", result)
    return result


def pull(model: Model, tips: np.ndarray) -> np.ndarray:
    """1 N on the index finger, away from the thumb."""
    force, tip = np.zeros_like(tips), model.pad("index")
    force[tip] = (tips[tip] - tips[0]) / np.linalg.norm(tips[tip] - tips[0])
    return force


def coupling(G: np.ndarray) -> float:
    """Frobenius norm of the blocks between tips over that of the tips' own."""
    same = np.eye(len(G), dtype=bool)
    blocks = G.transpose(0, 2, 1, 3)
    return float(np.linalg.norm(blocks[~same]) / np.linalg.norm(blocks[same]))


if __name__ == "__main__":
    main(tyro.cli(Config))
