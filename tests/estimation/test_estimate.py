"""The whole step from a session to interactions, and its errors."""

import json

import equinox as eqx
import jax
import numpy as np
import pytest
from hand_made import COMPLIANCE, chain, pressing, recording, session

from icjax.estimation import EstimationOptions, estimate
from icjax.interaction import Interaction
from icjax.model import difference, index_finger


def test_session_to_interactions(tmp_path):
    first, reference, tau = pressing(q_sd=1e-4, offset_sd=3e-3)
    second, _, _ = pressing(speed=(0.2, 0.1, -0.3), name="trial01")
    catch, _, _ = pressing(name="catch00", role="catch", catch_of="trial00", rates=(30.0, 20.0, 6.0))
    seen = []
    found = estimate(session(first, catch, second), progress=seen.append)
    assert [item.name for item in found] == ["trial00", "trial01"]
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    one = found[0]
    assert one.per_event.recording == ("trial00", "trial00", "trial01", "trial01")
    np.testing.assert_allclose(one.summary.compliance, COMPLIANCE, rtol=1e-8)
    assert np.all(np.asarray(one.summary.lower) <= COMPLIANCE)
    assert np.all(np.asarray(one.summary.upper) >= COMPLIANCE)
    np.testing.assert_array_equal(one.summary.events, [4, 4, 4])
    np.testing.assert_allclose(one.reference, reference, atol=1e-8)
    np.testing.assert_allclose(one.torque, tau, atol=1e-14)
    # Eq. 1 over the whole record, to rounding
    error = jax.vmap(lambda a, b: difference(one.model, a, b))(one.reference, one.q) - one.compliance * one.torque
    assert np.abs(error).max() < 1e-12
    free = np.asarray(tau)[:, 0] == 0
    np.testing.assert_allclose(np.asarray(one.reference_sd)[free], np.hypot(1e-4, 3e-3), rtol=1e-12)
    told = json.loads(one.provenance)
    assert told["joints"]["joint0"]["status"] == {"accepted": 4, "negative": 0, "not excited": 0, "too few samples": 0}
    assert told["joints"]["joint0"]["median_torque_change_Nm"] == pytest.approx(0.03)
    assert told["trials"] == ["trial00", "trial01"]
    one.save(tmp_path / "interaction.nc")
    back = Interaction.load(tmp_path / "interaction.nc")
    assert jax.tree.structure(back) == jax.tree.structure(one)
    for read, written in zip(jax.tree.leaves(back), jax.tree.leaves(one), strict=True):
        np.testing.assert_array_equal(read, written)


def test_reference_deviation_grows_with_the_torque():
    made, _, tau = pressing()
    options = EstimationOptions(given=dict(zip(("joint0", "joint1", "joint2"), COMPLIANCE, strict=True)))
    sure = estimate(session(made), options)[0]
    assert np.all(np.asarray(sure.reference_sd) == 0)
    unsure = estimate(session(made), EstimationOptions(given={"joint0": 1.0}, given_sd={"joint0": 0.1}))[0]
    np.testing.assert_allclose(np.asarray(unsure.reference_sd)[:, 0], 0.1 * np.abs(tau[:, 0]), atol=1e-12)


def test_a_driven_root_keeps_its_measured_course():
    """The shipped finger on a free root, tapped through its pad: the root has no compliance, theta_r = q there."""
    model = index_finger()
    frames = 300
    time = np.arange(frames) / 500.0
    q = np.tile(np.asarray(model.zero), (frames, 1))
    hinges = [model.coordinate_slices[model.joint(name)].start for name in ("wrist", "MP", "PIP", "DIP")]
    q[:, hinges] += 0.3 + 0.2 * time[:, None]
    q[:, 0] += 0.05 * time
    s = np.clip(time - 0.3, 0, None)
    force = np.zeros((frames, 1, 3))
    force[:, 0, 2] = 5.0 * s
    point = np.tile([0.17, 0.0, -0.05], (frames, 1, 1))
    tapped = recording(model, time, q, force, point, events=((0.3,), (np.nan,), (0,)), bodies=("fingertip",))
    found = estimate(session(tapped))[0]
    assert found.per_event.joint_names == ("wrist", "MP", "PIP", "DIP")
    np.testing.assert_allclose(np.asarray(found.reference)[:, :7], q[:, :7], atol=1e-15)
    assert np.all(np.asarray(found.compliance)[:, :6] == 0)
    assert np.isfinite(found.reference).all()


