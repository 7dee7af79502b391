"""Models from MJCF and URDF files, compiled by MuJoCo and copied into a `Model`."""

import importlib
import os
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from icjax.files import FileError
from icjax.model._model import POSITION_SIZE, VELOCITY_SIZE, Model
from icjax.model._xml import prepared_xml

GRAVITY_DISABLED = 1 << 7
"""Bit of MuJoCo's mjDSBL_GRAVITY."""

BALL, CAPSULE = 2, 3
"""MuJoCo's mjGEOM_SPHERE and mjGEOM_CAPSULE."""

PAD_COMPLIANCE = 1.0 / 750.0
"""Compliance of a fingertip pad where the file states none, m/N (750 N/m)."""


def load_model(
    source: str | os.PathLike,
    *,
    pads: Mapping[str, str] | None = None,
    free_root: bool = False,
    strip: bool = False,
) -> Model:
    """Read an articulated body from MJCF or URDF.

    Bodies, joints, sites, pads and gravity are read, with their names; inertias inferred from geoms are kept.
    Tendons, equality constraints, actuators, sensors, keyframes and contact settings are no part of a `Model`.
    Actuators, sensors and keyframes do not act by themselves and are left out without a word; what would act
    (springs in tendons, equality constraints) is an error unless `strip` is set.

    - Compliance is 1 / joint stiffness, infinite where there is no spring; `springref` becomes `rest`, `ref` `zero`.
    - Limits of hinges and slides are kept; limits of balls are not coordinates and count as something dropped.
    - **Pads** are sphere and capsule geoms: those in a default class named "pad", those whose name starts with "pad",
      and those listed in `pads`. The first number of a geom's `user` attribute is the pad's compliance in m/N; without
      it 1/750 m/N is taken.
    - A **URDF** file states no root joint, so its first link stands fixed in the world; `free_root` lets it float.
      Links joined by fixed joints stay bodies of their own.

    **Arguments**: `source` path of a file, or its XML text; `pads` geom names by pad name; `free_root` adds a free
    joint named "root" to every body of the world that has no joint; `strip` drops what is missing or cannot be held
    (absent includes and meshes, tendons, equalities, ball limits) and lists it in one warning.

    **Errors**: `FileError` naming the file: missing, no XML, neither MJCF nor URDF, refused by MuJoCo, holding
    something that cannot be kept, or without a geom named in `pads`.
    """
    mujoco: Any = importlib.import_module("mujoco")  # its classes are made at import, unseen by type checkers

    is_text = isinstance(source, str) and "<" in source
    path = "XML text" if is_text else os.fspath(source)
    xml, dropped = prepared_xml(source, path, strip)
    try:
        spec = mujoco.MjSpec.from_string(xml) if is_text or strip else mujoco.MjSpec.from_file(path)
        if "<robot" in xml:
            spec.compiler.fusestatic = False
        if free_root:
            for body in spec.worldbody.bodies:
                if not body.joints:
                    body.add_freejoint(name="root")
        pad_geoms = _pad_geoms(spec, dict(pads or {}), path)
        compiled = spec.compile()
    except ValueError as error:
        if isinstance(error, FileError):
            raise
        raise FileError(path, f"is no model that MuJoCo accepts: {' '.join(str(error).split())}") from error
    dropped += _unmodelled(compiled)
    if dropped and not strip:
        raise FileError(path, f"holds what a model cannot keep (strip=True drops it): {', '.join(dropped)}")
    if dropped:
        warnings.warn(f"{path}: dropped {', '.join(dropped)}", stacklevel=2)
    return _copied(compiled, _pads_by_id(compiled, pad_geoms, path))


def _pad_geoms(spec: Any, asked: dict[str, str], path: str) -> dict[str, str]:
    """Geom name by pad name; unnamed geoms of the pad class are named after their place."""
    found = {}
    for geom in spec.geoms:
        is_pad = geom.classname.name == "pad" or geom.name.startswith("pad")
        if is_pad and geom.name not in asked.values():
            geom.name = geom.name or f"pad{len(found)}"
            found[geom.name] = geom.name
    known = [geom.name for geom in spec.geoms if geom.name]
    for pad, geom in asked.items():
        if geom not in known:
            raise FileError(path, f"has no geom {geom!r} for pad {pad!r}; it has {', '.join(known) or 'none'}")
    return found | asked


def _pads_by_id(compiled: Any, pad_geoms: dict[str, str], path: str) -> dict[str, int]:
    chosen = {name: compiled.geom(geom).id for name, geom in pad_geoms.items()}
    for name, geom in chosen.items():
        if compiled.geom_type[geom] not in (BALL, CAPSULE):
            raise FileError(path, f"pad {name!r} is neither a sphere nor a capsule")
    return chosen


