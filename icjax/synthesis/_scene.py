"""What is touched: named surfaces and objects with friction, and how finely to step."""

import json

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from icjax.synthesis._object import Object
from icjax.synthesis._surface import Surface, check_friction, check_size, described, known
from icjax.typing import Scalar, Vector3

SHORTEST_STEP = 1e-6
"""s; a millisecond of contact would take a thousand steps."""


class PairFriction(eqx.Module):
    """Friction of two things that meet: `names` of pads, surfaces or objects, in either order; `friction` mu."""

    names: tuple[str, str] = eqx.field(static=True)
    friction: Scalar = eqx.field(converter=lambda value: jnp.asarray(value, float))

    def __check_init__(self):
        if len(set(self.names)) != 2:
            raise ValueError(
                f"friction is that of two different things; got the names {', '.join(map(repr, self.names))}"
            )
        check_friction(f"friction of {' and '.join(map(repr, self.names))}", self.friction)


class Scene(eqx.Module):
    """Surfaces and free objects; the pads of a model may touch all of them, objects the surfaces and each other.

    A bump on a plate is two surfaces, a plane and an ellipsoid. Contact of objects is that of
    [`contact_manifold`][icjax.geometry.contact_manifold]; a scene in which two things could meet that it does not know
    is refused when it is used.

    **Fields**

    - `name`; `surfaces`; `objects`, by default none.
    - `facets`: the number m of tangent pairs of the friction cone (2m facets).
    - `step`: the time step h, s.
    - `gravity`: on objects, m/s2; the quasi-static hand has no weight.
    - `contacts`: how many contacts a step has room for, by default all that are possible. With fewer, those that carry
      force keep their place and the nearest others get the rest; a step in which more touch says so (`crowded`).
    - `limits`: how many joint limits (hinges and slides that are not driven) a step has room for, the nearest ones.
    - `frictions`: of pairs ([`PairFriction`]) that differ from the rule: a pad has the friction of what it touches, of
      two other things the smaller one counts.

    **Errors**: `ValueError` for nothing to touch, two things of one name, friction of a pair that is not there,
    fewer than two facets, no room for a contact, or a step below a microsecond.
    """

    name: str = eqx.field(static=True)
    surfaces: tuple[Surface, ...]
    facets: int = eqx.field(static=True, default=4)
    step: float = eqx.field(static=True, default=0.002)
    objects: tuple[Object, ...] = ()
    gravity: Vector3 = eqx.field(
        default_factory=lambda: np.array([0.0, 0.0, -9.81]), converter=lambda value: jnp.asarray(value, float)
    )
    frictions: tuple[PairFriction, ...] = ()
    contacts: int | None = eqx.field(static=True, default=None)
    limits: int = eqx.field(static=True, default=4)

    def __check_init__(self):
        for field, kind in (("surfaces", Surface), ("objects", Object), ("frictions", PairFriction)):
            for item in _items(field, getattr(self, field)):
                if not isinstance(item, kind):
                    raise TypeError(f"{field} must be of {kind.__name__}; got {type(item).__name__}")
        names = [thing.name for thing in (*self.surfaces, *self.objects)]
        if not names:
            raise ValueError("surfaces is empty; a scene needs at least one, or an object")
        if len(set(names)) != len(names):
            raise ValueError(f"surfaces or objects have one name twice: {', '.join(names)}")
        if not isinstance(self.facets, int) or self.facets < 2:
            raise ValueError(f"facets must be at least 2 (pairs of tangents); got {self.facets}")
        if self.contacts is not None and not (isinstance(self.contacts, int) and self.contacts >= 1):
            raise ValueError(f"contacts must be a number of at least 1, or None for all; got {self.contacts}")
        if not isinstance(self.limits, int) or self.limits < 0:
            raise ValueError(f"limits must be a number of at least 0; got {self.limits}")
        if not isinstance(self.step, float | int):
            raise TypeError(f"step must be a number of seconds; got {self.step!r}")
        if not (self.step >= SHORTEST_STEP and np.isfinite(self.step)):
            raise ValueError(f"step must be a positive time of at least {SHORTEST_STEP:g} s; got {self.step}")
        for name in names:
            if not isinstance(name, str) or not name or "/" in name:
                raise ValueError(f"a surface or object must have a name without '/'; got {name!r}")
        check_size("gravity", self.gravity, (3,))
        gravity = known(self.gravity)
        if gravity is not None and not np.isfinite(gravity).all():
            raise ValueError(f"gravity must be finite; got {gravity.tolist()}")

    def friction_of(self, first: str, second: str) -> Scalar | None:
        """What `frictions` states for a pair, None if nothing."""
        stated = [pair.friction for pair in self.frictions if set(pair.names) == {first, second}]
        return stated[-1] if stated else None

    def describe(self) -> str:
        """JSON text with every number of the scene, as kept in a rollout."""
        content = {
            "name": self.name,
            "step": self.step,
            "facets": self.facets,
            "surfaces": [
                {"name": item.name, "friction": float(item.friction), **described(item.shape)} for item in self.surfaces
            ],
        }
        if self.contacts is not None:
            content["contacts"] = self.contacts
        if self.objects:
            content["gravity"] = np.asarray(self.gravity).tolist()
            content["objects"] = [item.describe() for item in self.objects]
        if self.frictions:
            content["frictions"] = [
                {"names": list(pair.names), "friction": float(pair.friction)} for pair in self.frictions
            ]
        return json.dumps(content)


def _items(field: str, value: object) -> tuple:
    if not isinstance(value, tuple):
        raise TypeError(f"{field} must be a tuple; got {type(value).__name__}")
    return value
