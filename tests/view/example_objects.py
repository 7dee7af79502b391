"""A made-up rollout: a box is pushed, then tips over, and a ball rolls; forces and motion in closed form."""

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation
from view.example_records import make_rollout

from icjax.geometry import Box, Cylinder, Placed, Plane, Sphere
from icjax.rollout import Rollout
from icjax.spatial import Pose
from icjax.synthesis import Object, PairFriction, Scene, Surface

HALF = np.array([0.008, 0.015, 0.02])
BOX_MASS, BALL_MASS, RADIUS = 0.05, 0.01, 0.01
ROLLING, PUSH, SLIDE = 0.06, 0.3, 0.02
"""Speed of the ball (m/s), force of the hand (N) and way of the box (m) while it is pushed from 1 s to 1.5 s."""
GRAVITY = 9.81
CORNERS = 8


def make_scene() -> Scene:
    level = Plane(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    rail = Placed(Cylinder(0.005, 0.05), Pose(Rotation.from_euler("x", 90, degrees=True).as_matrix(), np.zeros(3)))
    box = Object("box", Box(HALF), 0.5, mass=BOX_MASS)
    ball = Object("ball", Sphere(RADIUS), 0.5, mass=BALL_MASS)
    return Scene(
        "objects",
        (Surface("plate", level, 0.5), Surface("rail", rail, 0.5)),
        objects=(box, ball),
        frictions=(PairFriction(("box", "plate"), 0.3),),
    )


def course(t: np.ndarray) -> tuple[np.ndarray, Rotation, np.ndarray, Rotation]:
    """Place and rotation of the box, which turns about its lower edge from 2 s to 2.5 s, and of the ball."""
    pushed, tipped = np.clip((t - 1.0) / 0.5, 0.0, 1.0), np.clip((t - 2.0) / 0.5, 0.0, 1.0) * np.pi / 2
    turn = Rotation.from_rotvec(-tipped[:, None] * np.array([0.0, 1.0, 0.0]))
    edge = np.stack([-0.05 - SLIDE * pushed - HALF[0], 0 * t, 0 * t], axis=1)
    box = edge + turn.apply([HALF[0], 0.0, HALF[2]])
    ball = np.array([-0.12, 0.0, RADIUS]) - ROLLING * np.stack([t, 0 * t, 0 * t], axis=1)
    return box, turn, ball, Rotation.from_rotvec(-ROLLING / RADIUS * t[:, None] * np.array([0.0, 1.0, 0.0]))


def make_object_rollout() -> Rollout:
    flat = make_rollout("flat", bump=False)
    t = np.asarray(flat.time)
    box, turn, ball, roll = course(t)
    slots = ("fingertip/plate", "fingertip/box", *(f"box.{k}/plate" for k in range(1, CORNERS + 1)), "ball/plate")
    force = np.zeros((len(t), len(slots), 3))
    force[:, 0] = flat.contact_force[:, 0]
    pushing = (t >= 1.0) & (t < 1.5)
    force[pushing, 1, 0] = PUSH
    # Unequal shares of the weight, so that the centre of pressure is nowhere by symmetry.
    shares = np.array([0.4, 0.3, 0.2, 0.1, 0.0, 0.0, 0.0, 0.0])
    force[:, 2 : 2 + CORNERS, 2] = shares * BOX_MASS * GRAVITY
    force[pushing, 2 : 2 + CORNERS, 0] = shares * PUSH
    force[:, -1, 2] = BALL_MASS * GRAVITY
    point = np.repeat(box[:, None], len(slots), axis=1)
    point[:, 0] = flat.contact_point[:, 0]
    corners = np.array([[x, y, -HALF[2]] for x in (-HALF[0], HALF[0]) for y in (-HALF[1], HALF[1])])
    point[:, 2:6] += corners
    point[:, -1] = ball - np.array([0.0, 0.0, RADIUS])
    normal = np.tile(np.array([0.0, 0.0, 1.0]), (len(t), len(slots), 1))
    normal[:, 1] = np.array([1.0, 0.0, 0.0])
    state = np.where(np.linalg.norm(force, axis=2) > 0, 1, 0)
    state[pushing, 3] = 2
    gap = np.where(state > 0, 0.0, 0.01)
    gap[:, 0] = flat.gap[:, 0]
    gap[10, 4] = -0.003
    return dataclasses.replace(
        flat,
        name="objects",
        scene=make_scene().describe(),
        slot_names=slots,
        contact_force=force,
        contact_point=point,
        contact_normal=normal,
        gap=gap,
        slip_state=state,
        object_names=("box", "ball"),
        object_position=np.stack([box, ball], axis=1),
        object_quaternion=np.stack([item.as_quat(scalar_first=True) for item in (turn, roll)], axis=1),
        object_velocity=np.gradient(np.stack([box, ball], axis=1), t, axis=0),
        object_angular_velocity=np.stack(
            [
                np.where(((t > 2.0) & (t <= 2.5))[:, None], [0.0, -np.pi, 0.0], 0.0),
                np.tile([0.0, -ROLLING / RADIUS, 0.0], (len(t), 1)),
            ],
            axis=1,
        ),
    )
