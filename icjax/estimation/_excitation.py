# pyright: reportGeneralTypeIssues=false
# (the checker does not see that `labelled` and `names` declare fields without a default)
"""What a contact can say about each joint, before any estimate: excitation, geometry, samples."""

from typing import NamedTuple

import equinox as eqx
import numpy as np

from icjax.estimation._contact_compliance import contacts_that_load, window_frames
from icjax.estimation._fit import second_difference_noise
from icjax.estimation._joints import chosen_dofs
from icjax.estimation._options import EstimationOptions
from icjax.estimation._torque import endpoint_jacobian, joint_torque
from icjax.files import labelled, names
from icjax.recording import Recording
from icjax.typing import Float, Int, Real


class Excitation(eqx.Module):
    """How much every contact loads every joint, and how well its geometry tells the joints apart.

    Geometry is that of the frame with the largest force in the window after the onset, with n the unit force and
    J_j the velocity of the contact point a unit of joint velocity (Eq. 4). NaN where the contact does not load
    the joint or that frame has no pose.

    - `torque_noise`: standard deviation of one torque sample in that window, from second differences.
    - `torque_to_noise`: largest less smallest torque there, counting zero at the onset, over that deviation.
    - `resolution`: standard deviation that the recording states of one angle sample, over the same change: the
      compliance with which the joint yields by no more than the noise of its angle. The estimate of a much
      stiffer joint is noise.
    - `arm`: moment arm `n . J_j` of the force, signed; the force's torque is arm times force.
    - `leverage`: `|n . J_j| / |J_j|`, 0 where the force points through the joint's axis, 1 at a right angle. An
      error of e rad in the force's direction or the pose changes the torque by the share `e sqrt(1 - l^2) / l`.
    - `share`: `arm_j^2` over the sum of the joints', the part of the contact point's displacement along the force
      that the joint contributes where all are equally compliant. A joint with a small share hardly moves the
      fingertip, and its estimate hardly matters to a transfer.
    - `isotropy`: second over first singular value of the J of all estimated joints, one number an event. 0 where
      all joints move the contact point along one line (the straight finger of Figure 8): then the contact tells
      only one combination of them.
    - `samples`: usable frames in the windows before and after the onset, of `wanted`.
    """

    recording: tuple[str, ...] = names("event")
    joint_names: tuple[str, ...] = names("joint")
    onset: Float[Real, " event"] = labelled("event", unit="s")
    torque_noise: Float[Real, "event joint"] = labelled("event", "joint", unit="Nm")
    torque_to_noise: Float[Real, "event joint"] = labelled("event", "joint", unit="1")
    resolution: Float[Real, "event joint"] = labelled("event", "joint", unit="rad/Nm")
    arm: Float[Real, "event joint"] = labelled("event", "joint", unit="m")
    leverage: Float[Real, "event joint"] = labelled("event", "joint", unit="1")
    share: Float[Real, "event joint"] = labelled("event", "joint", unit="1")
    isotropy: Float[Real, " event"] = labelled("event", unit="1")
    samples: Int[Real, "event joint side"] = labelled("event", "joint", "side", unit="1")
    wanted: Int[Real, " side"] = labelled("side", unit="1", doc="frames in a whole window")


class _Signal(NamedTuple):
    """One event and joint."""

    noise: float
    ratio: float
    resolution: float
    before: int
    after: int


UNLOADED = _Signal(np.nan, np.nan, np.nan, 0, 0)


