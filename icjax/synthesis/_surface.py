"""Fixed surfaces, and what every solid thing of a scene must satisfy."""

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from icjax.geometry import Ellipsoid, Heightfield, Mesh, Placed, Plane, Shape, Union
from icjax.typing import Float, Real

MOST_FRICTION = 20.0
"""Rubber on rubber reaches 2; far above that the cone degenerates and the complementarity problem with it."""

FARTHEST = 1e3
"""m; no surface of a laboratory lies farther from the origin or is larger."""

SMALLEST = 1e-6
"""m; a smaller radius is no surface that a fingertip feels."""

_SHAPES = {
    **dict.fromkeys(("radii", "half_sizes", "centre", "point", "normal_direction", "position"), (3,)),
    **dict.fromkeys(("radius", "half_length"), ()),
}
_SIZES = ("radii", "half_sizes", "radius", "half_length", "spacing")


class Surface(eqx.Module):
    """A fixed surface.

    **Fields**: `name`; `shape` in the world; `friction` its Coulomb coefficient with the pads.

    **Errors**: `ValueError` for a friction outside 0 to 20, sizes below a micrometre, or a place or size that is not
    finite or beyond a kilometre.
    """

    name: str = eqx.field(static=True)
    shape: Shape
    friction: Float[Real, ""] = eqx.field(converter=lambda value: jnp.asarray(value, float))

    def __check_init__(self):
        check_solid(f"surface {self.name!r}", self.shape, self.friction)


def known(value: Any) -> np.ndarray | None:
    """The numbers, None where they are traced. In NumPy, because JAX traces what is done with known numbers too."""
    return None if isinstance(value, Tracer) else np.asarray(value, float)


def check_solid(what: str, shape: Shape, friction: Real) -> None:
    """**Errors**: `ValueError` beginning with `what` for an impossible shape or friction, `TypeError` for no shape."""
    if not isinstance(shape, Shape):
        raise TypeError(f"{what}: {shape!r} is no shape of icjax.geometry")
    check_friction(f"{what}: friction", friction)
    if isinstance(shape, Placed):
        _check_numbers(what, {"position": shape.pose.position, "rotation": shape.pose.rotation})
        return check_solid(what, shape.shape, friction)
    if isinstance(shape, Union):
        for part in shape.parts:
            check_solid(what, part, friction)
        return None
    return _check_numbers(what, {field.name: getattr(shape, field.name) for field in dataclasses.fields(shape)})


def check_friction(what: str, friction: Real) -> None:
    """**Errors**: `ValueError` for what is no coefficient, or one that is known and impossible."""
    check_size(what, friction, ())
    value = known(friction)
    if value is not None and not 0 <= value <= MOST_FRICTION:
        raise ValueError(f"{what} must be 0 to {MOST_FRICTION:g}; got {value}")


def check_size(what: str, value: Any, size: tuple[int, ...]) -> None:
    """**Errors**: `ValueError` for an array of another size."""
    if np.shape(value) != size:
        wanted = " x ".join(map(str, size)) + " numbers" if size else "one number"
        raise ValueError(f"{what} must be {wanted}; got an array {list(np.shape(value))}")


def check_number(what: str, value: Any) -> None:
    """**Errors**: `TypeError` for text or nothing where a number is wanted, `ValueError` for an array."""
    if value is None or isinstance(value, str | bytes):
        raise TypeError(f"{what} must be one number; got {value!r}")
    check_size(what, value, ())


def check_rotation(what: str, rotation: Any) -> None:
    """**Errors**: `ValueError` for a matrix that is known and no rotation."""
    check_size(what, rotation, (3, 3))
    R = known(rotation)
    if R is not None and not (np.allclose(R @ R.T, np.eye(3), atol=1e-6) and np.linalg.det(R) > 0):
        raise ValueError(f"{what} is no rotation matrix: {R.tolist()}")


def _check_numbers(what: str, fields: dict[str, Any]) -> None:
    for name, value in fields.items():
        if name in _SHAPES:
            check_size(f"{what}: {name}", value, _SHAPES[name])
        value = known(value)
        if value is None:
            continue
        if not (np.abs(value) <= FARTHEST).all():
            raise ValueError(f"{what}: {name} must be within {FARTHEST:g} m; got {value.tolist()}")
        if name == "rotation":
            check_rotation(f"{what}: rotation", value)
        if name in _SIZES and not (value >= SMALLEST).all():
            raise ValueError(f"{what}: {name} must be positive, at least {SMALLEST:g} m; got {value.tolist()}")
        if name == "normal_direction" and not np.any(value):
            raise ValueError(f"{what}: normal must not be zero")


def described(shape: Shape) -> dict[str, Any]:
    """The shape in words and numbers, for JSON; where an ellipsoid or a plane is placed, its own numbers say."""
    if isinstance(shape, Union):
        return {"shape": "union", "parts": [described(part) for part in shape.parts]}
    if isinstance(shape, Placed):
        inner, pose = shape.shape, shape.pose
        if isinstance(inner, Placed):
            return described(Placed(inner.shape, pose @ inner.pose))
        if isinstance(inner, Union):
            return described(Union([Placed(part, pose) for part in inner.parts]))
        if isinstance(inner, Ellipsoid):
            return described(Ellipsoid(pose.apply(inner.centre), pose.rotation @ inner.rotation, inner.radii))
        if isinstance(inner, Plane):
            return described(Plane(pose.apply(inner.point), pose.rotation @ inner.normal_direction))
        return {**described(inner), "position": _listed(pose.position), "rotation": _listed(pose.rotation)}
    if isinstance(shape, Plane):
        return {"shape": "plane", "point": _listed(shape.point), "normal": _listed(shape.normal(shape.point))}
    if isinstance(shape, Mesh):
        return {"shape": "mesh", **_described_mesh(shape)}
    if isinstance(shape, Heightfield):
        numbers = {name: _listed(getattr(shape, name)) for name in ("heights", "spacing", "reach")}
        return {"shape": "heightfield", **numbers}
    numbers = {field.name: _listed(getattr(shape, field.name)) for field in dataclasses.fields(shape)}
    return {"shape": type(shape).__name__.lower(), **numbers}


def _described_mesh(shape: Mesh) -> dict[str, Any]:
    """Without the grid: the triangles, to a micrometre, and what a person would ask of it."""
    triangles = np.asarray(shape.triangles, float)
    vertices, faces = np.unique(np.round(triangles.reshape(-1, 3), 6), axis=0, return_inverse=True)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    numbers = {name: float(getattr(shape, name)) for name in ("spacing", "error", "volume")}
    bounds = {"lowest": _listed(low), "highest": _listed(high)}
    return {**numbers, **bounds, "vertices": vertices.tolist(), "faces": faces.reshape(-1, 3).tolist()}


def _listed(array: Any) -> Any:
    return np.asarray(array, float).tolist()