def test_no_usable_event_is_never_a_bare_number():
    made, _, _ = pressing(rates=(0.3, 0.2, 0.0))
    found = estimate(session(made))[0]
    assert np.isnan(found.summary.compliance[2])
    assert (float(found.summary.lower[2]), float(found.summary.upper[2])) == (0.0, np.inf)
    assert json.loads(found.provenance)["sources"]["joint2"][0] == "stated by the model"
    assert np.isfinite(found.reference).all()


def test_an_unknown_pose_in_contact_leaves_the_reference_unknown():
    """Coordinates that no marker stands behind are not passed on as a reference; without contact they stay."""
    made, _, _ = pressing()
    valid = np.ones(len(made.time), bool)
    valid[[10, 250]] = False
    touching = np.asarray(made.touching)[:, 0]
    assert not touching[10]
    assert touching[250]
    found = estimate(session(eqx.tree_at(lambda r: r.valid, made, valid)))[0]
    assert np.isnan(found.torque[250]).all()
    assert np.isnan(found.reference[250]).all()
    assert np.isfinite(np.delete(found.reference, 250, axis=0)).all()
    np.testing.assert_array_equal(found.reference[10], made.q[10])
    np.testing.assert_allclose(found.summary.compliance, COMPLIANCE, rtol=1e-8)


def test_a_session_without_a_usable_event():
    made, _, _ = pressing(rates=(1e-4, 1e-4, 1e-4))
    found = estimate(session(made))[0]
    assert np.isnan(found.summary.compliance).all()
    assert np.isinf(found.summary.upper).all()
    assert np.isfinite(found.reference).all()


def test_errors():
    made, _, _ = pressing()
    quiet = eqx.tree_at(
        lambda r: (r.events.onset, r.events.release, r.events.contact),
        made,
        (np.zeros(0), np.zeros(0), np.zeros(0, np.int32)),
    )
    with pytest.raises(ValueError, match=r"no contact event in its trials \(trial00\)"):
        estimate(session(quiet))
    with pytest.raises(ValueError, match="unknown compliant joint 'toe'; the model has joint0"):
        estimate(session(made), EstimationOptions(joints=("toe",)))
    with pytest.raises(ValueError, match="unknown compliant joint 'heel'"):
        estimate(session(made), EstimationOptions(given={"heel": 1.0}))
    with pytest.raises(ValueError, match=r"window_after = 1\.5: a window is at most 1 s"):
        EstimationOptions(window_after=1.5)
    with pytest.raises(ValueError, match="no recording with the role 'trial' .roles: none"):
        estimate(session())
    with pytest.raises(ValueError, match="trial 'trial00': no contact forces"):
        estimate(session(without_forces(made)))


def without_forces(made):
    frames = len(np.asarray(made.time))
    return recording(
        chain(),
        np.asarray(made.time),
        np.asarray(made.q),
        np.zeros((frames, 0, 3)),
        np.zeros((frames, 0, 3)),
        bodies=(),
    )


def test_given_compliance_needs_no_event():
    """Section 8.2: forces were recorded, but the compliance comes from elsewhere."""
    made, reference, _ = pressing()
    quiet = eqx.tree_at(
        lambda r: (r.events.onset, r.events.release, r.events.contact),
        made,
        (np.zeros(0), np.zeros(0), np.zeros(0, np.int32)),
    )
    options = EstimationOptions(given=dict(zip(("joint0", "joint1", "joint2"), COMPLIANCE, strict=True)))
    found = estimate(session(quiet), options)[0]
    np.testing.assert_allclose(found.reference, reference, atol=1e-12)
    assert len(found.per_event.onset) == 0
