# pyright: reportGeneralTypeIssues=false
# (the checker does not see that `labelled`, `names` and `static` declare fields without a default)
"""The articulated body: static topology, traced numbers."""

import equinox as eqx
import numpy as np

from icjax.files import labelled, names, optional, static
from icjax.typing import Float, Real

POSITION_SIZE = {"hinge": 1, "slide": 1, "ball": 4, "free": 7}
VELOCITY_SIZE = {"hinge": 1, "slide": 1, "ball": 3, "free": 6}


class Model(eqx.Module):
    """Kinematic tree with hinge, slide, ball and free joints.

    Body 0 is the world. A body's joints act in the order of the joint table; a body without joints is fixed to
    its parent. Every number is a differentiable leaf; names and topology are static.

    Coordinates `q` (size `nq`): hinge rad, slide m, ball unit quaternion (w, x, y, z) of the joint rotation, free
    position (m, world) followed by unit quaternion (w, x, y, z) of the body.

    Velocities `v` and displacements `dq` (size `nv`): hinge rad/s, slide m/s, ball angular velocity in body
    coordinates, free the spatial velocity (angular, linear) in body coordinates, the phi of Eq. 3.

    **Fields**: see each declaration; `compliance` is infinite where the source states no spring and zero where
    the coordinate is driven.
    """

    name: str = static()
    body_names: tuple[str, ...] = names("body")
    body_parents: tuple[int, ...] = static()
    joint_names: tuple[str, ...] = names("joint")
    joint_types: tuple[str, ...] = static()
    joint_bodies: tuple[int, ...] = static()
    site_names: tuple[str, ...] = names("site")
    site_bodies: tuple[int, ...] = static()
    pad_names: tuple[str, ...] = names("pad")
    pad_bodies: tuple[int, ...] = static()

    body_position: Float[Real, "body 3"] = labelled(
        "body", "axis", unit="m", doc="origin of the body frame in its parent at zero joint displacement"
    )
    body_rotation: Float[Real, "body 3 3"] = labelled(
        "body", "axis", "axis2", unit="1", doc="rotation from body to parent at zero joint displacement"
    )
    body_mass: Float[Real, " body"] = labelled("body", unit="kg")
    body_com: Float[Real, "body 3"] = labelled("body", "axis", unit="m", doc="centre of mass, body frame")
    body_inertia: Float[Real, "body 3 3"] = labelled(
        "body", "axis", "axis2", unit="kg m2", doc="rotational inertia about the centre of mass, body axes"
    )
    joint_position: Float[Real, "joint 3"] = labelled("joint", "axis", unit="m", doc="anchor, body frame")
    joint_axis: Float[Real, "joint 3"] = labelled("joint", "axis", unit="1", doc="unit axis, body frame")
    zero: Float[Real, " coordinate"] = labelled(
        "coordinate", unit="rad or m", doc="coordinates at which the joint displacement is zero"
    )
    rest: Float[Real, " coordinate"] = labelled(
        "coordinate", unit="rad or m", doc="coordinates at which the springs are slack"
    )
    lower: Float[Real, " coordinate"] = labelled("coordinate", unit="rad or m", doc="lower limit, -inf if none")
    upper: Float[Real, " coordinate"] = labelled("coordinate", unit="rad or m", doc="upper limit, inf if none")
    compliance: Float[Real, " dof"] = labelled("dof", unit="rad/Nm or m/N", doc="inverse joint stiffness")
    damping: Float[Real, " dof"] = labelled("dof", unit="Nm s/rad or N s/m")
    armature: Float[Real, " dof"] = labelled("dof", unit="kg m2 or kg", doc="inertia added to the diagonal")
    site_position: Float[Real, "site 3"] = labelled("site", "axis", unit="m", doc="marker site, body frame")
    pad_centre: Float[Real, "pad 3"] = labelled(
        "pad", "axis", unit="m", doc="centre of the ball or capsule, body frame"
    )
    pad_radius: Float[Real, " pad"] = labelled("pad", unit="m")
    pad_compliance: Float[Real, " pad"] = labelled("pad", unit="m/N", doc="soft pad between bone and surface")
    gravity: Float[Real, "3"] = labelled("axis", unit="m/s2")
    pad_axis: Float[Real, "pad 3"] | None = optional(
        "pad", "axis", unit="m", doc="from the centre of a capsule to that of its end, body frame; zero of a ball"
    )
    capsule_pads: tuple[int, ...] = static(default=())  # the others are balls

    def __check_init__(self):
        """**Errors**: `ValueError` for a topology that is none, or arrays that do not fit it."""
        problem = _topology_problem(self)
        if problem:
            raise ValueError(f"model {self.name!r}: {problem}")

    @property
    def nq(self) -> int:
        """Number of coordinates."""
        return sum(POSITION_SIZE[kind] for kind in self.joint_types)

    @property
    def nv(self) -> int:
        """Number of degrees of freedom."""
        return sum(VELOCITY_SIZE[kind] for kind in self.joint_types)

    @property
    def dof_names(self) -> tuple[str, ...]:
        """A name for each degree of freedom: the joint's own, with a suffix where the joint has several."""
        suffixes = {
            "hinge": ("",),
            "slide": ("",),
            "ball": ("_x", "_y", "_z"),
            "free": ("_rx", "_ry", "_rz", "_x", "_y", "_z"),
        }
        return tuple(
            name + suffix
            for name, kind in zip(self.joint_names, self.joint_types, strict=True)
            for suffix in suffixes[kind]
        )

    @property
    def pad_types(self) -> tuple[str, ...]:
        """Of each pad "ball" or "capsule"."""
        return tuple("capsule" if pad in self.capsule_pads else "ball" for pad in range(len(self.pad_names)))

    @property
    def coordinate_slices(self) -> tuple[slice, ...]:
        """Slice of `q` for each joint."""
        return _slices([POSITION_SIZE[kind] for kind in self.joint_types])

    @property
    def dof_slices(self) -> tuple[slice, ...]:
        """Slice of `v` for each joint."""
        return _slices([VELOCITY_SIZE[kind] for kind in self.joint_types])

    @property
    def path_mask(self) -> np.ndarray:
        """The binary matrices S_i of Eq. 4, one row a body: `[body, dof]`, 1 on the path from the body to the root."""
        mask = np.zeros((len(self.body_names), self.nv))
        for body, parent in enumerate(self.body_parents):
            if body > 0:
                mask[body] = mask[parent]
            for joint_body, dofs in zip(self.joint_bodies, self.dof_slices, strict=True):
                if joint_body == body:
                    mask[body, dofs] = 1.0
        return mask

    def body(self, name: str) -> int:
        """Index of a body. **Errors**: `ValueError` naming the unknown body and the known ones."""
        return _index("body", name, self.body_names)

    def joint(self, name: str) -> int:
        """Index of a joint. **Errors**: `ValueError` naming the unknown joint and the known ones."""
        return _index("joint", name, self.joint_names)

    def site(self, name: str) -> int:
        """Index of a site. **Errors**: `ValueError` naming the unknown site and the known ones."""
        return _index("site", name, self.site_names)

    def pad(self, name: str) -> int:
        """Index of a contact pad. **Errors**: `ValueError` naming the unknown pad and the known ones."""
        return _index("pad", name, self.pad_names)


