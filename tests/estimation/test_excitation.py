"""What a contact says about each joint, on postures worked by hand, and the reasons made from it."""

import numpy as np
import pytest
from hand_made import LENGTHS, chain, pressing, ramps, recording

from icjax.estimation import (
    EstimationOptions,
    compliance_at_contact,
    excitation,
    explain,
    joint_torque,
    sensitivity,
)

ROUNDING = 1e-12
"""Relative; a few float64 operations on numbers of order one."""


def pushed(angles, direction, *, noise=0.0, q_sd=1e-3, size=2.0):
    """The chain held at `angles` (rad), its tip pushed from 0.4 s on in one direction, with white torque noise."""
    model = chain()
    time = np.arange(801) / 500.0
    strength = size * ramps(time, (0.4,), (1.2,), (1.0,))
    strength += noise * np.random.default_rng(0).standard_normal(strength.shape) * (strength > 0)
    q = np.broadcast_to(np.asarray(angles, float), (len(time), 3)).copy()
    total = np.cumsum(angles)
    tip = np.array([np.sum(np.cos(total) * LENGTHS), 0.0, -np.sum(np.sin(total) * LENGTHS)])
    force = strength[:, None] * np.asarray(direction, float)[None, None]
    point = np.broadcast_to(tip, force.shape).copy()
    touching = strength > 0
    return recording(
        model, time, q, force, point, touching=touching, events=((0.4,), (1.2,), (0,)), q_sd=q_sd
    )  # fmt: skip


