"""Free rigid objects: what they are, and how they move over a step."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.geometry import MassProperties, Shape
from icjax.spatial import (
    Pose,
    left_jacobian_inverse,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_to_rotation,
    rotation_to_quaternion,
    skew,
)
from icjax.synthesis._bodies import Admittance
from icjax.synthesis._surface import FARTHEST, check_number, check_rotation, check_size, check_solid, described, known
from icjax.typing import Float, Matrix3, Real, Scalar, Vector3

_ITERATIONS = 4  # of Newton's method for the spin; each leaves (h omega)^2 / 6 of its error


class Object(eqx.Module):
    """A rigid body: free, or driven along a path (`Target.path`) whatever it meets; without a path it stays.

    **Arguments**

    - `name`; `shape` in the frame of the body; `friction` Coulomb's coefficient with the pads.
    - `mass` kg, or `density` kg/m3: one of them, none of a driven object.
    - `com` centre of mass, m, and `inertia` about it, kg m2, both in the frame of the body; by default those of the
      shape, filled evenly.
    - `pose` of its frame in the world at the start, `velocity` of its centre of mass (m/s) and `angular_velocity`
      (rad/s) then, world axes; default at rest at the origin.
    - `driven`: it goes where it is told to.

    **Errors**: `ValueError` for a mass that is not positive, an inertia that no body has, an impossible shape or
    friction, numbers that are not finite or too few; `TypeError` for what is no shape or pose.
    """

    name: str = eqx.field(static=True)
    shape: Shape
    friction: Scalar
    mass: Scalar
    com: Vector3
    inertia: Matrix3
    pose: Pose
    velocity: Vector3
    angular_velocity: Vector3
    driven: bool = eqx.field(static=True)

    def __init__(
        self,
        name: str,
        shape: Shape,
        friction: Any,
        *,
        mass: Any = None,
        density: Any = None,
        com: Any = None,
        inertia: Any = None,
        pose: Pose | None = None,
        velocity: Any = (0.0, 0.0, 0.0),
        angular_velocity: Any = (0.0, 0.0, 0.0),
        driven: bool = False,
    ):
        if driven and not (mass is None and density is None and inertia is None):
            raise ValueError(f"object {name!r}: a driven object has no mass; got {mass or density or inertia}")
        if driven and (np.any(known(velocity)) or np.any(known(angular_velocity))):
            raise ValueError(f"object {name!r}: a driven object has no velocity of its own, only a path")
        if not driven and (mass is None) == (density is None):
            raise ValueError(f"object {name!r}: give its mass (kg) or its density (kg/m3)")
        if not isinstance(shape, Shape):
            raise TypeError(f"object {name!r}: {shape!r} is no shape of icjax.geometry")
        if pose is not None and not isinstance(pose, Pose):
            raise TypeError(f"object {name!r}: its pose must be an icjax.spatial.Pose; got {pose!r}")
        check_number(f"object {name!r}: friction", friction)
        if driven:  # nothing that follows depends on the numbers
            even, mass = MassProperties(jnp.ones(()), jnp.zeros(3), jnp.eye(3)), 1.0
        else:
            stated: Any = density if mass is None else mass
            check_number(f"object {name!r}: {'density' if mass is None else 'mass'}", stated)
            even = shape.mass_properties()
            mass = stated * even.volume if mass is None else mass
        self.name, self.shape = name, shape
        self.friction, self.mass = jnp.asarray(friction, float), jnp.asarray(mass, float)
        self.com = jnp.asarray(even.com if com is None else com, float)
        self.inertia = jnp.asarray(self.mass / even.volume * even.inertia if inertia is None else inertia, float)
        self.pose = Pose.identity() if pose is None else jax.tree.map(lambda x: jnp.asarray(x, float), pose)
        self.velocity, self.angular_velocity = jnp.asarray(velocity, float), jnp.asarray(angular_velocity, float)
        self.driven = driven

    def __check_init__(self):
        what = f"object {self.name!r}"
        check_solid(what, self.shape, self.friction)
        sizes = {"mass": (), "com": (3,), "inertia": (3, 3), "velocity": (3,), "angular_velocity": (3,)}
        for name, size in sizes.items():
            check_size(f"{what}: {name}", getattr(self, name), size)
            value = known(getattr(self, name))
            if value is not None and not np.isfinite(value).all():
                raise ValueError(f"{what}: {name} must be finite; got {value.tolist()}")
        mass, inertia = known(self.mass), known(self.inertia)
        if mass is not None and not mass > 0:
            raise ValueError(f"{what}: mass must be positive; got {mass} kg")
        if inertia is not None:
            _check_inertia(what, inertia)
        check_size(f"{what}: its position", self.pose.position, (3,))
        check_rotation(f"{what}: its rotation", self.pose.rotation)
        position = known(self.pose.position)
        if position is not None and not (np.abs(position) <= FARTHEST).all():
            raise ValueError(f"{what}: its position must be within {FARTHEST:g} m; got {position.tolist()}")

    def describe(self) -> dict[str, Any]:
        """Its numbers, for JSON."""
        names = ("friction",) if self.driven else ("friction", "mass", "com", "inertia")
        listed = {name: np.asarray(getattr(self, name)).tolist() for name in names}
        return {"name": self.name, "driven": self.driven, **listed, **described(self.shape)}


class Motion(NamedTuple):
    """How an object moves: pose of its frame, velocity of its centre of mass, angular momentum about it; world."""

    position: Float[Real, "*object 3"]
    quaternion: Float[Real, "*object 4"]
    velocity: Float[Real, "*object 3"]
    angular_momentum: Float[Real, "*object 3"]

    def pose(self) -> Pose:
        """Of one object."""
        return Pose(quaternion_to_rotation(self.quaternion), self.position)


def at_start(item: Object) -> Motion:
    """As the object states it."""
    R = item.pose.rotation
    momentum = R @ (item.inertia @ (R.T @ item.angular_velocity))
    return Motion(item.pose.position, rotation_to_quaternion(R), item.velocity, momentum)


def object_admittance(
    item: Object, motion: Motion, gravity: Vector3, wrench: Float[Real, "6"], path: Float[Real, "7"] | None, h: float
) -> Admittance:
    """Of a free object [`rigid_admittance`]; a driven one moves to `path` (None: stays) and yields to nothing."""
    if not item.driven:
        return rigid_admittance(item, motion, gravity, wrench, h)
    dtype = motion.position.dtype
    if path is None:
        return Admittance(free=jnp.zeros(6, dtype), matrix=jnp.zeros((6, 6), dtype))
    there = path[3:] / jnp.sqrt(jnp.sum(path[3:] ** 2))
    turn = quaternion_multiply(there, motion.quaternion * jnp.array([1.0, -1.0, -1.0, -1.0], dtype))
    centre = motion.pose().apply(item.com)
    moved = path[:3] + quaternion_to_rotation(there) @ item.com - centre
    return Admittance(free=jnp.concatenate([quaternion_log(turn), moved]), matrix=jnp.zeros((6, 6), dtype))


def rigid_admittance(item: Object, motion: Motion, gravity: Vector3, wrench: Float[Real, "6"], h: float) -> Admittance:
    r"""Rigid body over one step: rotation vector and displacement of the centre of mass, world axes.

    Position: $h (v + h (g + f / m))$. Rotation: $h\,\omega$ with the $\omega$ that carries the angular momentum
    $L + h \tau$ through a rotation by $h\,\omega$ (Moser and Veselov's discrete rigid body), so that momentum is kept
    exactly and energy does not drift. Admittance: $h^2 I^{-1}$ and $h^2 / m$. To first order in h this is the paper's
    Euler step of Eq. 3 in body coordinates.

    **Arguments**: `wrench` (torque about the centre of mass, force), without gravity, Nm and N; `h` s.

    **Source**: Kry and Pai (2006), Section 7.1.2; Moser and Veselov (1991), Commun. Math. Phys. 139, 217.
    """
    R = quaternion_to_rotation(motion.quaternion)
    inverse = inverse_of(item.inertia)
    momentum = R.T @ (motion.angular_momentum + h * wrench[:3])
    spin = R @ _spin(item.inertia, inverse, momentum, h)
    velocity = motion.velocity + h * (gravity + wrench[3:] / item.mass)
    zero = jnp.zeros((3, 3), spin.dtype)
    eye = jnp.eye(3, dtype=spin.dtype)
    matrix = jnp.block([[R @ inverse @ R.T, zero], [zero, eye / item.mass]])
    return Admittance(free=h * jnp.concatenate([spin, velocity]), matrix=h * h * matrix)


def advanced(item: Object, motion: Motion, moved: Float[Real, "6"], wrench: Float[Real, "6"], h: float) -> Motion:
    """After the displacement `moved`, under the wrench of contacts and all else but gravity."""
    R = quaternion_to_rotation(motion.quaternion)
    centre = motion.position + R @ item.com + moved[3:]
    quaternion = quaternion_multiply(quaternion_exp(moved[:3]), motion.quaternion)
    quaternion = quaternion / jnp.sqrt(jnp.sum(quaternion**2))
    position = centre - quaternion_to_rotation(quaternion) @ item.com
    momentum = motion.angular_momentum if item.driven else motion.angular_momentum + h * wrench[:3]
    return Motion(position, quaternion, moved[3:] / h, momentum)


def _spin(inertia: Matrix3, inverse: Matrix3, momentum: Vector3, h: float) -> Vector3:
    """omega of ``J(h omega)^-T I omega = momentum``, body axes, J the left Jacobian of the exponential map.

    By Newton's method with the derivative of J's first two terms.
    """
    omega = inverse @ momentum
    for _ in range(_ITERATIONS):
        carried = inertia @ omega
        slope = inertia + 0.5 * h * (skew(omega) @ inertia - skew(carried))
        omega = omega + inverse_of(slope) @ (momentum - left_jacobian_inverse(h * omega).T @ carried)
    return omega


def inverse_of(matrix: Matrix3) -> Matrix3:
    """Of an invertible 3 x 3 matrix, by cross products: a library's factorisation costs more than the step."""
    a, b, c = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    rows = jnp.stack([jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)])
    return rows / jnp.dot(a, jnp.cross(b, c))


def _check_inertia(what: str, inertia: np.ndarray) -> None:
    if not np.allclose(inertia, inertia.T, rtol=0, atol=1e-9 * np.abs(inertia).max()):
        raise ValueError(f"{what}: inertia must be symmetric; got {inertia.tolist()}")
    moments = np.linalg.eigvalsh(inertia)
    if not (moments[0] > 0 and moments[0] + moments[1] >= (1 - 1e-9) * moments[2]):
        raise ValueError(
            f"{what}: no body has the principal moments {', '.join(f'{x:.3g}' for x in moments)} kg m2: each must be "
            "positive and no more than the sum of the others"
        )
