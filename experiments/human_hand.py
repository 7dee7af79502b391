"""Pictures of the shipped hand, and how its thumb meets each finger.

    uv run --extra viz python experiments/human_hand.py

Postures: flat, relaxed (`rest`), fist, and the thumb's pad on the pad of each finger, found within the limits by
L-BFGS-B. Written to experiments/results/human_hand.json and docs/human_hand.png.
"""

import json
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from icjax.model import Model, forward_kinematics, human_hand, pad_positions
from icjax.view._skeleton import body_poses, bones

FOLDER = Path(__file__).resolve().parents[1]
FINGERS = ("index", "middle", "ring", "little")
COLOURS = {"thumb": "#c9705a", "index": "#d9a04e", "middle": "#7d9f5b", "ring": "#4f8f9e", "little": "#7d6fa8"}
PALM = "#b9b2a6"
STRAIN = 1e-3
"""What a turn of a joint by 1 rad from the relaxed posture costs, against 1 cm between the pads."""
VIEWS = ((12.0, 115.0), (-75.0, -90.0))
"""Elevation and azimuth of the eye, deg: from the thumb's side, and onto the palm."""


@jax.jit
@partial(jax.value_and_grad, has_aux=True, argnums=1)
def apart(model: Model, q, pad):
    """What keeps the thumb's pad from another; the gap (m) and the cosines of the angles off their palmar sides."""
    places, poses = pad_positions(model, q), forward_kinematics(model, q)
    between = places[pad] - places[0]
    distance = jnp.linalg.norm(between)
    bodies, radius = jnp.asarray(model.pad_bodies), jnp.asarray(model.pad_radius)
    facing = jnp.stack([-poses[bodies[0]].rotation[:, 2] @ between, poses[bodies[pad]].rotation[:, 2] @ between])
    gap, facing = distance - radius[0] - radius[pad], facing / distance
    strain = jnp.sum((q - jnp.asarray(model.rest)) ** 2)
    return (100 * gap) ** 2 + jnp.sum(jnp.maximum(0.7 - facing, 0.0) ** 2) + STRAIN * strain, (gap, facing)


def met(model: Model, finger: str) -> tuple[np.ndarray, dict[str, float]]:
    """Posture in which the pads of thumb and finger touch, each within 45 deg of its palmar side; joints, deg."""
    pad = model.pad(finger)
    start = bent(model, np.asarray(model.rest), {"CM_flexion": 20, f"{finger}_MP": 50, f"{finger}_PIP": 50})

    def cost(q):
        (value, _), slope = apart(model, jnp.asarray(q), pad)
        return float(value), np.asarray(slope)

    limits = list(zip(model.lower, model.upper, strict=True))
    q = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=limits).x
    (_, (gap, facing)), _ = apart(model, jnp.asarray(q), pad)
    off = np.degrees(np.arccos(np.asarray(facing)))
    told = {"gap, mm": round(1e3 * float(gap), 2)} | dict(
        zip(("thumb off, deg", "finger off, deg"), off.round(1).tolist(), strict=True)
    )
    for joint, angle in zip(model.joint_names, q, strict=True):
        if joint.startswith(("thumb", finger)):
            told[joint] = round(float(np.degrees(angle)), 1)
    return q, told


def bent(model: Model, q: np.ndarray, degrees: dict[str, float]) -> np.ndarray:
    """Coordinates with some joints at these angles; a part of a name stands for all joints that have it."""
    q = q.copy()
    for name, angle in degrees.items():
        q[[index for index, joint in enumerate(model.joint_names) if name in joint]] = np.radians(angle)
    return q


def draw(axes, model: Model, q: np.ndarray, view: tuple[float, float]) -> None:
    """Capsules as rows of discs, the far ones first; pads outlined."""
    from matplotlib.patches import Circle

    elevation, azimuth = np.radians(view)
    eye = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.cross(eye, right)
    rotation, position = (part[0] for part in body_poses(model, q[None]))
    discs = []
    for bone in bones(model):
        digit = model.body_names[bone.body].split("_")[0]
        for share in np.linspace(0, 1, 40) if digit != "forearm" else ():
            point = rotation[bone.body] @ ((1 - share) * bone.start + share * bone.end) + position[bone.body]
            radius = (1 - share) * bone.start_radius + share * bone.end_radius
            discs.append((point, radius, COLOURS.get(digit, PALM), 0.0))
    for pad, body in enumerate(model.pad_bodies):
        point = rotation[body] @ model.pad_centre[pad] + position[body]
        discs.append((point, model.pad_radius[pad], COLOURS[model.pad_names[pad]], 0.7))
    for point, radius, colour, edge in sorted(discs, key=lambda disc: disc[0] @ eye):
        place = 1e3 * (point @ right), 1e3 * (point @ up)
        axes.add_patch(Circle(place, 1e3 * radius, facecolor=colour, edgecolor="black", linewidth=edge))
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.axis("off")


def main() -> None:
    """Find, print, draw."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    jax.config.update("jax_enable_x64", True)
    model = human_hand(root="fixed")
    thumb = {"CM_flexion": 25, "CM_abduction": -20, "thumb_MP": 40, "thumb_IP": 55}
    postures = {
        "flat": bent(model, np.zeros(model.nq), {"CM_abduction": -45, "CM_flexion": -15}),
        "relaxed": np.asarray(model.rest),
        "fist": bent(model, np.zeros(model.nq), {"MP": 85, "PIP": 100, "DIP": 70} | thumb),
    }
    told = {}
    for finger in FINGERS:
        postures[f"thumb and {finger}"], told[finger] = met(model, finger)
        print(finger, told[finger])
    (FOLDER / "experiments" / "results" / "human_hand.json").write_text(json.dumps(told, indent=1) + "\n")

    figure, grid = plt.subplots(len(VIEWS), len(postures), figsize=(1.6 * len(postures), 3.2), layout="constrained")
    for row, view in enumerate(VIEWS):
        for axes, (name, q) in zip(grid[row], postures.items(), strict=True):
            draw(axes, model, q, view)
            axes.set_title("" if row else name, fontsize=9)
    figure.savefig(FOLDER / "docs" / "human_hand.png", dpi=90)


if __name__ == "__main__":
    main()
