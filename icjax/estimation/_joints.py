"""Which degrees of freedom have a compliance, what they are called, and how their angle is followed in time."""

import jax
import numpy as np

from icjax.model import Model, difference
from icjax.typing import Float, Real


def compliant_dofs(model: Model) -> tuple[int, ...]:
    """Degrees of freedom to which Eq. 1 applies with an unknown compliance.

    A free joint (a moving root) is driven, or yields as the model states, and a coordinate whose stated compliance is
    zero is driven too.
    """
    driven = np.zeros(model.nv, dtype=bool)
    for kind, dofs in zip(model.joint_types, model.dof_slices, strict=True):
        driven[dofs] = kind == "free"
    stated = np.asarray(model.compliance)
    return tuple(int(dof) for dof in np.flatnonzero(~driven & (stated != 0)))


def yielding_root(model: Model) -> tuple[int, ...]:
    """Degrees of freedom of free joints that yield as the model states: the arm behind a hand (Section 6.2)."""
    stated = np.asarray(model.compliance)
    return tuple(
        dof
        for kind, dofs in zip(model.joint_types, model.dof_slices, strict=True)
        for dof in range(dofs.start, dofs.stop)
        if kind == "free" and 0 < stated[dof] < np.inf
    )


def dofs_of(model: Model, name: str) -> tuple[int, ...]:
    """Compliant degrees of freedom of a joint, or the one with that very name.

    **Errors**: `ValueError` naming the unknown joint and the known ones.
    """
    allowed = compliant_dofs(model)
    names = model.dof_names
    if name in model.joint_names:
        dofs = model.dof_slices[model.joint(name)]
        found = tuple(dof for dof in range(dofs.start, dofs.stop) if dof in allowed)
    else:
        found = tuple(dof for dof in allowed if names[dof] == name)
    if not found:
        known = ", ".join(names[dof] for dof in allowed) or "none"
        raise ValueError(f"unknown compliant joint {name!r}; the model has {known}")
    return found


def chosen_dofs(model: Model, joints: tuple[str, ...]) -> tuple[int, ...]:
    """The degrees of freedom of the named joints in the model's order; every compliant one where none is named."""
    if not joints:
        return compliant_dofs(model)
    return tuple(sorted({dof for name in joints for dof in dofs_of(model, name)}))


def angle_courses(
    model: Model, q: Float[Real, "time coordinate"], dofs: tuple[int, ...]
) -> Float[np.ndarray, "time chosen"]:
    """A number for each degree of freedom and frame whose time derivative is its velocity.

    A hinge or slide gives its coordinate. A ball joint gives the running sum of `log(R_k^T R_{k+1})`, the
    integral of the angular velocity in body axes: its value is arbitrary, its derivative is what Eq. 1 needs.
    Frames without a pose are NaN.
    """
    q = np.asarray(q)
    columns = {}
    for kind, coordinates, velocity in zip(model.joint_types, model.coordinate_slices, model.dof_slices, strict=True):
        if kind in ("hinge", "slide"):
            columns[velocity.start] = q[:, coordinates.start]
    if any(dof not in columns for dof in dofs):
        finite = np.asarray(np.isfinite(q).all(axis=1))
        held = _hold(q, finite)
        steps = np.asarray(jax.vmap(lambda a, b: difference(model, a, b))(held[:-1], held[1:]))
        course = np.concatenate([np.zeros((1, model.nv)), np.cumsum(steps, axis=0)])
        course[~finite] = np.nan
        columns = {dof: columns.get(dof, course[:, dof]) for dof in dofs}
    return np.stack([columns[dof] for dof in dofs], axis=1) if dofs else np.zeros((len(q), 0))


def _hold(q: np.ndarray, finite: np.ndarray) -> np.ndarray:
    """Frames without a pose repeat the last one that had it (the first one that has it, at the start)."""
    if not finite.any():
        raise ValueError("q: no frame of the recording has a pose")
    last = np.maximum.accumulate(np.where(finite, np.arange(len(q)), -1))
    return q[np.where(last < 0, int(np.flatnonzero(finite)[0]), last)]