def test_a_straight_finger_pushed_from_below():
    """Arms are the distances to the tip, 0.1, 0.05 and 0.02 m; every joint lifts it, so none can be told apart."""
    found = excitation((pushed((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),))
    np.testing.assert_allclose(np.abs(found.arm), [[0.1, 0.05, 0.02]], rtol=ROUNDING)
    np.testing.assert_allclose(found.leverage, np.ones((1, 3)), rtol=ROUNDING)
    squares = np.array([0.1, 0.05, 0.02]) ** 2
    np.testing.assert_allclose(found.share, [squares / squares.sum()], rtol=ROUNDING)
    assert float(found.isotropy[0]) < ROUNDING
    assert found.samples.tolist() == [[[51, 50]] * 3]  # the onset lies on a sample, which counts as before
    assert found.wanted.tolist() == [50, 50]


def test_a_force_along_the_straight_finger_has_no_leverage():
    found = excitation((pushed((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),))
    np.testing.assert_allclose(found.leverage, np.zeros((1, 3)), atol=ROUNDING)
    assert np.isnan(found.share).all()


def test_a_right_angle_at_the_second_joint():
    """Links 0.05 along x, then 0.05 down: from the joints the tip is at (0.05, -0.05), (0, -0.05), (0, -0.02).

    A force along x passes the first two at 0.05 m and the third at 0.02 m; along z the last two not at all.
    """
    across = excitation((pushed((0.0, np.pi / 2, 0.0), (-1.0, 0.0, 0.0)),))
    np.testing.assert_allclose(np.abs(across.arm), [[0.05, 0.05, 0.02]], rtol=1e-10)
    np.testing.assert_allclose(across.leverage, [[np.sqrt(0.5), 1.0, 1.0]], rtol=1e-10)
    along = excitation((pushed((0.0, np.pi / 2, 0.0), (0.0, 0.0, 1.0)),))
    np.testing.assert_allclose(along.leverage, [[np.sqrt(0.5), 0.0, 0.0]], atol=1e-10)
    columns = np.array([[-0.05, -0.05, -0.02], [-0.05, 0.0, 0.0]])
    large, small = np.linalg.svd(columns, compute_uv=False)
    assert float(along.isotropy[0]) == pytest.approx(small / large, rel=1e-10)


def test_the_arm_is_torque_over_force():
    made = pushed((0.3, 0.5, 0.4), (0.6, 0.0, 0.8))
    tau = np.asarray(joint_torque(made))
    force = np.linalg.norm(np.asarray(made.contact_force)[:, 0], axis=1)
    np.testing.assert_allclose(excitation((made,)).arm[0], tau[230] / force[230], rtol=1e-10)


def test_noise_of_the_torque_and_of_the_angle():
    """Force noise of 10 mN on arms of 0.1, 0.05, 0.02 m; the torque rises by 0.2 N times the arm in 0.1 s.

    The deviation of 50 samples is known to about 20 % (3 sd of its own error, a little more for differences).
    """
    found = excitation((pushed((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), noise=0.01, q_sd=2e-3),))
    arm = np.array([[0.1, 0.05, 0.02]])
    np.testing.assert_allclose(found.torque_noise, 0.01 * arm, rtol=0.4)
    change = np.asarray(found.torque_noise * found.torque_to_noise)
    np.testing.assert_allclose(change, 0.2 * arm, rtol=0.2)
    np.testing.assert_allclose(found.resolution, 2e-3 / change, rtol=ROUNDING)


def test_a_joint_beyond_the_contact_is_not_loaded():
    made = pushed((0.3, 0.5, 0.4), (0.0, 0.0, 1.0))
    shifted = recording(
        made.model, np.asarray(made.time), np.asarray(made.q), np.asarray(made.contact_force),
        np.asarray(made.contact_point), events=((0.4,), (1.2,), (0,)), bodies=("link1",)
    )  # fmt: skip
    found = excitation((shifted,))
    assert np.isnan(found.leverage[0, 2])
    assert np.isfinite(found.leverage[0, :2]).all()
    text = explain(compliance_at_contact((shifted,)), found)
    assert text[0][2] == "not excited: the contact is not beyond this joint"


def test_reasons_tell_the_geometry():
    made = pushed((0.0, 0.0, 0.0), (-1.0, 0.0, 0.03))
    found = compliance_at_contact((made,))
    text = explain(found, excitation((made,)))[0]
    assert all("the force points nearly through the joint (leverage 0.03: one degree" in item for item in text)
    assert all("the finger is nearly straight (isotropy" in item for item in text)
    # 0.2 N at the end of the window, 0.02 * 0.03 m: 0.12 mNm.
    assert "not excited: the torque has changed by 0.12 mNm" in text[2]
    assert "needed are 1 mNm and 3 times its noise" in text[2]


def test_reasons_tell_samples_estimates_and_stability():
    short, _, tau = pressing(onsets=(0.4,), releases=(0.42,))
    text = explain(compliance_at_contact((short,), None, (tau,)), excitation((short,), None, (tau,)))
    assert text[0][0] == "too few samples: 50 of 50 frames before and 10 of 50 frames after the contact are usable"
    made, _, tau = pressing(onsets=(0.4,), releases=(0.65,), q_sd=0.1)
    options = EstimationOptions(window_before=0.06, window_after=0.06)
    found, seen = compliance_at_contact((made,), options, (tau,)), excitation((made,), options, (tau,))
    agreed = sensitivity((made,), (0.05, 0.1), torques=(tau,), options=options)
    text = explain(found, seen, agreed, options)[0]
    assert text[0].startswith("accepted: 0.99 ± ")
    # q_sd of 0.1 rad over a torque change of 0.3 * 0.06 Nm
    assert "the joint yields by less than the noise of its angle (5.6 rad/Nm would equal it)" in text[0]
    assert "unstable, undetermined" in text[0]


def test_records_of_other_events_are_refused():
    made, _, tau = pressing()
    other, _, _ = pressing(name="another")
    found = compliance_at_contact((made,), None, (tau,))
    with pytest.raises(ValueError, match="excitation: its events or joints are not those"):
        explain(found, excitation((other,), None, (tau,)))
    with pytest.raises(ValueError, match="sensitivity: its events"):
        explain(found, excitation((made,), None, (tau,)), sensitivity((other,), (0.1,), torques=(tau,)))
    with pytest.raises(ValueError, match="recordings: none given"):
        excitation(())
