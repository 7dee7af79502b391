"""A whole hand with two markers a finger: a real recording through MyoHand; figures of experiments/hand_mocap.py."""

from pathlib import Path

import numpy as np
import pytest

from icjax.capture import read_session
from icjax.capture._capture import session_markers
from icjax.capture._joint_angles import joint_angles
from icjax.capture._load import load_trial

SESSION = Path(__file__).resolve().parents[2] / "experiments" / "sessions" / "dfki_hand.toml"

ROUGH = 0.012
"""m; RMS distance of the markers to a model that is neither scaled nor told where they sit: a centimetre."""

SMOOTH = np.radians(60.0)
"""Largest step of a joint in 80 ms: 13 rad/s, faster than fingers move in a grasp; a wrong branch jumps farther."""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*dropped.*:UserWarning")
def test_a_hand_is_followed_with_weak_beliefs_and_honest_about_them(shared_data, monkeypatch):
    """Every eighth frame, uncalibrated: no compilation but that of one pose solver."""
    monkeypatch.setenv("ICJAX_SHARED_DATA", str(shared_data))
    spec = read_session(SESSION)
    assert spec.model.nv == 26
    motion = load_trial(spec, spec.trials[0])
    names, markers = session_markers(spec, motion, spec.trials[0].markers)
    markers = markers[::8]
    sites = tuple(spec.model.site(name) for name in names)
    found = joint_angles(spec.model, sites, markers, 12.5, 4.0, spec.placement_sd, posture=spec.posture)
    gaps = np.isnan(markers).any(axis=-1)
    assert gaps.any()
    np.testing.assert_array_equal(np.isnan(found.residual), gaps)
    # Millimetres of residual that stay make the convergence linear: uncalibrated, some frames end at the last step.
    assert np.isfinite(found.q).all()
    assert np.sqrt(np.nanmean(found.residual**2)) < ROUGH
    assert np.abs(np.diff(found.q[:, 7:], axis=0)).max() < SMOOTH
    sd = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))[:, 6:]
    assert np.all(sd < 0.5 + 1e-9)  # the prior's, a coupled joint through the one before it
    thumb = names.index("thumb_tip")
    ip = spec.model.joint_names.index("ip_flexion") - 1
    long = np.flatnonzero(gaps[:, thumb] & np.roll(gaps[:, thumb], 1) & np.roll(gaps[:, thumb], -1))
    # Without its marker the last joint of the thumb is known by its prior of 0.4 rad only; with it, far better.
    assert np.median(sd[long, ip]) > 0.3
    assert np.median(sd[~gaps[:, thumb], ip]) < 0.25
