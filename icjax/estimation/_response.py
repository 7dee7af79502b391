"""Everything that one perturbation trial says: Table 2 for one recording."""

import equinox as eqx
import numpy as np

from icjax.estimation._endpoint import NORMAL_95, Stiffness, stiffness_interval
from icjax.estimation._fingertip import fingertip_path
from icjax.estimation._perturbation import (
    REACTION_UNTIL,
    REST,
    Reaction,
    Secant,
    perturbation_onset,
    reaction_time,
    secant_stiffness,
)
from icjax.estimation._second_order import SecondOrderFit, fit_second_order
from icjax.estimation._torque import body_index
from icjax.interaction import Interaction
from icjax.model import Model, forward_kinematics
from icjax.recording import Recording
from icjax.typing import Float


class Perturbation(eqx.Module):
    """The response of one trial. Forces act on the finger, displacements are those of its bone, both upward.

    **Fields**

    - `onset` s, on the recording's clock; `rest_force` N, mean vertical force before it.
    - `fit`: m, b, k, f0 by the path method; `fit_derivative`: the paper's way, None where markers are missing.
    - `secant`, `reaction`: see `secant_stiffness` and `reaction_time`.
    - `stiffness`: k_G from the compliances of an interaction and the posture at rest, None without one.
    - `pad_compliance` m/N, in series between bone and surface and in none of these (0 if unknown).
    - `time` s from the onset, `displacement` m (NaN in gaps), `force` N: vertical, at the marker rate.
    """

    name: str
    contact: str
    onset: float
    rest_force: float
    fit: SecondOrderFit
    fit_derivative: SecondOrderFit | None
    secant: Secant
    reaction: Reaction
    stiffness: Stiffness | None
    pad_compliance: float
    time: Float[np.ndarray, " sample"]
    displacement: Float[np.ndarray, " sample"]
    force: Float[np.ndarray, " sample"]


def perturbation(
    recording: Recording,
    interaction: Interaction | None = None,
    window: float = 0.025,
    secant_window: tuple[float, float] = (0.05, 0.09),
    contact: str | None = None,
    samples: int = 4000,
) -> Perturbation:
    """Analyse a trial in which the touched surface suddenly moves.

    The force is the calibrated, unfiltered one of the sensor; the inertia of a plate above the sensor is in it. The
    displacement is that of the bone, from the markers of the touching segment (`fingertip_path`), so every stiffness
    is the joints' alone, without the pad. If the force of a moving plate was not freed of the plate's inertia, m
    holds part of the plate's mass; k does not, once the plate rests.

    **Arguments**

    - `interaction`: its compliances give k_G at this trial's posture; its model must have the same joints.
    - `window` s of the second-order fit; `secant_window` s after the onset.
    - `contact`: name of the contact channel, the first if None. `samples` behind the sampled interval of k_G.

    **Errors**: `ValueError` for an unknown contact, a recording without sensor channels, no sudden change of force,
    or markers that do not show the touching segment.

    **Source**: Kry and Pai 2006, section 4.2.
    """
    column = _contact(recording, contact)
    model = recording.model
    up = _up(model)
    time = np.asarray(recording.channels.time)
    force = np.asarray(recording.channels.wrench)[:, column, 3:]
    frames = np.asarray(recording.time)
    touching = np.interp(time, frames, np.asarray(recording.touching)[:, column].astype(float)) > 0.5
    onset = perturbation_onset(time, force @ up, touching)
    body = body_index(model, recording.contact_bodies[column])
    q, place, point = _posture(recording, column, body, onset)
    shown, path = fingertip_path(recording, body, place, onset + REST[0], onset + REACTION_UNTIL)
    on_frames = np.stack([np.interp(shown, time, force[:, axis]) for axis in range(3)], axis=1)
    rest = (shown >= onset + REST[0]) & (shown <= onset + REST[1])
    displacement = (path - np.nanmean(path[rest], axis=0)) @ up
    series = shown, displacement, on_frames @ up, onset, window
    usable = np.isfinite(displacement[shown <= onset + window + 0.02]).all()
    return Perturbation(
        name=recording.name,
        contact=recording.contact_names[column],
        onset=onset,
        rest_force=float(np.mean(on_frames[rest] @ up)),
        fit=fit_second_order(*series),
        fit_derivative=fit_second_order(*series, method="derivative") if usable else None,
        secant=secant_stiffness(shown, path, on_frames, onset, secant_window, up),
        reaction=reaction_time(time, force @ up, onset),
        stiffness=None
        if interaction is None
        else _stiffness(recording, interaction, q, body, point, up, onset, samples),
        pad_compliance=_pad_compliance(model, body),
        time=shown - onset,
        displacement=displacement,
        force=on_frames @ up,
    )


