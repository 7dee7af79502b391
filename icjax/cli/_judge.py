"""What the demonstration says about itself: its results against the virtual subject's truth."""

from functools import partial
from pathlib import Path

import equinox as eqx
import jax
import numpy as np

from icjax.interaction import Interaction
from icjax.laboratory import Truth, load_truth
from icjax.model import pad_positions
from icjax.recording import Session
from icjax.rollout import Rollout
from icjax.running import on_full_blocks

JOINTS = ("wrist", "MP", "PIP", "DIP")
LOADED = 0.010
"""Nm; torques are compared where the true one exceeds this."""


def judge_capture(session: Session, folder: Path) -> dict:
    """Joint angles after one constant offset a joint and session (degrees RMS) and contact onsets (ms)."""
    errors, onsets, found, true = [], [], 0, 0
    for recording in session.trials():
        truth = load_truth(folder / f"{recording.name}.npz")
        error = _hinges(recording.model, recording.q) - _at(recording.time, truth.t, truth.theta)
        errors.append(error[np.asarray(recording.valid)])
        begin = contact_onsets(truth)
        measured = np.asarray(recording.events.onset)
        found, true = found + len(measured), true + len(begin)
        if len(measured) and len(begin):
            onsets.extend(np.abs(begin[:, None] - measured[None, :]).min(axis=1))
    error = np.concatenate(errors)
    error = error[np.isfinite(error).all(axis=1)]
    rms = np.degrees(np.sqrt(np.mean((error - error.mean(axis=0)) ** 2, axis=0)))
    return {
        "angle_rms_deg": dict(zip(JOINTS, np.round(rms, 4).tolist(), strict=True)),
        "contacts": {"true": true, "found": found},
        "onset_error_ms": {"median": _ms(np.median(onsets)), "largest": _ms(np.max(onsets))} if onsets else None,
    }


def judge_estimate(interaction: Interaction, truth: Truth) -> dict:
    """Joint torque NRMSE (RMS error over RMS truth where it exceeds 10 mNm) and compliance against truth."""
    dofs = [interaction.model.dof_names.index(name) for name in JOINTS]
    torque = np.asarray(interaction.torque)[:, dofs]
    true = _at(interaction.time, truth.t, truth.tau)
    result = {}
    for index, joint in enumerate(JOINTS):
        loaded = (np.abs(true[:, index]) > LOADED) & np.isfinite(torque[:, index])
        summary = list(interaction.summary.joint_names).index(joint)
        result[joint] = {
            "torque_nrmse": _ratio(torque[loaded, index] - true[loaded, index], true[loaded, index]),
            "compliance": _finite(interaction.summary.compliance[summary]),
            "true_compliance": float(truth.C[index]),
        }
    return result


def judge_transfer(rollout: Rollout, truth: Truth) -> dict:
    """Normal force NRMSE (RMS error over RMS truth) and fingertip path against the subject on that surface."""
    force = np.asarray(rollout.contact_force).sum(axis=1)
    true = _at(rollout.time, truth.t, truth.f_contact)
    tip = np.asarray(on_full_blocks(partial(_first_pad, rollout.model), np.asarray(rollout.q)))
    bone = _at(rollout.time, truth.t, truth.bone)
    distance = np.linalg.norm(tip - bone, axis=1)
    return {
        "normal_force_nrmse": _ratio(force[:, 2] - true[:, 2], true[:, 2]),
        "tangential_force_nrmse": _ratio(force[:, 0] - true[:, 0], true[:, 0]),
        "fingertip_rms_m": float(np.sqrt(np.mean(distance**2))),
        "failed_steps": int(np.count_nonzero(rollout.status)),
    }


@eqx.filter_jit
def _first_pad(model, q):
    return jax.vmap(lambda row: pad_positions(model, row)[0])(q)


def contact_onsets(truth: Truth, threshold: float = 1e-3, gap: float = 0.1) -> np.ndarray:
    """Times at which the true force begins after at least `gap` seconds without."""
    touching = np.linalg.norm(truth.f_contact, axis=1) > threshold
    times = truth.t[touching]
    if not len(times):
        return np.zeros(0)
    return times[np.concatenate([[True], np.diff(times) > gap])]


def _hinges(model, q) -> np.ndarray:
    return np.asarray(q)[:, [model.coordinate_slices[model.joint(name)].start for name in JOINTS]]


def _at(time, samples, values) -> np.ndarray:
    return np.stack([np.interp(time, samples, column) for column in values.T], axis=1)


def _ratio(error: np.ndarray, truth: np.ndarray) -> float | None:
    size = np.sqrt(np.mean(truth**2)) if truth.size else 0.0
    return float(np.sqrt(np.mean(error**2)) / size) if size > 0 else None


def _finite(value) -> float | None:
    return float(value) if np.isfinite(value) else None


def _ms(seconds) -> float:
    return float(np.round(1e3 * seconds, 3))
