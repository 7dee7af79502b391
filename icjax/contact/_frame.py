"""A right-handed contact frame for every unit normal."""

import jax.numpy as jnp

from icjax.typing import Matrix3, Vector3


def contact_frame(normal: Vector3) -> Matrix3:
    """Right-handed orthonormal frame ``(n, t1, t2)``, as columns, whose first axis is the normal.

    No tangent field is continuous on the whole sphere. This one is smooth but for a jump of the tangents across
    the circle ``n_z = -1/2``; it has no singular point (its divisor ``|n_z + s|`` is at least 1/2), so its derivatives
    are finite everywhere, on that circle one-sided. Normals of floors and walls, ``n_z >= 0``, are far from the jump.
    With the facets' polygon turning with the tangents, forces differ across it by the error of the facets.

    **Arguments**: `normal` `[3]`, unit length (not checked), world.

    **Returns**: `[3, 3]`, columns normal, tangent 1, tangent 2.

    **Source**: Duff et al. (2017), *Building an Orthonormal Basis, Revisited*, with the jump moved off the equator.
    """
    x, y, z = normal[0], normal[1], normal[2]
    sign = jnp.where(z > -0.5, 1.0, -1.0).astype(jnp.result_type(normal))
    a = -1.0 / (sign + z)
    b = x * y * a
    first = jnp.stack([1.0 + sign * x * x * a, sign * b, -sign * x])
    second = jnp.stack([b, sign + y * y * a, -y])
    return jnp.stack([jnp.asarray(normal), first, second], axis=1)