def _contact(recording: Recording, name: str | None) -> int:
    known = recording.contact_names
    if not known or recording.channels.wrench.shape[1] != len(known):
        raise ValueError(f"recording {recording.name!r} has no calibrated force channel for its contacts")
    if name is not None and name not in known:
        raise ValueError(f"contact {name!r}: recording {recording.name!r} has {', '.join(known)}")
    return known.index(name) if name else 0


def _up(model: Model) -> np.ndarray:
    gravity = np.asarray(model.gravity)
    size = np.linalg.norm(gravity)
    return -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])


def _posture(recording: Recording, column: int, body: int, onset: float):
    """Posture at rest, the point of the body whose displacement counts (its frame) and the contact point (world)."""
    model, time = recording.model, np.asarray(recording.time)
    usable = np.asarray(recording.valid) & (time >= onset + REST[0]) & (time <= onset - 0.02)
    if not usable.any():
        raise ValueError(f"{recording.name}: the pose is unknown before the perturbation at {onset:.3f} s")
    q = np.asarray(recording.q)[usable][-1]
    pose = forward_kinematics(model, q)[body]
    point = np.asarray(recording.contact_point)[usable, column]
    point = point[np.isfinite(point).all(axis=1)].mean(axis=0)
    if body in model.pad_bodies:
        return q, np.asarray(model.pad_centre)[model.pad_bodies.index(body)], point
    return q, np.asarray(pose.inverse().apply(point)), point


def _pad_compliance(model: Model, body: int) -> float:
    if body not in model.pad_bodies:
        return 0.0
    return float(np.asarray(model.pad_compliance)[model.pad_bodies.index(body)])


def _stiffness(recording, interaction, q, body, point, up, onset, samples) -> Stiffness:
    compliance, sd = joint_compliances(interaction, recording.model)
    frame = int(np.argmin(np.abs(np.asarray(recording.time) - onset + 0.02)))
    covariance = np.asarray(recording.q_covariance)[frame] + np.diag(np.asarray(recording.q_offset_sd) ** 2)
    draws = samples if np.isfinite(sd).all() else 0
    return stiffness_interval(recording.model, q, body, point, compliance, sd, covariance, up, draws)


def joint_compliances(
    interaction: Interaction, model: Model
) -> tuple[Float[np.ndarray, " dof"], Float[np.ndarray, " dof"]]:
    """Pooled compliance of every degree of freedom and its standard deviation, from the 95 % interval.

    Where the interaction has no finite value the model's own stands, with infinite standard deviation.
    """
    if interaction.model.dof_names != model.dof_names:
        raise ValueError(f"interaction {interaction.name!r} is of a model with other joints than the recording's")
    summary = interaction.summary
    own = np.asarray(model.compliance)
    value = np.where(np.isfinite(own), own, 0.0)
    sd = np.zeros_like(value)
    for index, name in enumerate(summary.joint_names):
        dof = model.dof_names.index(name)
        found = float(np.asarray(summary.compliance)[index])
        value[dof] = found if np.isfinite(found) else value[dof]
        width = float(np.asarray(summary.upper)[index] - np.asarray(summary.lower)[index])
        sd[dof] = width / (2 * NORMAL_95) if np.isfinite(width) else np.inf
    return value, sd
