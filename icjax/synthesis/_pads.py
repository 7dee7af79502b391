"""Contact of the hand's pads, balls and capsules: with surfaces and objects, and with each other."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from icjax.contact import contact_frame
from icjax.geometry import Capsule, Manifold, Placed, Shape, Sphere, contact_manifold, manifold_size
from icjax.model import Model, frames
from icjax.spatial import Pose
from icjax.synthesis._scene import Scene
from icjax.typing import Bool, Float, Real, Vector3


class PadContacts(NamedTuple):
    """Where pads touch, in the order of [`pad_pairs`]; `rotation` of the bodies that carry them, to world."""

    normal: Float[Real, "slot 3"]
    gap: Float[Real, " slot"]
    point: Float[Real, "slot 3"]
    rotation: Float[Real, "slot 3 3"]
    active: Bool[Real, " slot"]


class PadPair(NamedTuple):
    """A pad, the place of what it may touch among the things or the other pad (else -1), and how many points."""

    pad: int
    thing: int
    other: int
    count: int


def pad_pairs(model: Model, scene: Scene, shapes: list[Shape]) -> list[PadPair]:
    """Who may touch whom: balls with all things, capsules with all things, then pads with the pads stated for them.

    A pad meets another one only if `Scene.frictions` states the friction of the two.

    **Errors**: `ValueError` for two pads of one body, and a capsule with a thing whose contact is not implemented.
    """
    places = range(len(shapes))
    balls = [PadPair(pad, place, -1, 1) for pad in _pads(model, "ball") for place in places]
    rods, found = _pads(model, "capsule"), []
    for place, shape in enumerate(shapes if len(rods) else []):
        count = manifold_size(Capsule(1.0, 1.0), shape)
        if not count:
            raise ValueError(
                f"contact of the capsule {model.pad_names[rods[0]]!r} with a {_kind(shape)}: not implemented"
            )
        found += [PadPair(pad, place, -1, count) for pad in rods.tolist()]
    for first, second in _partners(model, scene):
        shape_of = {"ball": Sphere(1.0), "capsule": Capsule(1.0, 1.0)}
        first_shape, second_shape = (shape_of[model.pad_types[pad]] for pad in (first, second))
        found.append(PadPair(first, -1, second, manifold_size(first_shape, second_shape)))
    return balls + found


def pad_contacts(model: Model, scene: Scene, q: Float[Real, " nq"], things: list[Shape]) -> PadContacts:
    """Closest points of pads with things and with each other.

    **Arguments**: `things` where they are, in the order of the shapes given to [`pad_pairs`].
    """
    at = frames(model, q)
    carriers = at.bodies(model, np.asarray(model.pad_bodies, int))
    centre = jax.vmap(lambda pose, place: pose.apply(place))(carriers, jnp.asarray(model.pad_centre))
    radius = jnp.asarray(model.pad_radius)
    balls, rods = _pads(model, "ball"), _pads(model, "capsule")
    parts = []
    if len(balls) and things:
        parts.append(_balls(centre[balls], radius[balls], carriers.rotation[balls], things))
    shapes = {pad: Placed(Sphere(radius[pad]), Pose(jnp.eye(3), centre[pad])) for pad in balls}
    if len(rods):
        axis = jnp.einsum("pab,pb->pa", carriers.rotation[rods], jnp.asarray(model.pad_axis)[rods])
        placed = jax.vmap(_rod)(centre[rods], radius[rods], axis)
        for thing in things:
            found = jax.vmap(lambda rod, thing=thing: contact_manifold(rod, thing))(placed)
            parts.append(_listed(found, carriers.rotation[rods]))
        shapes |= {pad: jax.tree.map(lambda x, i=i: x[i], placed) for i, pad in enumerate(rods)}
    for first, second in _partners(model, scene):
        found = jax.tree.map(lambda x: x[None], contact_manifold(shapes[first], shapes[second]))
        parts.append(_listed(found, carriers.rotation[first][None]))
    return PadContacts(*(jnp.concatenate(part) for part in zip(*parts, strict=True)))


def _pads(model: Model, kind: str) -> np.ndarray:
    return np.array([pad for pad, its in enumerate(model.pad_types) if its == kind], int)


def _partners(model: Model, scene: Scene) -> list[tuple[int, int]]:
    """Pads that may touch each other."""
    found = []
    for pair in scene.frictions:
        if all(name in model.pad_names for name in pair.names):
            first, second = (model.pad(name) for name in pair.names)
            if model.pad_bodies[first] == model.pad_bodies[second]:
                body = model.body_names[model.pad_bodies[first]]
                raise ValueError(f"pads {pair.names[0]!r} and {pair.names[1]!r} are on one body, {body!r}")
            if (first, second) not in found and (second, first) not in found:
                found.append((first, second))
    return found


def _balls(centre: Real, radius: Real, rotation: Real, things: list[Shape]):
    distance = jnp.stack([jax.vmap(thing.signed_distance)(centre) for thing in things], axis=1).reshape(-1)
    normal = jnp.stack([jax.vmap(thing.normal)(centre) for thing in things], axis=1).reshape(-1, 3)
    pads = np.repeat(np.arange(len(centre)), len(things))
    point = centre[pads] - radius[pads, None] * normal
    return PadContacts(normal, distance - radius[pads], point, rotation[pads], jnp.ones(len(pads), bool))


def _rod(centre: Vector3, radius: Real, axis: Vector3) -> Placed:
    """The capsule about a half axis."""
    length = jnp.sqrt(jnp.sum(axis**2))
    along, first, second = contact_frame(axis / length).T
    return Placed(Capsule(radius, length), Pose(jnp.stack([first, second, along], axis=1), centre))


def _listed(found: Manifold, rotation: Real) -> PadContacts:
    """Of manifolds `[pad, point]`."""
    count = found.gap.shape[1]
    flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), found)
    return PadContacts(flat.normal, flat.gap, flat.point, jnp.repeat(rotation, count, axis=0), flat.active)


def _kind(shape: Shape) -> str:
    return _kind(shape.shape) if isinstance(shape, Placed) else type(shape).__name__.lower()
