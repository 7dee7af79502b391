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
from icjax.synthesis._scene import Scene
from icjax.typing import Bool, Float, Real

FIXED = -1
"""In place of an object's number: a surface."""


class Contacts(eqx.Module):
    """Geometry of all slots at one configuration; the slot of a pair of places never moves.

    **Fields**

    - `point`: contact point r_i. Of a pad on its deformed surface: its centre minus radius times normal plus the pad's
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

    **Fields**: `names` as `first/second`; `pad` its number, -1 where there is none; `first` and `second` numbers of
    objects, `FIXED` for the hand and for surfaces; `friction` and `compliance` (of the pad, m/N) of each slot.
    """

    names: tuple[str, ...]
    pad: np.ndarray
    first: np.ndarray
    second: np.ndarray
    friction: Float[Real, " slot"]
    compliance: Float[Real, " slot"]


def slots(model: Model, scene: Scene) -> Slots:
    """Every pad with every surface and object; then the contact points of objects with surfaces and other objects.

    **Errors**: `ValueError` for a thing that has the name of a pad, friction of a pair whose names are neither pads,
    surfaces nor objects, and two things whose contact would not be found.
    """
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
    for number, pad in enumerate(model.pad_names):
        for second, thing in things:
            mu = scene.friction_of(pad, thing.name)
            rows.append((f"{pad}/{thing.name}", number, FIXED, second, thing.friction if mu is None else mu))
    for first, at in _meetings(scene):
        item, (second, thing) = scene.objects[first], things[at]
        mu = scene.friction_of(item.name, thing.name)
        mu = jnp.minimum(item.friction, thing.friction) if mu is None else mu
        count = manifold_size(item.shape, thing.shape)
        numbers = [""] if count == 1 else [f".{number}" for number in range(1, count + 1)]
        rows += [(f"{item.name}{number}/{thing.name}", -1, first, second, mu) for number in numbers]
    if not rows:
        raise ValueError("nothing in the scene can touch anything: it needs a surface, or a model with pads")
    pad = np.array([row[1] for row in rows], int)
    pads = jnp.concatenate([jnp.asarray(model.pad_compliance), jnp.zeros(1)])  # the last one is no pad
    return Slots(
        names=tuple(row[0] for row in rows),
        pad=pad,
        first=np.array([row[2] for row in rows], int),
        second=np.array([row[3] for row in rows], int),
        friction=jnp.stack([jnp.asarray(row[4], pads.dtype) for row in rows]),
        compliance=pads[pad],
    )


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
    parts: list[Any] = [_of_pads(model, q, things)] if model.pad_names else []
    for first, second in _meetings(scene):
        parts.append(_rigid(contact_manifold(placed[first], things[second]), q.dtype))
    normal, gap, point, rotation, active = (jnp.concatenate(part) for part in zip(*parts, strict=True))
    table = slots(model, scene)
    if pad_force is not None:
        point = point + table.compliance[:, None] * jnp.einsum("iab,ib->ia", rotation, pad_force)
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


def _of_pads(model: Model, q: Real, things: list[Shape]):
    at = frames(model, q)
    carriers = at.bodies(model, np.asarray(model.pad_bodies, int))
    centres = jax.vmap(lambda pose, centre: pose.apply(centre))(carriers, jnp.asarray(model.pad_centre))
    distance = jnp.stack([jax.vmap(thing.signed_distance)(centres) for thing in things], axis=1).reshape(-1)
    normal = jnp.stack([jax.vmap(thing.normal)(centres) for thing in things], axis=1).reshape(-1, 3)
    pads = np.repeat(np.arange(len(model.pad_names)), len(things))
    radius = jnp.asarray(model.pad_radius)[pads]
    point = centres[pads] - radius[:, None] * normal
    return normal, distance - radius, point, carriers.rotation[pads], jnp.ones(len(pads), bool)


def _rigid(manifold: Manifold, dtype):
    count = manifold.gap.shape[0]
    rotation = jnp.broadcast_to(jnp.eye(3, dtype=dtype), (count, 3, 3))
    return manifold.normal, manifold.gap, manifold.point, rotation, manifold.active


def _relative_jacobian(model: Model, q: Real, table: Slots, point: Real, centres: list[Real]):
    of_pads = table.pad >= 0
    blocks = []
    if model.pad_names:
        at = frames(model, q)
        bodies = np.asarray(model.pad_bodies, int)[table.pad[of_pads]]
        hand = jax.vmap(lambda body, p: jacobian_at(model, at, body, p))(jnp.asarray(bodies), point[of_pads])
        rest = jnp.zeros((int(np.sum(~of_pads)), 3, model.nv), hand.dtype)
        blocks.append(jnp.concatenate([hand, rest]))
    else:
        blocks.append(jnp.zeros((len(table.pad), 3, model.nv), point.dtype))
    for number, centre in enumerate(centres):
        sign = jnp.asarray((table.first == number).astype(int) - (table.second == number).astype(int), point.dtype)
        blocks.append(sign[:, None, None] * jax.vmap(gamma)(point - centre[None]))
    return jnp.concatenate(blocks, axis=2)
