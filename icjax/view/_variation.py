"""What may be changed of an interaction and a scene while one looks at them."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.geometry import Plane, manifold_size
from icjax.interaction import Interaction
from icjax.spatial import Pose
from icjax.synthesis import Object, Scene
from icjax.view._substitutes import AS_GIVEN, SUBSTITUTES, lowest, resized, substitute


@dataclasses.dataclass(frozen=True)
class Variation:
    """Numbers of a scene and an interaction; a thing that is not named keeps its own.

    **Fields**

    - `compliance`: factor on every compliance of the hand; what is driven stays driven.
    - `friction`: mu by the name of a surface or object. Frictions of pairs in the scene stay.
    - `mass`: kg, by the name of an object; its inertia grows with it.
    - `size`: factor by the name of an object or a solid surface. An object keeps its mass and its lowest point, a
      surface its middle.
    - `shape`: by the name of an object, one of [`shapes_for`]: as large as the shape given along every axis of its
      frame, filled evenly.
    """

    compliance: float = 1.0
    friction: Mapping[str, float] = dataclasses.field(default_factory=dict)
    mass: Mapping[str, float] = dataclasses.field(default_factory=dict)
    size: Mapping[str, float] = dataclasses.field(default_factory=dict)
    shape: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def form(self) -> tuple[tuple[str, str], ...]:
        """What a compiled step depends on: shapes other than the given ones. All else is numbers."""
        return tuple(sorted(item for item in self.shape.items() if item[1] != AS_GIVEN))


def varied_interaction(interaction: Interaction, variation: Variation) -> Interaction:
    """The interaction with other compliances."""
    if not (np.isfinite(variation.compliance) and variation.compliance >= 0):
        raise ValueError(f"the factor on the compliance must be zero or more; got {variation.compliance}")
    full = interaction.full_compliance
    return dataclasses.replace(
        interaction,
        compliance=variation.compliance * np.asarray(interaction.compliance),
        full_compliance=None if full is None else variation.compliance * np.asarray(full),
    )


def varied_scene(scene: Scene, variation: Variation) -> Scene:
    """The scene with other numbers and shapes, of one form: every number an array, so that none is compiled in.

    **Errors**: `ValueError` for a name that is none, or what no scene can be.
    """
    things = {thing.name for thing in (*scene.surfaces, *scene.objects)}
    for field in ("friction", "mass", "size", "shape"):
        for name in getattr(variation, field):
            if name not in things:
                raise ValueError(f"{field} of {name!r}, which is none of {', '.join(sorted(things))}")
    up = _up(scene)
    return dataclasses.replace(
        scene,
        surfaces=tuple(
            dataclasses.replace(
                item,
                shape=_arrays(resized(item.shape, variation.size.get(item.name, 1.0), about_middle=True)),
                friction=variation.friction.get(item.name, item.friction),
            )
            for item in scene.surfaces
        ),
        objects=tuple(_varied_object(item, variation, up) for item in scene.objects),
    )


def shapes_for(scene: Scene, name: str) -> tuple[str, ...]:
    """Shapes that an object may take in a scene: those whose contacts can be found, the given one first."""
    things = {thing.name: thing for thing in (*scene.surfaces, *scene.objects)}
    others = [thing.shape for other, thing in things.items() if other != name and not _both_driven(things[name], thing)]
    unit = {kind: make(np.ones(3), 2, np.ones(3))[0] for kind, make in SUBSTITUTES.items()}
    possible = (kind for kind, shape in unit.items() if all(manifold_size(shape, other) for other in others))
    return (AS_GIVEN, *possible)


def can_resize(shape: Any) -> bool:
    """Whether a shape has a size."""
    if isinstance(shape, Plane):
        return False
    try:
        resized(shape, 2.0)
    except ValueError:
        return False
    return True


def _both_driven(first: Any, second: Any) -> bool:
    """Whether nothing comes of their contact: a driven object goes where it is told to."""
    return getattr(first, "driven", False) and getattr(second, "driven", True)


def _varied_object(item: Object, variation: Variation, up: np.ndarray | None) -> Object:
    factor, kind = variation.size.get(item.name, 1.0), variation.shape.get(item.name, AS_GIVEN)
    mass = variation.mass.get(item.name, float(item.mass))
    friction = variation.friction.get(item.name, item.friction)
    if item.driven:
        return dataclasses.replace(item, shape=_arrays(resized(item.shape, factor)), friction=friction)
    shape = _arrays(resized(substitute(item.shape, kind, item.pose.rotation, up), factor))
    changed: dict[str, Any] = {"com": factor * item.com, "inertia": mass / float(item.mass) * factor**2 * item.inertia}
    if kind != AS_GIVEN:
        changed = {"com": None, "inertia": None}
    return Object(
        item.name,
        shape,
        friction,
        mass=mass,
        pose=_set_down(item, shape, up),
        velocity=item.velocity,
        angular_velocity=item.angular_velocity,
        **changed,
    )


def _set_down(item: Object, shape: Any, up: np.ndarray | None) -> Pose:
    """Where the object begins with another shape: its lowest point as high as before."""
    if up is None:
        return item.pose
    R = np.asarray(item.pose.rotation)
    raised = lowest(item.shape, R.T @ up) - lowest(shape, R.T @ up)
    return Pose(item.pose.rotation, jnp.asarray(np.asarray(item.pose.position) + raised * up))


def _up(scene: Scene) -> np.ndarray | None:
    """Unit vector against gravity, None where there is none."""
    gravity = np.asarray(scene.gravity, float)
    size = float(np.linalg.norm(gravity))
    return -gravity / size if size > 0 else None


def _arrays(shape: Any) -> Any:
    """A shape whose every number is an array."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, float) if eqx.is_inexact_array_like(leaf) else leaf, shape)
