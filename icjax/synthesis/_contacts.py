"""Contact slots: every pad against every surface, where they are closest at one configuration."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.model import Model, frames, jacobian_at
from icjax.synthesis._scene import Scene
from icjax.typing import Float, Real


class Contacts(eqx.Module):
    """Geometry of all slots at one configuration; the slot of a pad and a surface never moves.

    **Fields**

    - `point`: contact point r_i, on the deformed pad: its centre minus radius times normal plus the pad's deformation
      under the force that it carries, world, m. A loaded point lies on the surface, not behind it.
    - `normal`: outward unit normal of the surface, towards the pad, world.
    - `gap`: s_i0 between the undeformed pad and the surface, negative in penetration, m.
    - `jacobian`: J_i of the contact point (Eq. 4).
    - `rotation`: of the body that carries the pad, to world.
    """

    point: Float[Real, "slot 3"]
    normal: Float[Real, "slot 3"]
    gap: Float[Real, " slot"]
    jacobian: Float[Real, "slot 3 nv"]
    rotation: Float[Real, "slot 3 3"]


def slot_names(model: Model, scene: Scene) -> tuple[str, ...]:
    """Names of the contact slots, `pad/surface`: the surfaces of the first pad, of the second, and so on."""
    return tuple(f"{pad}/{surface.name}" for pad in model.pad_names for surface in scene.surfaces)


def slot_pads(model: Model, scene: Scene) -> np.ndarray:
    """Index of the pad of each slot."""
    return np.repeat(np.arange(len(model.pad_names)), len(scene.surfaces))


def slot_compliance(model: Model, scene: Scene) -> Float[Real, " slot"]:
    """Compliance of the pad of each slot, m/N."""
    return jnp.asarray(model.pad_compliance)[slot_pads(model, scene)]


def find_contacts(
    model: Model, scene: Scene, q: Float[Real, " nq"], pad_force: Float[Real, "slot 3"] | None = None
) -> Contacts:
    """Closest points of all pads and surfaces at configuration `q` (Section 7.1.3, last step).

    **Arguments**: `q`; `pad_force` on each slot, N, in the frame of the body that carries the pad (none: unloaded).
    """
    at = frames(model, q)
    carriers = at.bodies(model, np.asarray(model.pad_bodies, int))
    centres = jax.vmap(lambda pose, centre: pose.apply(centre))(carriers, jnp.asarray(model.pad_centre))
    pads = slot_pads(model, scene)
    bodies = np.asarray(model.pad_bodies, int)[pads]
    radius = jnp.asarray(model.pad_radius)[pads]
    each = [surface.shape for surface in scene.surfaces]
    distance = jnp.stack([jax.vmap(shape.signed_distance)(centres) for shape in each], axis=1).reshape(-1)
    normal = jnp.stack([jax.vmap(shape.normal)(centres) for shape in each], axis=1).reshape(-1, 3)
    rotation = carriers.rotation[pads]
    point = centres[pads] - radius[:, None] * normal
    if pad_force is not None:
        point = point + slot_compliance(model, scene)[:, None] * jnp.einsum("iab,ib->ia", rotation, pad_force)
    jacobian = jax.vmap(lambda body, p: jacobian_at(model, at, body, p))(jnp.asarray(bodies), point)
    return Contacts(point=point, normal=normal, gap=distance - radius, jacobian=jacobian, rotation=rotation)
