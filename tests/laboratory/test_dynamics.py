"""The simulated subject: rest, press, contact against reference."""

import numpy as np
import pytest

from icjax.laboratory import Subject, Surface, replay
from icjax.laboratory._apparatus import BASE_STIFFNESS, forearm_origin
from icjax.laboratory._dynamics import simulate
from icjax.laboratory._movement import reach
from icjax.laboratory._replay import bump_under, load_truth

REST = 0.3
"""Share of a pressing run, at its end, in which the finger has come to rest."""


def press(friction, depth=0.004, subject=None):
    """Hold a reference below the plate for a second, after starting on it."""
    subject = subject or Subject()
    surface = Surface(friction=friction)
    above, below = (reach(subject, surface, 0.0, z) for z in (0.001, -depth))
    ramp = np.clip(np.linspace(-0.2, 3.0, 501), 0.0, 1.0)[:, None]
    ramp = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    command = np.zeros((501, 7))
    command[:, 3:] = above + ramp * (below - above)
    return subject, simulate(subject, surface, command, {}).truth


@pytest.mark.parametrize("friction", [0.0, 3.0])
def test_static_press_meets_the_endpoint_compliance(friction):
    """Joints, forearm and pad give way by J C J^T f, J_root C_root J_root^T f and C_pad f.

    Tolerances 2 to 3 %: the Jacobian turns by a few degrees between reference and rest, gravity is compensated at
    the reference, and the patch of skin that touches stays up to a millimetre behind the bone.
    """
    subject, truth = press(friction)
    last = -int(REST * len(truth.t))
    assert np.ptp(truth.f_contact[last:], axis=0).max() < 2e-3  # N: it has come to rest
    theta, free = truth.theta[-1], truth.theta_free[-1]
    force = truth.f_contact[-1, [0, 2]]
    middle = 0.5 * (theta + free)
    torque = subject.contact_jacobian(middle).T
    joints = (subject.pad_jacobian(middle) * np.asarray(subject.compliance)) @ torque
    moved = subject.pad_position(theta) - subject.pad_position(free)
    np.testing.assert_allclose(moved, joints @ force, atol=0.03 * float(np.linalg.norm(moved)))
    pad = truth.pad[-1, [0, 2]] - truth.bone[-1, [0, 2]]
    np.testing.assert_allclose(pad * subject.pad_stiffness, force, rtol=1e-9)
    arm = truth.pad[-1, [0, 2]] - [0.0, subject.pad_radius] - np.asarray(forearm_origin(subject))[[0, 2]] - [-0.2, 0.0]
    base = np.array([[1.0, 0.0, arm[1]], [0.0, 1.0, -arm[0]]])
    given_way = base.T @ force / np.asarray(BASE_STIFFNESS)
    assert truth.root[-1, 2] == pytest.approx(given_way[2], rel=0.02)
    lift = given_way[1] - 0.2 * given_way[2]  # the wrist is 0.2 m before the forearm's pivot; +pitch lowers it
    assert truth.root[-1, 1] - forearm_origin(subject)[2] == pytest.approx(lift, rel=0.02)
    # Both ends meet on the plate: the reference depth is what joints, forearm and pad give way together.
    assert truth.pad[-1, 2] == pytest.approx(subject.pad_radius, abs=2e-6)  # the mount gives 0.7 um a newton
    if friction == 0.0:
        whole = (joints + (base / np.asarray(BASE_STIFFNESS)) @ base.T)[1, 1] + 1.0 / subject.pad_stiffness
        assert force[1] == pytest.approx(0.004 / whole, rel=0.02)


def test_torque_is_the_jacobian_transpose_of_the_force_and_balances_the_springs():
    """At rest K (theta_free - theta) = -tau up to the change of gravity with posture (0.1 mNm a degree)."""
    subject, truth = press(0.6)
    spring = (truth.theta_free[-1] - truth.theta[-1]) / truth.C
    np.testing.assert_allclose(spring, -truth.tau[-1], atol=2e-3)
    assert np.abs(truth.tau[-1]).max() > 0.03


def test_the_reference_is_the_motion_before_contact(recorded):
    folder, _ = recorded
    truth = load_truth(folder / "truth" / "trial00.npz")
    onset = np.flatnonzero(truth.f_contact[:, 2])[0]
    assert 200 < onset < len(truth.t) - 200
    np.testing.assert_array_equal(truth.theta[:onset], truth.theta_free[:onset])
    assert np.abs(truth.theta - truth.theta_free).max() > np.radians(1.0)
    # Feed-forward makes the free finger follow its plan; the rest is the integrator's error.
    np.testing.assert_allclose(truth.theta_free, truth.command[:, 3:], atol=5e-4)


def test_contacts_are_separate_and_plausible(recorded):
    folder, _ = recorded
    truth = load_truth(folder / "truth" / "trial00.npz")
    touching = np.concatenate([[False], truth.f_contact[:, 2] > 0.0, [False]])
    onsets, releases = (
        np.flatnonzero(np.diff(touching.astype(int)) == 1),
        np.flatnonzero(np.diff(touching.astype(int)) == -1),
    )
    assert len(onsets) == 2
    assert np.all(truth.t[onsets[1:]] - truth.t[releases[:-1]] >= 0.6)
    speed = np.gradient(truth.bone[:, 2], truth.t)
    for onset, release in zip(onsets, releases, strict=True):
        assert -0.15 < speed[onset - 1] < -0.05
        assert 0.3 < truth.f_contact[onset:release, 2].max() < 2.0
    ratio = np.abs(truth.f_contact[:, 0]) - truth.mu * truth.f_contact[:, 2]
    assert ratio.max() < 1e-12


def test_replay_on_the_recorded_surface_is_the_recorded_truth(recorded):
    folder, _ = recorded
    truth = load_truth(folder / "truth" / "trial00.npz")
    again = replay(folder)
    np.testing.assert_array_equal(again.theta, truth.theta)
    np.testing.assert_array_equal(again.f_contact, truth.f_contact)


def test_replay_on_other_surfaces(recorded):
    folder, _ = recorded
    flat = load_truth(folder / "truth" / "trial00.npz")
    slippery = replay(folder, friction=0.1)
    assert (np.abs(slippery.f_contact[:, 0]) - 0.1 * slippery.f_contact[:, 2]).max() < 1e-12
    np.testing.assert_array_equal(slippery.theta_free, flat.theta_free)
    bump = bump_under(folder)
    over = replay(folder, bump=bump)
    np.testing.assert_array_equal(over.theta_free, flat.theta_free)
    top = (np.abs(over.pad[:, 0] - bump.centre[0]) < 0.002) & (over.f_contact[:, 2] > 0.1)
    assert top.sum() > 20
    # The sphere's lowest point rides on the bump: its height there is the bump's within the slope of 2 mm.
    height = over.pad[top, 2] - Subject().pad_radius
    np.testing.assert_allclose(height, bump.radii[2], atol=1e-4)
