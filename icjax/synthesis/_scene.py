"""The environment: named surfaces with friction, and how finely to step."""

import json

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from icjax.geometry import Ellipsoid, Plane
from icjax.typing import Float, Real

MOST_FRICTION = 20.0
"""Rubber on rubber reaches 2; far above that the cone degenerates and the complementarity problem with it."""

FARTHEST = 1e3
"""m; no surface of a laboratory lies farther from the origin or is larger."""

SMALLEST = 1e-6
"""m; a smaller radius is no surface that a fingertip feels."""

SHORTEST_STEP = 1e-6
"""s; a millisecond of contact would take a thousand steps."""


class Surface(eqx.Module):
    """A fixed surface.

    **Fields**: `name`; `shape` with `signed_distance`, `closest_point` and `normal`; `friction` its Coulomb
    coefficient with the pads.

    **Errors**: `ValueError` for a friction outside 0 to 20, radii below a micrometre, or a place or size that is not
    finite or beyond a kilometre.
    """

    name: str = eqx.field(static=True)
    shape: Plane | Ellipsoid
    friction: Float[Real, ""] = eqx.field(converter=lambda value: jnp.asarray(value, float))

    def __check_init__(self):
        if not _concrete(self.friction):
            return
        if not 0 <= self.friction <= MOST_FRICTION:
            raise ValueError(f"surface {self.name!r}: friction must be 0 to {MOST_FRICTION:g}; got {self.friction}")
        numbers = {name: np.asarray(value, float) for name, value in vars(self.shape).items() if _concrete(value)}
        for name, value in numbers.items():
            if not (np.abs(value) <= FARTHEST).all():
                raise ValueError(f"surface {self.name!r}: {name} must be within {FARTHEST:g} m; got {value.tolist()}")
        if "radii" in numbers and not (numbers["radii"] >= SMALLEST).all():
            radii = numbers["radii"].tolist()
            raise ValueError(f"surface {self.name!r}: radii must be positive, at least {SMALLEST:g} m; got {radii}")
        if "normal_direction" in numbers and not np.any(numbers["normal_direction"]):
            raise ValueError(f"surface {self.name!r}: normal must not be zero")


class Scene(eqx.Module):
    """Surfaces that the pads of a model may touch, every pad every surface.

    A bump on a plate is two surfaces, a plane and an ellipsoid.

    **Fields**: `name`; `surfaces`; `facets` the number m of tangent pairs of the friction cone (2m facets);
    `step` the time step h, s.

    **Errors**: `ValueError` for no surface, two of one name, fewer than two facets, or a step below a microsecond.
    """

    name: str = eqx.field(static=True)
    surfaces: tuple[Surface, ...]
    facets: int = eqx.field(static=True, default=4)
    step: float = eqx.field(static=True, default=0.002)

    def __check_init__(self):
        names = [surface.name for surface in self.surfaces]
        if not names:
            raise ValueError("surfaces is empty; a scene needs at least one")
        if len(set(names)) != len(names):
            raise ValueError(f"surfaces have one name twice: {', '.join(names)}")
        if self.facets < 2:
            raise ValueError(f"facets must be at least 2 (pairs of tangents); got {self.facets}")
        if not (self.step >= SHORTEST_STEP and np.isfinite(self.step)):
            raise ValueError(f"step must be a positive time of at least {SHORTEST_STEP:g} s; got {self.step}")

    def describe(self) -> str:
        """JSON text with every number of the scene, as kept in a rollout."""
        return json.dumps(
            {
                "name": self.name,
                "step": self.step,
                "facets": self.facets,
                "surfaces": [
                    {"name": item.name, "friction": float(item.friction), **_numbers(item.shape)}
                    for item in self.surfaces
                ],
            }
        )


def _concrete(value) -> bool:
    return not isinstance(value, Tracer)


def _numbers(shape: Plane | Ellipsoid) -> dict:
    def listed(array):
        return np.asarray(array, float).tolist()

    if isinstance(shape, Plane):
        return {"shape": "plane", "point": listed(shape.point), "normal": listed(shape.normal(shape.point))}
    return {
        "shape": "ellipsoid",
        "centre": listed(shape.centre),
        "rotation": listed(shape.rotation),
        "radii": listed(shape.radii),
    }
