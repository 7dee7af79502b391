"""A model changed before it is used: sites and pads added, joints locked, a part cut out, left made of right."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from icjax.model._load import PAD_COMPLIANCE
from icjax.model._model import POSITION_SIZE, VELOCITY_SIZE, Model
from icjax.spatial import quaternion_to_rotation, rotation_exp
from icjax.typing import Float, Real

SHORTEST_AXIS = 1e-6
"""m."""

BY_BODY = ("body_position", "body_rotation", "body_mass", "body_com", "body_inertia")
BY_COORDINATE = ("zero", "rest", "lower", "upper")
BY_DOF = ("compliance", "damping", "armature")


def with_sites(model: Model, sites: Mapping[str, tuple[str, tuple[float, float, float]]]) -> Model:
    """The model with more marker sites.

    **Arguments**: `sites` body and place (m, body frame) by the new site's name.

    **Errors**: `ValueError` for a name that the model already has, or an unknown body.
    """
    for name in sites:
        if name in model.site_names:
            raise ValueError(f"site {name!r} exists already")
    places = np.array([place for _, place in sites.values()], dtype=float).reshape(-1, 3)
    return dataclasses.replace(
        model,
        site_names=(*model.site_names, *sites),
        site_bodies=(*model.site_bodies, *(model.body(body) for body, _ in sites.values())),
        site_position=np.concatenate([np.asarray(model.site_position).reshape(-1, 3), places]),
    )


def with_pads(
    model: Model,
    pads: Mapping[str, tuple],
    compliance: float = PAD_COMPLIANCE,
) -> Model:
    """The model with more contact pads, for a model file that has none where fingers touch.

    **Arguments**: `pads` by the new pad's name: body, centre (m, body frame) and radius (m) of a ball; of a capsule
    also the half axis, from its centre to that of one end (m, body frame). `compliance` of each, m/N.

    **Errors**: `ValueError` for a name that the model already has, an unknown body, a radius that is not positive, an
    axis that is zero or a compliance that is negative.
    """
    for name, pad in pads.items():
        if not isinstance(name, str) or not name or "/" in name:
            raise ValueError(f"a pad must have a name without '/'; got {name!r}")
        if name in model.pad_names:
            raise ValueError(f"pad {name!r} exists already")
        if len(pad) not in (3, 4):
            raise ValueError(
                f"pad {name!r} must be body, centre, radius and, of a capsule, axis; got {len(pad)} values"
            )
        _, centre, radius, *axis = pad
        for what, place in (("centre", centre), *(("axis", half) for half in axis)):
            if np.shape(place) != (3,) or not np.isfinite(np.asarray(place, float)).all():
                raise ValueError(f"{what} of pad {name!r} must be three finite numbers, m; got {place}")
        if not 0 < radius < np.inf:
            raise ValueError(f"radius of pad {name!r} is {radius} m; it must be above 0")
        if axis and not np.linalg.norm(axis[0]) > SHORTEST_AXIS:
            raise ValueError(f"axis of pad {name!r} is {list(axis[0])} m; it must not be zero")
    if not 0 <= compliance < np.inf:
        raise ValueError(f"compliance is {compliance} m/N; it must be 0 or more")
    centres = np.array([pad[1] for pad in pads.values()], dtype=float).reshape(-1, 3)
    axes = np.array([pad[3] if len(pad) > 3 else (0.0, 0.0, 0.0) for pad in pads.values()], dtype=float)
    before = len(model.pad_names)
    capsules = (*model.capsule_pads, *(before + at for at, pad in enumerate(pads.values()) if len(pad) > 3))
    return dataclasses.replace(
        model,
        pad_names=(*model.pad_names, *pads),
        pad_bodies=(*model.pad_bodies, *(model.body(pad[0]) for pad in pads.values())),
        pad_centre=np.concatenate([np.asarray(model.pad_centre).reshape(-1, 3), centres]),
        pad_radius=np.concatenate([np.asarray(model.pad_radius), [pad[2] for pad in pads.values()]]),
        pad_compliance=np.concatenate([np.asarray(model.pad_compliance), np.full(len(pads), compliance)]),
        pad_axis=np.concatenate([_axes(model), axes.reshape(-1, 3)]) if capsules else None,
        capsule_pads=capsules,
    )


def mirrored(model: Model) -> Model:
    """The model's mirror image in the x-z plane: the left hand of a right one.

    With M = diag(1, -1, 1) points become M p, frames M R M and axes of rotation -M a, so that hinges keep their
    coordinates: the same angles bring the image of the same posture. Free coordinates (p, w, x, y, z) become
    (M p, w, -x, y, -z), balls (w, -x, y, -z), their limits and slack coordinates alike. Names stay.
    """
    flip = np.array([1.0, -1.0, 1.0])
    turn = np.outer(flip, flip)
    slide = np.array([kind == "slide" for kind in model.joint_types], bool).reshape(-1, 1)
    axis = np.asarray(model.joint_axis).reshape(-1, 3)
    signs = {"hinge": [1], "slide": [1], "ball": [1, -1, 1, -1], "free": [*flip, 1, -1, 1, -1]}
    coordinates = np.array([sign for kind in model.joint_types for sign in signs[kind]], dtype=float)
    return dataclasses.replace(
        model,
        **{
            name: np.asarray(getattr(model, name)).reshape(-1, 3) * flip
            for name in ("body_position", "body_com", "joint_position", "site_position", "pad_centre")
        },
        **{name: np.asarray(getattr(model, name)) * turn for name in ("body_rotation", "body_inertia")},
        joint_axis=np.where(slide, axis * flip, -axis * flip),
        zero=np.asarray(model.zero) * coordinates,
        rest=np.asarray(model.rest) * coordinates,
        gravity=np.asarray(model.gravity) * flip,
        pad_axis=None if model.pad_axis is None else _axes(model) * flip,
    )


def joined(**models: Model) -> Model:
    """Several bodies as one model, a left and a right hand for example: `joined(left=mirrored(hand), right=hand)`.

    Names get the keyword in front ("left_thumb"); coordinates follow in the order of the arguments. Gravity and the
    name are those of the first.

    **Errors**: `ValueError` for no model, or names that two bodies, joints, sites or pads would share.
    """
    if not models:
        raise ValueError("joined needs at least one model")

    def renamed(kind: str) -> tuple[str, ...]:
        return tuple(f"{key}_{name}" for key, part in models.items() for name in getattr(part, f"{kind}_names"))

    for kind in ("body", "joint", "site", "pad"):
        names = renamed(kind)
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"joined: two {kind} names would be {twice[0]!r}; take other keywords")
    parts, first = list(models.values()), next(iter(models.values()))
    bodies = np.cumsum([0, *(len(part.body_names) - 1 for part in parts)])  # one world
    pads = np.cumsum([0, *(len(part.pad_names) for part in parts)])

    def shifted(kind: str) -> tuple[int, ...]:
        carriers = zip(bodies, (getattr(part, f"{kind}_bodies") for part in parts), strict=False)
        return tuple(body + int(before) if body else 0 for before, found in carriers for body in found)

    def stacked(name: str, skip: int = 0) -> np.ndarray:
        values = [np.asarray(getattr(part, name)) for part in parts]
        return np.concatenate([value[skip:] if at else value for at, value in enumerate(values)])

    capsules = tuple(pad + int(before) for before, part in zip(pads, parts, strict=False) for pad in part.capsule_pads)
    below = [name for key, part in models.items() for name in (f"{key}_{body}" for body in part.body_names[1:])]
    parents = [
        parent + int(before) if parent else 0
        for before, part in zip(bodies, parts, strict=False)
        for parent in part.body_parents[1:]
    ]
    by_pad = ("pad_centre", "pad_radius", "pad_compliance")
    return dataclasses.replace(
        first,
        body_names=(first.body_names[0], *below),
        body_parents=(first.body_parents[0], *parents),
        joint_names=renamed("joint"),
        joint_types=tuple(kind for part in parts for kind in part.joint_types),
        joint_bodies=shifted("joint"),
        site_names=renamed("site"),
        site_bodies=shifted("site"),
        pad_names=renamed("pad"),
        pad_bodies=shifted("pad"),
        **{name: stacked(name, skip=1) for name in BY_BODY},
        **{name: stacked(name) for name in ("joint_position", "joint_axis", "site_position", *by_pad)},
        **{name: stacked(name) for name in (*BY_COORDINATE, *BY_DOF)},
        pad_axis=np.concatenate([_axes(part) for part in parts]) if capsules else None,
        capsule_pads=capsules,
    )


def lock_joints(model: Model, joints: tuple[str, ...], q: Float[Real, " nq"] | None = None) -> Model:
    """The model with the named joints fixed at the coordinates `q` (default: where their displacement is zero).

    A locked joint X_2 is moved in front of the free joints of its body that act before it,

        X_1(q_1) X_2 = X_2 (X_2^-1 X_1(q_1) X_2),

    which turns their axes and moves their anchors, and is then part of the body's place in its parent.

    **Errors**: `ValueError` for an unknown joint.
    """
    locked = {model.joint(name) for name in joints}
    q = np.asarray(model.zero if q is None else q)
    rotation, position = np.array(model.body_rotation), np.array(model.body_position)
    axis, anchor = np.array(model.joint_axis), np.array(model.joint_position)
    for joint in sorted(locked):
        body = model.joint_bodies[joint]
        if model.joint_types[joint] == "free":
            part = model.coordinate_slices[joint]
            position[body] = q[part][:3]
            rotation[body] = np.asarray(quaternion_to_rotation(q[part][3:]))
            continue
        R, p = _displacement(model, joint, axis[joint], anchor[joint], q)
        before = [i for i in range(joint) if model.joint_bodies[i] == body and i not in locked]
        axis[before] = axis[before] @ R
        anchor[before] = (anchor[before] - p) @ R
        position[body] += rotation[body] @ p
        rotation[body] = rotation[body] @ R
    moved = dataclasses.replace(
        model, body_rotation=rotation, body_position=position, joint_axis=axis, joint_position=anchor
    )
    return _with_joints(moved, [joint for joint in range(len(model.joint_names)) if joint not in locked])


def part_of(model: Model, body: str, free_root: bool = True) -> Model:
    """A body with all that hangs on it, cut out of the model.

    **Arguments**: `body` the new root, with its own joints replaced by a free joint named "root"; with
    `free_root=False` it keeps its joints and its place is counted from the world.

    **Errors**: `ValueError` for an unknown body, or a body or joint that would have the name of the root twice.
    """
    root = model.body(body)
    kept = [root]
    for index in range(root + 1, len(model.body_names)):
        if model.body_parents[index] in kept:
            kept.append(index)
    number = {0: 0} | {old: new for new, old in enumerate(kept, start=1)}
    joints = [joint for joint, at in enumerate(model.joint_bodies) if at in kept and not (free_root and at == root)]
    sites = [index for index, at in enumerate(model.site_bodies) if at in kept]
    pads = [index for index, at in enumerate(model.pad_bodies) if at in kept]
    model = _with_joints(model, joints)
    rows = np.array([0, *kept])
    cut = dataclasses.replace(
        model,
        body_names=tuple(model.body_names[index] for index in rows),
        body_parents=(model.body_parents[0], 0, *(number[model.body_parents[index]] for index in kept[1:])),
        joint_bodies=tuple(number[at] for at in model.joint_bodies),
        site_names=tuple(model.site_names[index] for index in sites),
        site_bodies=tuple(number[model.site_bodies[index]] for index in sites),
        pad_names=tuple(model.pad_names[index] for index in pads),
        pad_bodies=tuple(number[model.pad_bodies[index]] for index in pads),
        **{name: np.asarray(getattr(model, name))[rows] for name in BY_BODY},
        site_position=np.asarray(model.site_position)[sites],
        **{name: np.asarray(getattr(model, name))[pads] for name in ("pad_centre", "pad_radius", "pad_compliance")},
        pad_axis=None if model.pad_axis is None else _axes(model)[pads],
        capsule_pads=tuple(new for new, old in enumerate(pads) if old in model.capsule_pads),
    )
    return _with_free_root(cut) if free_root else cut


def _axes(model: Model) -> np.ndarray:
    """Half axes of all pads, zero of balls."""
    balls = np.zeros((len(model.pad_names), 3))
    return balls if model.pad_axis is None else np.asarray(model.pad_axis).reshape(-1, 3)


def _displacement(
    model: Model, joint: int, axis: np.ndarray, anchor: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation of a hinge, slide or ball joint at `q`."""
    part = model.coordinate_slices[joint]
    kind = model.joint_types[joint]
    if kind == "slide":
        return np.eye(3), axis * (q[part.start] - np.asarray(model.zero)[part.start])
    if kind == "ball":
        R = np.asarray(quaternion_to_rotation(q[part]))
    else:
        R = np.asarray(rotation_exp(axis * (q[part.start] - np.asarray(model.zero)[part.start])))
    return R, anchor - R @ anchor