def _slices(sizes: list[int]) -> tuple[slice, ...]:
    stops = np.cumsum([0, *sizes])
    return tuple(slice(int(a), int(b)) for a, b in zip(stops[:-1], stops[1:], strict=True))


def _index(kind: str, name: str, known: tuple[str, ...]) -> int:
    if name not in known:
        raise ValueError(f"unknown {kind} {name!r}; the model has {', '.join(known) or 'none'}")
    return known.index(name)


def _topology_problem(model: Model) -> str | None:
    """What contradicts itself in names, parents and sizes, None if nothing does."""
    bodies = len(model.body_names)
    for body, parent in enumerate(model.body_parents):
        if parent not in (range(body) if body else (-1, 0)):
            return f"body_parents: the parent of body {body} is {parent}, none before it"
    for name, kind in zip(model.joint_names, model.joint_types, strict=False):
        if kind not in POSITION_SIZE:
            return f"joint_types: {kind!r} of joint {name!r} is none of {', '.join(POSITION_SIZE)}"
    for kind in ("joint", "site", "pad"):
        for name, body in zip(getattr(model, f"{kind}_names"), getattr(model, f"{kind}_bodies"), strict=False):
            if body not in range(bodies):
                return f"{kind}_bodies: {kind} {name!r} is on body {body} of {bodies}"
    for pad in model.capsule_pads:
        if pad not in range(len(model.pad_names)) or model.pad_axis is None:
            return f"capsule_pads: pad {pad} is none, or pad_axis is not stated"
    if model.pad_axis is not None and np.shape(model.pad_axis) != (len(model.pad_names), 3):
        return f"pad_axis is {list(np.shape(model.pad_axis))}, not [{len(model.pad_names)}, 3]"
    sizes = {
        "body_parents": bodies,
        "body_position": bodies,
        "body_mass": bodies,
        "joint_types": len(model.joint_names),
        "joint_bodies": len(model.joint_names),
        "joint_axis": len(model.joint_names),
        "zero": model.nq,
        "lower": model.nq,
        "compliance": model.nv,
        "site_bodies": len(model.site_names),
        "site_position": len(model.site_names),
        "pad_bodies": len(model.pad_names),
        **{f"pad_{name}": len(model.pad_names) for name in ("centre", "radius", "compliance")},
    }
    for field, size in sizes.items():
        value = getattr(model, field)
        found = len(value) if isinstance(value, tuple) else (np.shape(value) or (None,))[0]
        if found != size:
            return f"{field} has {found} entries, not {size}"
    return None
