"""Contact forces of each pair of bodies, the corners of an object together."""

from typing import NamedTuple

import numpy as np

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout


class Pairs(NamedTuple):
    """Force on the first body `[time, pair, 3]` (N), where it acts (m), and slip state `[time, pair]` of every pair.

    `bodies` names both; `on_hand` says which forces act on the hand; `normal` `[time, pair, 3]` is the mean over the
    corners, by what each carries (zero where a measured record knows none), `friction` `[pair]` mu, NaN if unknown.
    """

    bodies: tuple[tuple[str, str], ...]
    force: np.ndarray
    point: np.ndarray
    state: np.ndarray
    on_hand: np.ndarray
    normal: np.ndarray
    friction: np.ndarray

    def ratio(self) -> np.ndarray:
        """Tangential over normal force `[time, pair]`; NaN where nothing presses."""
        pressing = np.sum(self.force * self.normal, axis=-1)
        sliding = np.linalg.norm(self.force - pressing[..., None] * self.normal, axis=-1)
        return np.where(pressing > 0, sliding / np.where(pressing > 0, pressing, 1.0), np.nan)


def pair_forces(record: Recording | Interaction | Rollout, rows: np.ndarray | slice = slice(None)) -> Pairs:
    """Sums over the slots of every pair at some times, at the centre of pressure; the largest of the slip states.

    A measured record has no objects and no slip states: every contact is a pair, its state 0.
    """
    force = np.nan_to_num(np.asarray(record.contact_force, dtype=float)[rows])
    point = np.asarray(record.contact_point, dtype=float)[rows]
    if not isinstance(record, Rollout):
        bodies = tuple((name, "") for name in record.contact_names)
        state, unknown = np.zeros(force.shape[:2], int), np.full(len(bodies), np.nan)
        return Pairs(bodies, force, point, state, np.ones(len(bodies), bool), np.zeros_like(force), unknown)
    state, bodies = np.asarray(record.slip_state)[rows], record.slot_bodies()
    normal = np.nan_to_num(np.asarray(record.contact_normal, dtype=float)[rows])
    if not record.object_names:
        return Pairs(bodies, force, point, state, np.ones(len(bodies), bool), normal, _friction(record, bodies))
    pressure = np.sum(force * normal, axis=-1)
    pairs = tuple(dict.fromkeys(bodies))
    columns = [[slot for slot, own in enumerate(bodies) if own == pair] for pair in pairs]
    weights = [np.maximum(pressure[:, own], 1e-12) for own in columns]
    centres = [
        np.sum(weight[..., None] * point[:, own], axis=1) / weight.sum(axis=1)[:, None]
        for weight, own in zip(weights, columns, strict=True)
    ]
    mean = [np.sum(weight[..., None] * normal[:, own], axis=1) for weight, own in zip(weights, columns, strict=True)]
    normals = np.stack(mean, axis=1)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return Pairs(
        bodies=pairs,
        force=np.stack([force[:, own].sum(axis=1) for own in columns], axis=1),
        point=np.stack(centres, axis=1),
        state=np.stack([state[:, own].max(axis=1) for own in columns], axis=1),
        on_hand=np.array([first not in record.object_names for first, _ in pairs]),
        normal=normals / np.where(length > 0, length, 1.0),
        friction=_friction(record, pairs),
    )


def _friction(rollout: Rollout, pairs: tuple[tuple[str, str], ...]) -> np.ndarray:
    stated = [rollout.friction_of(*bodies) for bodies in pairs]
    return np.array([np.nan if value is None else value for value in stated])


def largest_force(pairs: Pairs) -> float:
    """The force that the longest arrow of a picture stands for, N; never zero.

    The largest one on the hand. Where it touches nothing, all but a hundredth of those on objects are smaller: a blow
    between rigid things, over in a step, would make all other arrows vanish.
    """
    size = np.linalg.norm(pairs.force, axis=-1)
    largest = float(size[:, pairs.on_hand].max(initial=0.0))
    if largest == 0.0 and size.any():
        largest = float(np.quantile(size[size > 0], 0.99))
    return max(largest, 1e-9)
