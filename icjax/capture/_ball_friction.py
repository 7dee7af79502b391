"""Friction at the fingertips on a free ball that measures only normal forces: what its weight asks for."""

import numpy as np
from jaxtyping import Bool, Float

NORMAL_SD = 0.05
"""Of a measured normal force, relative: a fingertip covers a few cells, whose gains differ."""

LEAST_SD = 0.02
"""N, of a measured normal force."""

BALANCE_SD = 0.02
"""N: what acceleration and spin, left out of the balance, add to it."""

OFF = (0.001, 0.003)
"""m; so far above where it lay something else may still hold the ball, and so far above nothing does."""


def lifted(height: Float[np.ndarray, " frame"], lying: Bool[np.ndarray, " frame"]) -> Float[np.ndarray, " frame"]:
    """How surely nothing but fingers holds a ball, zero to one, by its height (m) over where it lay.

    Zero throughout where it is not known to have lain anywhere.
    """
    if not lying.any():
        return np.zeros(len(height))
    part = np.clip((height - np.median(height[lying]) - OFF[0]) / (OFF[1] - OFF[0]), 0.0, 1.0)
    return part**2 * (3.0 - 2.0 * part)


def balanced_friction(
    force: Float[np.ndarray, "frame finger 3"],
    lever: Float[np.ndarray, "frame finger 3"],
    touching: Bool[np.ndarray, "frame finger"],
    load: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "frame finger 3"]:
    r"""Forces on the fingers that carry a ball slowly, from the normal ones.

    Of all forces $f_i = (N_i + \delta_i) n_i + t_i$ the likeliest, if friction is about as large as a normal force
    and no direction of it more likely than another:

    $$\min \sum_i \frac{\lVert t_i \rVert^2}{N_i^2} + \frac{\delta_i^2}{s_i^2} + \frac{\lVert e \rVert^2}{s_e^2}, \qquad
    e = \Bigl(\sum_i f_i - w,\ \tfrac1R \sum_i r_i \times f_i\Bigr)$$

    with the weight w. Fingers that squeeze without moving the ball, along the lines between them or by twisting against
    each other, add to the true friction what no balance shows. No friction cone is imposed.

    **Arguments**

    - `force` N: normal forces on the fingers. `lever` m: places they act at, from the middle of the ball.
    - `touching`; what does not touch has no force. `load` N: weight of the ball, world.

    **Returns** forces with friction, N.
    """
    lever = np.where(touching[:, :, None], lever, 0.0)
    size = np.linalg.norm(force, axis=2)
    held = touching & (size > 0.0)
    radius = np.linalg.norm(lever, axis=2).max(initial=1e-3)
    normal = force / np.where(held, size, 1.0)[:, :, None]
    spread = np.where(held, NORMAL_SD * size + LEAST_SD, 0.0) ** 2
    along = normal[:, :, :, None] * normal[:, :, None, :]
    across = np.where(held, size, 0.0)[:, :, None, None] ** 2 * (np.eye(3) - along)
    covariance = across + spread[:, :, None, None] * along
    turn = np.zeros((*lever.shape[:2], 3, 3))
    for first, second, third in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        turn[:, :, second, first], turn[:, :, first, second] = lever[:, :, third], -lever[:, :, third]
    # the cross product with the lever as a matrix, over the radius: torques as forces at the surface
    wrench = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn / radius], axis=2)
    missing = np.concatenate([load, np.zeros(3)]) - np.einsum("fkij,fkj->fi", wrench, force)
    spreads = np.einsum("fkij,fkjl,fkml->fim", wrench, covariance, wrench) + BALANCE_SD**2 * np.eye(6)
    answer = np.linalg.solve(spreads, missing[:, :, None])[:, :, 0]
    return force + np.einsum("fkij,fklj,fl->fki", covariance, wrench, answer)
