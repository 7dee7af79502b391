"""Does a stored interaction obey its own equation, and what does it not know?"""

from collections.abc import Iterator

import jax
import numpy as np

from icjax.estimation._joints import compliant_dofs
from icjax.interaction import STATUS, Interaction
from icjax.model import difference

EQUATION = 1e-9
"""rad or m; rounding of theta = theta_r + C tau in double precision."""


def check_interaction(interaction: Interaction) -> list[str]:
    """Lines about a stored interaction: what it holds, then lines that begin with "suspicious: " and "error: ".

    Eq. 1 must hold at every frame where the torque is known, compliance must not be negative and must vanish on
    driven degrees of freedom, and intervals must hold their values.
    """
    summary = interaction.summary
    joints = ", ".join(
        f"{name} {value:.3g} [{low:.3g}, {high:.3g}] rad/Nm" if np.isfinite(value) else f"{name} not estimated"
        for name, value, low, high in zip(
            summary.joint_names, summary.compliance, summary.lower, summary.upper, strict=True
        )
    )
    lines = [
        f"interaction '{interaction.name}': {len(interaction.time)} frames, "
        f"{len(interaction.per_event.onset)} events of the session; {joints}"
    ]
    return lines + [f"{kind}: interaction '{interaction.name}': {text}" for kind, text in _findings(interaction)]


def _findings(interaction: Interaction) -> Iterator[tuple[str, str]]:
    model, time = interaction.model, np.asarray(interaction.time)
    if len(time) < 2 or not np.all(np.diff(time) > 0):
        yield "error", "time does not increase"
        return
    compliance, torque = np.asarray(interaction.compliance), np.asarray(interaction.torque)
    driven = np.setdiff1d(np.arange(model.nv), compliant_dofs(model))
    for dof, name in enumerate(model.dof_names):
        column = compliance[:, dof]
        if not (np.isfinite(column) & (column >= 0)).all():
            yield "error", f"compliance of '{name}' is negative or not finite"
        elif dof in driven and np.any(column != 0):
            yield "error", f"compliance of '{name}' must be zero: the degree of freedom is driven"
        elif np.isinf(np.asarray(interaction.compliance_sd)[:, dof]).any():
            yield "suspicious", f"compliance of '{name}' is unknown; the joint is treated as rigid"
    yield from _equation(interaction, compliance * torque)
    summary = interaction.summary
    for name, value, low, high in zip(
        summary.joint_names, summary.compliance, summary.lower, summary.upper, strict=True
    ):
        if np.isfinite(value) and not low <= value <= high:
            yield "error", f"compliance of '{name}' lies outside its own interval"
    status = np.asarray(interaction.per_event.status)
    if status.size and not np.isin(status, np.arange(len(STATUS))).all():
        yield "error", f"per_event.status holds numbers beyond the {len(STATUS)} known ones"


def _equation(interaction: Interaction, displacement: np.ndarray) -> Iterator[tuple[str, str]]:
    known = np.isfinite(displacement).all(axis=1)
    if not known.all():
        yield "suspicious", f"torque is unknown in {(~known).sum()} frames; the reference is unknown there"
    if not known.any():
        return
    apart = jax.vmap(lambda a, b: difference(interaction.model, a, b))
    found = np.asarray(apart(np.asarray(interaction.reference)[known], np.asarray(interaction.q)[known]))
    error = np.abs(found - displacement[known]).max(axis=1)
    if error.max() > EQUATION:
        row = int(np.flatnonzero(known)[error.argmax()])
        yield "error", f"theta = theta_r + C tau fails by {error.max():.2g} at {interaction.time[row]:g} s"
