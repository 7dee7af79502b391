"""Contact of two solids, whatever they are."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from icjax.geometry._box import Box
from icjax.geometry._capsule_contact import capsule_contact
from icjax.geometry._ellipsoid import Ellipsoid
from icjax.geometry._general_contact import general_contact
from icjax.geometry._heightfield import Heightfield
from icjax.geometry._manifold import Manifold, joined
from icjax.geometry._mesh import Mesh
from icjax.geometry._plane import Plane
from icjax.geometry._polytope_contact import polytope_contact
from icjax.geometry._prism import Prism
from icjax.geometry._round import Capsule, Cylinder, Sphere
from icjax.geometry._shape import Placed, Shape
from icjax.geometry._union import Union
from icjax.spatial import Pose


def contact_manifold(first: Shape, second: Shape) -> Manifold:
    """Where two solids touch.

    - Sphere and any solid: one point.
    - Any convex solid and plane: its probes, all its corners or the balls that touch its surface from within.
    - Boxes and prisms: the corners of the overlap of two faces, or one point where two edges cross.
    - Unions: every part by itself.
    - Capsule and box, prism or capsule: the closest point, and the far end of the part of the capsule that lies over
      the closest face or beside the other capsule.
    - Ellipsoid and any other convex solid: the closest point.
    - Any other pair: of the corners, edges, rims and axes of each solid in the distance of the other the deepest point,
      and around it up to six that are farthest out, no higher above the other solid than at a slope of 0.02.

    The faces or edges of boxes and prisms are those along whose normal the solids are farthest apart, or overlap least
    (separating axes). Of solids that overlap, the smallest gap of the active points is how far they must be moved to
    part, negated. Of solids apart it is their distance, if they are closest at a corner and within a face or within two
    edges; where they are closest at two corners, or at a corner and within an edge, all points are farther apart, or
    there is none. Edges whose common normal is within 0.02 rad of that of a face count as faces, or bars that lie
    crosswise would rock on one point; the gap is then too large by up to 2e-4 of itself.

    The gaps of spheres and capsules are exact, unless the axis of a capsule enters the other solid. Those of ellipsoids
    and cylinders are as exact for solids that are apart or overlap little, but where the rim of a cylinder crosses an
    edge: to it the edges of boxes, prisms and cylinders are rounded by a hundredth of their smallest half size, and the
    gap is too large by up to 0.42 of that radius at right angles. Rims lie on faces with the corners of a hexagon; what
    lies over the end of a face touches up to that radius before it, with a normal that leans by 0.005 rad.

    Meshes touch with their vertices, a thousand at most, heightfields with their nodes, exactly within one spacing; of
    what touches these, corners, twelve points of a rim and nine of an edge are looked at. Where an edge crosses one of
    a mesh or heightfield between them, contact begins late.

    Points and gaps are differentiable in poses and sizes, with one-sided derivatives where other features begin to
    touch.

    **Arguments**: `first`, `second`, in one frame, `Placed` or at its origin.

    **Returns**: the points in that frame, always as many for two kinds of shapes.

    **Errors**: `ValueError` for two things that cannot move (planes, heightfields); see [`manifold_size`].
    """
    (a, X), (b, Y) = _unplaced(first), _unplaced(second)
    if isinstance(a, Union):
        return joined([contact_manifold(Placed(part, X), second) for part in a.parts])
    if isinstance(b, Union):
        return joined([contact_manifold(first, Placed(part, Y)) for part in b.parts])
    contact, exchanged = _contact_of(a, b)
    if contact is None:
        raise ValueError(f"contact of a {type(a).__name__} with a {type(b).__name__} is not implemented")
    if exchanged:
        return contact(b, Placed(a, Y.inverse() @ X)).moved(Y).exchanged()
    return contact(a, Placed(b, X.inverse() @ Y)).moved(X)


def manifold_size(first: Shape, second: Shape) -> int:
    """How many points the contact of two solids has, active or not; zero where it is not implemented."""
    if not _implemented(first, second):
        return 0
    return jax.eval_shape(contact_manifold, first, second).gap.shape[0]


def _implemented(first: Shape, second: Shape) -> bool:
    a, b = _unplaced(first)[0], _unplaced(second)[0]
    if isinstance(a, Union) or isinstance(b, Union):
        parts = [shape.parts if isinstance(shape, Union) else (shape,) for shape in (a, b)]
        return all(_implemented(one, other) for one in parts[0] for other in parts[1])
    return _contact_of(a, b)[0] is not None


def _contact_of(first: Shape, second: Shape) -> tuple[Callable[[Any, Placed], Manifold] | None, bool]:
    """Of a shape at the origin and one that is placed; and whether they have to be exchanged."""
    pairs = ((first, second, False), (second, first, True))
    for find in (_special, _general):
        for one, two, exchanged in pairs:
            contact = find(one, two)
            if contact is not None:
                return contact, exchanged
    return None, False


def _special(first: Shape, second: Shape) -> Callable[[Any, Placed], Manifold] | None:
    if isinstance(first, Sphere):
        return _ball_contact
    if isinstance(second, Plane) and isinstance(first, _CONVEX):
        return _plane_contact
    if isinstance(first, Box | Prism) and isinstance(second, Box | Prism):
        return polytope_contact
    if isinstance(first, Capsule) and isinstance(second, Box | Prism | Capsule):
        return capsule_contact
    return None


def _general(first: Shape, second: Shape) -> Callable[[Any, Placed], Manifold] | None:
    movable = (*_CONVEX, Mesh)
    if isinstance(first, movable) and isinstance(second, (*movable, Heightfield)):
        return general_contact
    return general_contact if isinstance(first, Mesh) and isinstance(second, Plane) else None


_CONVEX = (Box, Prism, Capsule, Cylinder, Ellipsoid)


def _ball_contact(first: Sphere, second: Placed) -> Manifold:
    centre = jnp.zeros(3, first.radius.dtype)
    normal, gap = second.normal(centre)[None], second.signed_distance(centre) - first.radius
    return Manifold(-first.radius * normal, normal, gap[None], jnp.ones(1, bool))


def _plane_contact(first: Shape, second: Placed) -> Manifold:
    normal = second.normal(second.pose.position)
    centre, radius = first.probes(-normal)
    normal = jnp.broadcast_to(normal, centre.shape)
    gap = jax.vmap(second.signed_distance)(centre) - radius
    return Manifold(centre - radius[:, None] * normal, normal, gap, jnp.ones(gap.shape, bool))


def _unplaced(shape: Shape) -> tuple[Shape, Pose]:
    if isinstance(shape, Placed):
        core, pose = _unplaced(shape.shape)
        return core, shape.pose @ pose
    dtype = jnp.result_type(*jax.tree.leaves(shape))
    return shape, Pose(np.eye(3, dtype=dtype), np.zeros(3, dtype))