def _with_joints(model: Model, kept: list[int]) -> Model:
    """Only the joints with these numbers; what belonged to the others is left out."""
    coordinates = np.concatenate([np.arange(model.nq)[model.coordinate_slices[joint]] for joint in kept] or [[]])
    dofs = np.concatenate([np.arange(model.nv)[model.dof_slices[joint]] for joint in kept] or [[]])
    return dataclasses.replace(
        model,
        joint_names=tuple(model.joint_names[joint] for joint in kept),
        joint_types=tuple(model.joint_types[joint] for joint in kept),
        joint_bodies=tuple(model.joint_bodies[joint] for joint in kept),
        joint_position=np.asarray(model.joint_position)[kept],
        joint_axis=np.asarray(model.joint_axis)[kept],
        **{name: np.asarray(getattr(model, name))[coordinates.astype(int)] for name in BY_COORDINATE},
        **{name: np.asarray(getattr(model, name))[dofs.astype(int)] for name in BY_DOF},
    )


def _with_free_root(model: Model) -> Model:
    """A driven free joint named "root" in front of all joints, at body 1."""
    if "root" in model.joint_names:
        raise ValueError("joint 'root' exists already")
    here = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    wide = np.full(POSITION_SIZE["free"], np.inf)
    none = np.zeros(VELOCITY_SIZE["free"])
    first = {"zero": here, "rest": here, "lower": -wide, "upper": wide} | dict.fromkeys(BY_DOF, none)
    return dataclasses.replace(
        model,
        joint_names=("root", *model.joint_names),
        joint_types=("free", *model.joint_types),
        joint_bodies=(1, *model.joint_bodies),
        joint_position=np.concatenate([np.zeros((1, 3)), np.asarray(model.joint_position)]),
        joint_axis=np.concatenate([[[0.0, 0.0, 1.0]], np.asarray(model.joint_axis)]),
        **{name: np.concatenate([value, np.asarray(getattr(model, name))]) for name, value in first.items()},
    )
