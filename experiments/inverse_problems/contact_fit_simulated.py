"""The session once more with a hand of icjax: recordings as an estimator gets them, and their truth."""

import dataclasses
from typing import Any

import numpy as np
from contact_fit_problem import joints_of, typical
from grasp5 import judged, scene_of, solids
from scipy.ndimage import gaussian_filter1d

from icjax.interaction import Interaction
from icjax.recording import ContactEvents, Recording
from icjax.synthesis import transfer

STIFFER = 0.6
"""Of typical compliances; with these the hand presses about as hard as the session's."""

GAIN, FORCE_NOISE, TOUCH = 0.03, 0.003, 0.02
"""Gain errors of the films (share); noise after the filter and least force that counts as contact, N."""

FILTER = 5.0
"""Samples; of the Gaussian that makes the noise of angles and forces as smooth as after the filters."""


def simulated(
    trials: dict[str, Recording], truths: dict[str, Any], base: Interaction, spread: float, rng: np.random.Generator
) -> tuple[dict[str, Recording], dict[str, Any]]:
    """Another hand makes the movement of the session on every object; noise, gain errors of each film throughout."""
    joints = joints_of(base.model)
    C = STIFFER * np.array([typical(name) for name in joints]) * np.exp(spread * rng.normal(size=len(joints)))
    gain = 1.0 + GAIN * rng.normal(size=5)
    recordings, truth = {}, {}
    for name, recording in trials.items():
        intended = np.concatenate([np.asarray(recording.q)[:, :3], truths[name]["theta_free"]], axis=1)
        compliance = np.broadcast_to(np.concatenate([np.zeros(3), C]), np.shape(base.compliance))
        own = dataclasses.replace(base, name=name, reference=intended, compliance=compliance)
        made = transfer(own, scene_of(recording, solids()[name]))
        recordings[name] = noisy(recording, made, gain, rng)
        pose = np.concatenate([made.object_position, made.object_quaternion], axis=2)[:, 0]
        truth[name] = truths[name] | {"C": C, "theta_free": intended[:, 3:], "object_pose": pose}
        truth[name]["f_normal"] = judged(made, truths[name])[1]
    return recordings, truth


def noisy(recording: Recording, made: Any, gain: np.ndarray, rng: np.random.Generator) -> Recording:
    """What markers and films show of a rollout, in the form of the session's recording."""
    slots = [number for number, name in enumerate(made.slot_names) if name.endswith("/object")][:5]
    normal = np.asarray(made.contact_normal)[:, slots]
    force = np.sum(np.asarray(made.contact_force)[:, slots] * normal, axis=2)
    shown = np.clip(gain * force + smooth(rng, force.shape, FORCE_NOISE), 0.0, None)
    touching = shown > TOUCH
    sd = np.sqrt(np.diagonal(np.asarray(recording.q_covariance), axis1=1, axis2=2))
    q = np.asarray(made.q) + smooth(rng, np.shape(made.q), 1.0) * sd * (np.arange(sd.shape[1]) > 2)
    return dataclasses.replace(
        recording,
        q=q,
        contact_force=np.where(touching[..., None], shown[..., None] * normal, 0.0),
        contact_point=np.where(touching[..., None], np.asarray(made.contact_point)[:, slots], np.nan),
        contact_moment=np.zeros((*touching.shape, 3)),
        touching=touching,
        events=events(np.asarray(recording.time), touching),
    )


def smooth(rng: np.random.Generator, shape: tuple[int, ...], sd: float) -> np.ndarray:
    """Noise of that standard deviation, correlated over a few samples."""
    noise = gaussian_filter1d(rng.normal(size=shape), FILTER, axis=0)
    return sd * noise / noise.std(axis=0)


def events(time: np.ndarray, touching: np.ndarray) -> ContactEvents:
    """Intervals of contact."""
    found = []
    for contact, column in enumerate(touching.T):
        change = np.diff(np.concatenate([[False], column, [False]]).astype(int))
        for first, after in zip(np.flatnonzero(change == 1), np.flatnonzero(change == -1), strict=True):
            found.append((time[first], time[after] if after < len(time) else np.nan, contact))
    onset, release, contact = (np.array(column) for column in zip(*sorted(found), strict=True))
    return ContactEvents(onset, release, contact.astype(int))
