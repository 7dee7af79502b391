"""Contact slots: who may touch whom, and where they are closest at one configuration."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.geometry import Manifold, Placed, Shape, contact_manifold, manifold_size
from icjax.model import Model, frames, jacobian_at
from icjax.spatial import gamma
from icjax.synthesis._object import Motion
from icjax.synthesis._pads import pad_contacts, pad_pairs
from icjax.synthesis._scene import Scene
from icjax.typing import Bool, Float, Real

FIXED = -1
"""In place of an object's number: a surface."""


class Contacts(eqx.Module):
    """Geometry of all slots at one configuration; the slot of a pair of places never moves.

    **Fields**

    - `point`: contact point r_i. Of a pad on its deformed surface: that of its undeformed one plus the pad's
      deformation under the force that it carries, world, m. A loaded point lies on the surface, not behind it.
    - `normal`: outward unit normal of the second body, towards the first, world.
    - `gap`: s_i0 between the undeformed bodies, negative in penetration, m.
    - `jacobian`: J_i of the relative motion, first body minus second (Eq. 4): columns of the hand, then six of each
      object (rotation, centre of mass; world axes).
    - `rotation`: of the body that carries the pad, to world; the identity where there is no pad.
    - `active`: whether there is a point at all; two solids have fewer or more of them as they turn.
    """

    point: Float[Real, "slot 3"]
    normal: Float[Real, "slot 3"]
    gap: Float[Real, " slot"]
    jacobian: Float[Real, "slot 3 coordinate"]
    rotation: Float[Real, "slot 3 3"]
    active: Bool[Real, " slot"]


class Slots(NamedTuple):
    """What of the slots does not move.

    **Fields**: `names` as `first/second`; `pad` its number, -1 where there is none; `other` that of the pad that it
    meets, if any; `first` and `second` numbers of objects, `FIXED` for the hand and for surfaces; `friction` of each
    slot; `compliance` of its pads together and `deformed` of the first one (m/N).
    """

    names: tuple[str, ...]
    pad: np.ndarray
    other: np.ndarray
    first: np.ndarray
    second: np.ndarray
    friction: Float[Real, " slot"]
    compliance: Float[Real, " slot"]
    deformed: Float[Real, " slot"]


def slots(model: Model, scene: Scene) -> Slots:
    """Every pad with every surface, object and pad stated; then the points of objects with surfaces and other objects.

    **Errors**: `ValueError` for a thing that has the name of a pad, names that could be mixed up, friction of a pair
    whose names are neither pads, surfaces nor objects, and two things whose contact would not be found.
    """
    for name in model.pad_names:
        if "/" in name:
            raise ValueError(f"pad {name!r} of {model.name!r}: names of pads must be without '/'")
    for thing in (*scene.surfaces, *scene.objects):
        if thing.name in model.pad_names:
            raise ValueError(
                f"{thing.name!r} is the name of a pad of {model.name!r}; a surface or object needs another"
            )
    known = {*model.pad_names, *(thing.name for thing in (*scene.surfaces, *scene.objects))}
    for pair in scene.frictions:
        for name in pair.names:
            if name not in known:
                raise ValueError(f"frictions name {name!r}, which is none of {', '.join(sorted(known))}")
    things = [(FIXED, item) for item in scene.surfaces] + list(enumerate(scene.objects))
    rows: list[Any] = []
    for pad, place, other, count in pad_pairs(model, scene, [item.shape for _, item in things]):
        if place < 0:
            name, second, mu = model.pad_names[other], FIXED, None
        else:
            second, thing = things[place]
            name, mu = thing.name, thing.friction
        stated = scene.friction_of(model.pad_names[pad], name)
        mu = mu if stated is None else stated
        names = _numbered(model.pad_names[pad], name, count)
        rows += [(label, pad, other, FIXED, second, mu) for label in names]
    for first, at in _meetings(scene):
        item, (second, thing) = scene.objects[first], things[at]
        mu = scene.friction_of(item.name, thing.name)
        mu = jnp.minimum(item.friction, thing.friction) if mu is None else mu
        names = _numbered(item.name, thing.name, manifold_size(item.shape, thing.shape))
        rows += [(label, -1, -1, first, second, mu) for label in names]
    if not rows:
        raise ValueError("nothing in the scene can touch anything: it needs a surface, or a model with pads")
    twice = [row[0] for row in rows if sum(row[0] == one[0] for one in rows) > 1]
    if twice:
        raise ValueError(f"two contacts would be named {twice[0]!r}: a name that ends in a number is that of a point")
    pad, other, first, second = (np.array([row[i] for row in rows], int) for i in range(1, 5))
    pads = jnp.concatenate([jnp.asarray(model.pad_compliance), jnp.zeros(1)])  # the last one is no pad
    return Slots(
        names=tuple(row[0] for row in rows),
        pad=pad,
        other=other,
        first=first,
        second=second,
        friction=jnp.stack([jnp.asarray(row[5], pads.dtype) for row in rows]),
        compliance=pads[pad] + pads[other],
        deformed=pads[pad],
    )