def excitation(
    recordings: tuple[Recording, ...],
    options: EstimationOptions | None = None,
    torques: tuple[Float[Real, "_ dof"], ...] | None = None,
) -> Excitation:
    """Excitation and geometry of every joint at every contact event; see `Excitation` for each number.

    **Arguments**: as for `compliance_at_contact`; the windows are those of `options`.

    **Returns** events in order of recording and onset, as `compliance_at_contact` does.

    **Errors**: `ValueError` for an unknown joint or an empty tuple of recordings.

    Source: Kry and Pai 2006, sections 4.3 (what makes an estimate fail) and 6.1 (Eq. 4).
    """
    options = options or EstimationOptions()
    if not recordings:
        raise ValueError("recordings: none given")
    model = recordings[0].model
    dofs = chosen_dofs(model, options.joints)
    if torques is None:
        torques = tuple(joint_torque(recording) for recording in recordings)
    rate = recordings[0].rate
    signals, shapes = [], []
    for recording, torque in zip(recordings, torques, strict=True):
        tau = np.asarray(torque)[:, list(dofs)]
        loads = np.stack(contacts_that_load(recording, dofs)) if dofs else np.zeros((0, 1), bool)
        loaded = loads[:, np.asarray(recording.events.contact, dtype=int)].T
        shapes.append(np.where(loaded[:, None, :], _endpoint(recording, dofs, options), np.nan))
        variance = np.diagonal(np.asarray(recording.q_covariance), axis1=1, axis2=2)[:, list(dofs)]
        for event, row in enumerate(loaded):
            signals.append(
                [
                    _signal(recording, event, tau[:, j], variance[:, j], loads[j], options) if on else UNLOADED
                    for j, on in enumerate(row)
                ]
            )
    events, count = len(signals), len(dofs)

    def table(field: str) -> np.ndarray:
        return np.asarray([[getattr(item, field) for item in row] for row in signals]).reshape(events, count)

    shape = np.concatenate(shapes)
    arm = shape[:, 0]
    length = np.linalg.norm(shape[:, 1:], axis=1)
    square = np.nansum(arm**2, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        leverage, share = np.abs(arm) / length, arm**2 / square
    return Excitation(
        recording=tuple(item.name for item in recordings for _ in np.asarray(item.events.onset)),
        joint_names=tuple(model.dof_names[dof] for dof in dofs),
        onset=np.concatenate([np.asarray(item.events.onset, dtype=float) for item in recordings]),
        torque_noise=table("noise"),
        torque_to_noise=table("ratio"),
        resolution=table("resolution"),
        arm=arm,
        leverage=leverage,
        share=share,
        isotropy=np.asarray([_isotropy(item[1:]) for item in shape], dtype=float),
        samples=np.stack([table("before"), table("after")], axis=-1).astype(np.int32),
        wanted=np.asarray([round(rate * options.window_before), round(rate * options.window_after)], dtype=np.int32),
    )


def _signal(
    recording: Recording,
    event: int,
    torque: np.ndarray,
    variance: np.ndarray,
    loads: np.ndarray,
    options: EstimationOptions,
) -> _Signal:
    usable = np.asarray(recording.valid) & np.isfinite(torque)
    _, before, after = window_frames(recording, event, loads, usable, options)
    if after.sum() < 3:
        return UNLOADED._replace(before=int(before.sum()), after=int(after.sum()))
    noise, change = second_difference_noise(torque[after]), float(np.ptp(np.append(torque[after], 0.0)))
    deviation = np.sqrt(np.mean(variance[after]))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio, resolution = np.divide(change, noise), np.divide(deviation, change)
    return _Signal(noise, float(ratio), float(resolution), int(before.sum()), int(after.sum()))


def _endpoint(recording: Recording, dofs: tuple[int, ...], options: EstimationOptions) -> np.ndarray:
    """At every event, rows `n . J` and J at the frame of largest force: `[event, 4, joint]`, NaN where unknown."""
    channels = np.asarray(recording.events.contact, dtype=int)
    q, force = np.asarray(recording.q), np.asarray(recording.contact_force)
    result = np.full((len(channels), 4, len(dofs)), np.nan)
    time, edge = np.asarray(recording.time), 1e-6 / recording.rate
    usable = np.asarray(recording.valid) & np.isfinite(q).all(axis=1)
    events, frames = [], []
    for event, channel in enumerate(channels):
        s = time - float(np.asarray(recording.events.onset)[event])
        touched = usable & np.asarray(recording.touching)[:, channel] & (s > 0) & (s <= options.window_after + edge)
        if touched.any():
            size = np.where(touched, np.linalg.norm(force[:, channel], axis=1), -np.inf)
            events.append(event)
            frames.append(int(np.argmax(size)))
    if not events:
        return result
    at = np.asarray(frames), channels[events]
    direction = force[at] / np.maximum(np.linalg.norm(force[at], axis=1, keepdims=True), np.finfo(float).tiny)
    jacobian = endpoint_jacobian(recording, *at)[:, :, list(dofs)]
    result[events] = np.concatenate([np.einsum("ei,eij->ej", direction, jacobian)[:, None], jacobian], axis=1)
    return result


def _isotropy(jacobian: np.ndarray) -> float:
    known = jacobian[:, np.isfinite(jacobian).all(axis=0)]
    if known.shape[1] == 0:
        return np.nan
    values = np.linalg.svd(known, compute_uv=False)
    return float(values[1] / values[0]) if len(values) > 1 and values[0] > 0 else 0.0
