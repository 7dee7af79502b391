"""The polyhedral friction cone: matrices D, E, F of Eq. 8 and 9."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from icjax.typing import Float, Real, Scalar


class FrictionCone(eqx.Module):
    """The blocks of D, E and F, one a contact; `direction` = 2m + 1 with the normal first.

    **Fields**

    - `D`: unit directions `d_ij` as columns, world, `[contact, 3, direction]`; `d_i(2j-1) = -d_i(2j)`.
    - `E`: `(0, -1, ..., -1)`.
    - `F`: `(mu_i, -1, ..., -1)`.
    """

    D: Float[Real, "contact 3 direction"]
    E: Float[Real, "contact direction"]
    F: Float[Real, "contact direction"]


def friction_cone(frames: Float[Real, "contact 3 3"], friction: Float[Real, " contact"], facets: int) -> FrictionCone:
    """Friction cone with 2m facets, ``f = D beta, beta >= 0, F beta >= 0``.

    Tangents are ``d = cos(a) t1 + sin(a) t2`` at the angles ``a = pi k / m, k = 0 .. m-1``, each followed by its
    opposite. The polygon is inscribed in the circle of radius ``mu f_n``; between its corners it reaches
    ``cos(pi / 2m)`` of it.

    **Arguments**: `frames` `[N, 3, 3]` (columns normal, tangent 1, tangent 2), `friction` `[N]`, `facets` the m >= 2.

    **Errors**: `ValueError` for fewer than two facet pairs.

    **Source**: Kry and Pai (2006), Section 7.1.1, Eq. 8 and 9.
    """
    directions = jnp.asarray(tangents(facets), jnp.result_type(frames))
    count = 2 * facets
    D = jnp.concatenate([frames[:, :, :1], frames[:, :, 1:] @ directions.T], axis=2)
    ones = -jnp.ones((frames.shape[0], count), D.dtype)
    E = jnp.concatenate([jnp.zeros((frames.shape[0], 1), D.dtype), ones], axis=1)
    F = jnp.concatenate([jnp.asarray(friction, D.dtype)[:, None], ones], axis=1)
    return FrictionCone(D=D, E=E, F=F)


def gauge(tangential: Float[Real, "2"], facets: int) -> Scalar:
    """Smallest sum of beta that makes a tangential force: ``min sum(beta), D_* beta = f_t, beta >= 0``.

    It is the gauge (Minkowski functional) of the polygon with corners at the unit tangents, so a force lies in the cone
    where ``gauge(f_t) <= mu f_n``.

    **Arguments**: `tangential` `[2]`, components along tangent 1 and tangent 2; `facets` the m >= 2.
    """
    angles = (np.arange(2 * _checked(facets)) + 0.5) * np.pi / facets
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1) / np.cos(0.5 * np.pi / facets)
    return jnp.max(jnp.asarray(normals, jnp.result_type(tangential)) @ tangential)


def tangents(facets: int) -> np.ndarray:
    """Unit tangents in the tangent plane `[2m, 2]`, opposite pairs together."""
    angles = np.arange(_checked(facets)) * np.pi / facets
    half = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.stack([half, -half], axis=1).reshape(-1, 2)


def _checked(facets: int) -> int:
    if facets < 2:
        raise ValueError(f"facets must be at least 2 (pairs of tangents); got {facets}")
    return facets