def _unmodelled(compiled: Any) -> list[str]:
    """What acts on the joints in MuJoCo and would not act here."""
    limited_balls = np.sum((compiled.jnt_type == 1) & (compiled.jnt_limited == 1))
    counts = {
        "equality constraints": compiled.neq,
        "tendons with stiffness or damping": int(
            np.sum((compiled.tendon_stiffness > 0) | (compiled.tendon_damping > 0))
        ),
        "limits of ball joints": int(limited_balls),
        "joints with nonlinear springs": int(np.sum(np.any(compiled.jnt_stiffnesspoly != 0, axis=1))),
        "degrees of freedom with nonlinear damping": int(np.sum(np.any(compiled.dof_dampingpoly != 0, axis=1))),
        "bodies with gravity compensation": int(np.sum(compiled.body_gravcomp != 0)),
        "degrees of freedom with dry friction": int(np.sum(compiled.dof_frictionloss > 0)),
    }
    return [f"{count} {what}" for what, count in counts.items() if count]


def _copied(m: Any, pads: dict[str, int]) -> Model:
    kinds = tuple(("free", "ball", "slide", "hinge")[kind] for kind in m.jnt_type)
    coordinates, dofs = [], []
    for joint, kind in enumerate(kinds):
        coordinates += [joint] * POSITION_SIZE[kind]
        dofs += [joint] * VELOCITY_SIZE[kind]
    scalar = np.asarray([kind in ("hinge", "slide") for kind in kinds], bool)
    limited = scalar & (m.jnt_limited == 1)
    lower = np.where(limited, m.jnt_range[:, 0], -np.inf)
    upper = np.where(limited, m.jnt_range[:, 1], np.inf)
    sprung = m.jnt_stiffness > 0
    compliance = np.where(sprung, 1.0 / np.where(sprung, m.jnt_stiffness, 1.0), np.inf)
    coordinates, dofs = np.asarray(coordinates, int), np.asarray(dofs, int)
    pad_ids = np.asarray(list(pads.values()), int)
    if m.nuser_geom and len(pad_ids):
        stated = m.geom_user[pad_ids, 0]
        pad_compliance = np.where(stated > 0, stated, PAD_COMPLIANCE)
    else:
        pad_compliance = np.full(len(pad_ids), PAD_COMPLIANCE)
    axes = _matrices(m.body_iquat)
    capsules = m.geom_type[pad_ids] == CAPSULE
    pad_axis = _matrices(m.geom_quat)[pad_ids, :, 2] * np.where(capsules, m.geom_size[pad_ids, 1], 0.0)[:, None]
    return Model(
        name=m.names[: m.names.index(b"\x00")].decode(),
        body_names=_names(m.body, m.nbody, "body"),
        body_parents=tuple(int(parent) for parent in m.body_parentid),
        joint_names=_names(m.joint, m.njnt, "joint"),
        joint_types=kinds,
        joint_bodies=tuple(int(body) for body in m.jnt_bodyid),
        site_names=_names(m.site, m.nsite, "site"),
        site_bodies=tuple(int(body) for body in m.site_bodyid),
        pad_names=tuple(pads),
        pad_bodies=tuple(int(m.geom_bodyid[geom]) for geom in pad_ids),
        body_position=m.body_pos.copy(),
        body_rotation=_matrices(m.body_quat),
        body_mass=m.body_mass.copy(),
        body_com=m.body_ipos.copy(),
        body_inertia=np.einsum("bij,bj,bkj->bik", axes, m.body_inertia, axes),
        joint_position=m.jnt_pos.copy(),
        joint_axis=m.jnt_axis.copy(),
        zero=m.qpos0.copy(),
        rest=m.qpos_spring.copy(),
        lower=lower[coordinates],
        upper=upper[coordinates],
        compliance=compliance[dofs],
        damping=m.dof_damping.copy(),
        armature=m.dof_armature.copy(),
        site_position=m.site_pos.copy(),
        pad_centre=m.geom_pos[pad_ids].copy(),
        pad_radius=m.geom_size[pad_ids, 0].copy(),
        pad_compliance=pad_compliance,
        gravity=np.array(m.opt.gravity) * float(not m.opt.disableflags & GRAVITY_DISABLED),
        pad_axis=pad_axis if capsules.any() else None,
        capsule_pads=tuple(int(pad) for pad in np.flatnonzero(capsules)),
    )


def _names(entry: Any, count: int, kind: str) -> tuple[str, ...]:
    """Names in order; unnamed entries are called after their kind and number."""
    given = [entry(index).name for index in range(count)]
    return tuple(name or f"{kind}{index}" for index, name in enumerate(given))


def _matrices(quaternions: np.ndarray) -> np.ndarray:
    """Rotation matrices of unit quaternions (w, x, y, z), in the precision of the file."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