def _numbered(first: str, second: str, count: int) -> list[str]:
    numbers = [""] if count == 1 else [f".{number}" for number in range(1, count + 1)]
    return [f"{first}{number}/{second}" for number in numbers]


def slot_names(model: Model, scene: Scene) -> tuple[str, ...]:
    """Names of the contact slots, `first/second`: pads on surfaces and objects, then points of objects, numbered."""
    return slots(model, scene).names


def find_contacts(
    model: Model,
    scene: Scene,
    q: Float[Real, " nq"],
    pad_force: Float[Real, "slot 3"] | None = None,
    motions: tuple[Motion, ...] = (),
) -> Contacts:
    """Closest points of all slots at one configuration (Section 7.1.3, last step).

    **Arguments**: `q`; `pad_force` on each slot, N, in the frame of the body that carries the pad (none: unloaded);
    `motions` of the objects.
    """
    poses = [motion.pose() for motion in motions]
    placed = [Placed(item.shape, pose) for item, pose in zip(scene.objects, poses, strict=True)]
    things = [*(item.shape for item in scene.surfaces), *placed]
    centres = [pose.apply(item.com) for item, pose in zip(scene.objects, poses, strict=True)]
    parts: list[Any] = []
    if any(pair.count for pair in pad_pairs(model, scene, things)):
        found = pad_contacts(model, scene, q, things)
        parts.append((found.normal, found.gap, found.point, found.rotation, found.active))
    for first, second in _meetings(scene):
        parts.append(_rigid(contact_manifold(placed[first], things[second]), q.dtype))
    normal, gap, point, rotation, active = (jnp.concatenate(part) for part in zip(*parts, strict=True))
    table = slots(model, scene)
    if pad_force is not None:
        point = point + table.deformed[:, None] * jnp.einsum("iab,ib->ia", rotation, pad_force)
    jacobian = _relative_jacobian(model, q, table, point, centres)
    return Contacts(point, normal, gap, jacobian, rotation, active)


def _meetings(scene: Scene) -> list[tuple[int, int]]:
    """Number of an object, and the place of what it may touch among surfaces and objects."""
    things = (*scene.surfaces, *scene.objects)
    fixed = len(scene.surfaces)
    found = []
    for number, item in enumerate(scene.objects):
        for other in [place for place in range(len(things)) if place < fixed or place > number + fixed]:
            if item.driven and (other < fixed or scene.objects[other - fixed].driven):
                continue
            if not manifold_size(item.shape, things[other].shape):
                kinds = (type(_core(thing.shape)).__name__.lower() for thing in (item, things[other]))
                raise ValueError(
                    f"contact of {item.name!r} with {things[other].name!r} is not implemented: {' and '.join(kinds)}"
                )
            found.append((number, other))
    return found


def _core(shape: Shape) -> Shape:
    return _core(shape.shape) if isinstance(shape, Placed) else shape


def _rigid(manifold: Manifold, dtype):
    count = manifold.gap.shape[0]
    rotation = jnp.broadcast_to(jnp.eye(3, dtype=dtype), (count, 3, 3))
    return manifold.normal, manifold.gap, manifold.point, rotation, manifold.active


def _relative_jacobian(model: Model, q: Real, table: Slots, point: Real, centres: list[Real]):
    of_pads = table.pad >= 0
    blocks = []
    if of_pads.any():
        at = frames(model, q)
        hand = _jacobians(model, at, table.pad[of_pads], point[of_pads])
        if (table.other >= 0).any():
            both = np.flatnonzero(table.other >= 0)  # pads come first
            hand = jnp.asarray(hand).at[both].add(-_jacobians(model, at, table.other[both], point[both]))
        rest = jnp.zeros((int(np.sum(~of_pads)), 3, model.nv), hand.dtype)
        blocks.append(jnp.concatenate([hand, rest]))
    else:
        blocks.append(jnp.zeros((len(table.pad), 3, model.nv), point.dtype))
    for number, centre in enumerate(centres):
        sign = jnp.asarray((table.first == number).astype(int) - (table.second == number).astype(int), point.dtype)
        blocks.append(sign[:, None, None] * jax.vmap(gamma)(point - centre[None]))
    return jnp.concatenate(blocks, axis=2)


def _jacobians(model: Model, at: Any, pads: np.ndarray, points: Real) -> Real:
    bodies = np.asarray(model.pad_bodies, int)[pads]
    return jax.vmap(lambda body, p: jacobian_at(model, at, body, p))(jnp.asarray(bodies), points)
