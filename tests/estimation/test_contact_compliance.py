"""The paper's estimate on recordings that are quasi-static, as it assumes, with the answer known."""

import equinox as eqx
import numpy as np
import pytest
from hand_made import COMPLIANCE, chain, pressing, ramps, recording, wrench_for

from icjax.estimation import EstimationOptions, compliance_at_contact
from icjax.interaction import STATUS

EXACT = 1e-8
"""Relative. The law holds exactly; slopes over 0.1 s amplify rounding of 1e-16 in the angles to about 1e-13."""


def statuses(result):
    return [[STATUS[code] for code in row] for row in np.asarray(result.status)]


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("window", [0.04, 0.1])
def test_exact_where_the_law_holds(degree, window):
    """Constant approach speed, linear torque: Figure 3's case. Quadratic windows also take a bent approach."""
    bend = (0.3, -0.5, 0.2) if degree == 2 else (0.0, 0.0, 0.0)
    made, _, _ = pressing(bend=bend)
    options = EstimationOptions(window_before=window, window_after=window, degree=degree)
    result = compliance_at_contact((made,), options)
    assert statuses(result) == [["accepted"] * 3] * 2
    np.testing.assert_allclose(result.compliance, np.tile(COMPLIANCE, (2, 1)), rtol=EXACT)
    assert np.all(np.asarray(result.standard_error) < 1e-6)
    assert np.all(np.asarray(result.r_squared) > 1 - 1e-9)
    np.testing.assert_allclose(result.torque_change, np.tile([0.3, 0.2, 0.06], (2, 1)) * window, rtol=1e-6)
    assert result.joint_names == ("joint0", "joint1", "joint2")
    assert result.recording == ("trial00", "trial00")
    np.testing.assert_array_equal(result.window, [window, window])


def test_the_polynomials_are_what_was_fitted():
    made, reference, tau = pressing()
    result = compliance_at_contact((made,), EstimationOptions(degree=2))
    s = np.asarray(made.time) - 0.4
    poly = np.polynomial.polynomial.polyval
    before, after = (s <= 0) & (s >= -0.1), (s > 0) & (s <= 0.1)
    for joint in range(3):
        angle = np.asarray(made.q)[:, joint]
        np.testing.assert_allclose(poly(s[before], result.angle_before[0, joint]), angle[before], atol=1e-10)
        np.testing.assert_allclose(poly(s[after], result.angle_after[0, joint]), angle[after], atol=1e-10)
        np.testing.assert_allclose(poly(s[after], result.torque_after[0, joint]), tau[after, joint], atol=1e-10)
        extrapolated = poly(s[after], result.angle_before[0, joint])
        np.testing.assert_allclose(extrapolated, reference[after, joint], atol=1e-9)


def test_onset_between_samples():
    made, _, _ = pressing(onsets=(0.4007,), releases=(0.6513,))
    result = compliance_at_contact((made,))
    np.testing.assert_allclose(result.compliance, [COMPLIANCE], rtol=EXACT)


@pytest.mark.parametrize("degree", [1, 2])
def test_bias_of_a_turn_after_contact_vanishes_with_the_window(degree):
    """theta_r that bends from the contact on: right in the limit of short windows, with the fit's order."""
    model = chain()
    rate, onset = 20000.0, 0.2
    time = np.arange(round(0.35 * rate)) / rate
    tau = ramps(time, (onset,), (2.0,), (0.3, 0.2, 0.1))
    s = time - onset
    bend = 3.0 * s**2 if degree == 1 else 3.0 * s**2 + 100.0 * s**3
    q = 0.5 + 0.4 * s[:, None] + np.where(s > 0, bend, 0.0)[:, None] + tau * np.asarray(COMPLIANCE)
    nothing = np.zeros((len(time), 1, 3))
    made = recording(model, time, q, nothing, nothing, events=((onset,), (np.nan,), (0,)))
    error = []
    for window in (0.08, 0.04):
        options = EstimationOptions(window_before=window, window_after=window, degree=degree)
        error.append(abs(np.asarray(compliance_at_contact((made,), options, (tau,)).compliance)[0] - COMPLIANCE).max())
    assert np.log2(error[0] / error[1]) == pytest.approx(degree, abs=0.35)


def test_standard_error_covers_under_white_noise():
    """150 seeded repetitions with 0.05 degrees of angle noise and 0.5 mNm of torque noise, three joints each.

    Counting error of 450 intervals: 3 sd = 3.1 %; see the slope test for the small over-coverage.
    """
    hits, total = 0, 0
    base, _, tau = pressing(onsets=(0.4,), releases=(0.65,))
    random = np.random.default_rng(3)
    sd = np.radians(0.05)
    options = EstimationOptions(degree=1)
    for _ in range(150):
        q = np.asarray(base.q) + sd * random.standard_normal(base.q.shape)
        noisy = tau + 5e-4 * random.standard_normal(tau.shape)
        made = eqx.tree_at(lambda r: r.q, base, q)
        result = compliance_at_contact((made,), options, (noisy,))
        used = np.asarray(result.status)[0] <= 1
        miss = np.abs(np.asarray(result.compliance)[0] - COMPLIANCE)[used]
        hits += int(np.sum(miss <= 1.96 * np.asarray(result.standard_error)[0, used]))
        total += int(used.sum())
    assert total == 450
    assert 0.915 <= hits / total <= 0.99


def test_stated_covariance_is_a_floor_of_the_error():
    quiet, _, _ = pressing()
    stated, _, _ = pressing(q_sd=1e-3)
    without = np.asarray(compliance_at_contact((quiet,)).standard_error)
    with_floor = np.asarray(compliance_at_contact((stated,)).standard_error)
    assert np.all(with_floor > 1e3 * without)


def test_negative_estimate_is_kept_and_marked():
    """Figure 8: a planned acceleration into the contact looks like negative compliance."""
    made, _, tau = pressing(onsets=(0.4,), releases=(0.65,))
    s = np.clip(np.asarray(made.time) - 0.4, 0, 0.2)
    planned = np.asarray(made.q) - np.outer(s, [0.0, 0.5, 0.0])
    point, force, moment = wrench_for(made.model, planned, tau)
    pushed = eqx.tree_at(
        lambda r: (r.q, r.contact_point, r.contact_force, r.contact_moment), made, (planned, point, force, moment)
    )
    result = compliance_at_contact((pushed,))
    assert statuses(result) == [["accepted", "negative", "accepted"]]
    assert float(result.compliance[0, 1]) == pytest.approx(COMPLIANCE[1] - 0.5 / 0.2, rel=1e-6)
    assert np.isfinite(result.standard_error[0, 1])
    assert np.isfinite(result.angle_before[0, 1]).all()


def test_not_excited():
    """A joint whose torque does not change beyond its noise has no estimate, but its fits are kept."""
    made, _, tau = pressing(rates=(0.3, 0.2, 0.0))
    result = compliance_at_contact((made,))
    assert statuses(result) == [["accepted", "accepted", "not excited"]] * 2
    assert np.isnan(result.compliance[:, 2]).all()
    assert np.isinf(result.standard_error[:, 2]).all()
    assert np.isfinite(result.torque_after).all()
    noisy = tau + 0.05 * np.random.default_rng(0).standard_normal(tau.shape)
    assert statuses(compliance_at_contact((made,), None, (noisy,)))[0] == ["not excited"] * 3
    demanding = EstimationOptions(least_torque=0.025)
    assert statuses(compliance_at_contact((made,), demanding))[0] == ["accepted", "not excited", "not excited"]


def test_too_few_samples_at_the_ends_and_in_gaps():
    early, _, _ = pressing(onsets=(0.03,), releases=(0.3,))
    assert statuses(compliance_at_contact((early,))) == [["too few samples"] * 3]
    late, _, _ = pressing(onsets=(1.57,), releases=(np.inf,))
    assert statuses(compliance_at_contact((late,))) == [["too few samples"] * 3]
    short, _, _ = pressing(onsets=(0.4,), releases=(0.43,))
    assert statuses(compliance_at_contact((short,))) == [["too few samples"] * 3]
    close, _, _ = pressing(onsets=(0.4, 0.68), releases=(0.65, 0.9))
    assert statuses(compliance_at_contact((close,))) == [["accepted"] * 3, ["too few samples"] * 3]
    made, _, _ = pressing()
    gap = (np.asarray(made.time) > 0.41) & (np.asarray(made.time) < 0.49)
    blind = eqx.tree_at(lambda r: (r.valid, r.q), made, (~gap, np.where(gap[:, None], np.nan, made.q)))
    result = compliance_at_contact((blind,))
    assert statuses(result) == [["too few samples"] * 3, ["accepted"] * 3]
    assert np.isnan(result.compliance[0]).all()
    assert np.isnan(result.angle_before[0]).all()
    short_gap = (np.asarray(made.time) > 0.44) & (np.asarray(made.time) < 0.46)
    holed = eqx.tree_at(lambda r: (r.valid, r.q), made, (~short_gap, np.where(short_gap[:, None], np.nan, made.q)))
    np.testing.assert_allclose(compliance_at_contact((holed,)).compliance[0], COMPLIANCE, rtol=EXACT)


def test_another_contact_matters_only_where_it_loads_the_joint():
    """Two fingers on one base touch at almost the same time: each finger's joints keep their own estimate."""
    model = chain(branches=2)
    one, _, tau = pressing(onsets=(0.4,), releases=(0.65,))
    two, _, _ = pressing(onsets=(0.43,), releases=(0.65,))
    q = np.concatenate([one.q, two.q], axis=1)
    aside = np.array([0.0, 0.1, 0.0])

    def join(field):
        return np.concatenate([getattr(one, field), getattr(two, field)], axis=1)

    point = join("contact_point") + np.stack([np.zeros(3), aside])[None]
    both = recording(
        model,
        np.asarray(one.time),
        q,
        join("contact_force"),
        point,
        moment=join("contact_moment"),
        touching=join("touching"),
        events=((0.4, 0.43), (0.65, 0.65), (0, 1)),
    )
    result = compliance_at_contact((both,))
    accepted, idle = ["accepted"] * 3, ["not excited"] * 3
    assert statuses(result)[0][:3] == accepted
    assert statuses(result)[1][3:] == accepted
    assert statuses(result)[1][:3] == idle
    np.testing.assert_allclose(result.compliance[0, :3], COMPLIANCE, rtol=EXACT)
    np.testing.assert_allclose(result.compliance[1, 3:], COMPLIANCE, rtol=EXACT)
    assert tau.shape == (len(one.time), 3)


def test_ball_joints_are_estimated_in_their_tangent():
    """A single ball joint that turns about a fixed axis is a hinge about it: same answer on that axis."""
    from icjax.model import integrate

    model = chain(lengths=(0.1,), compliance=(0.8,), kind="ball")
    time = np.arange(801) / 500.0
    tau = ramps(time, (0.4,), (0.9,), (0.0, 0.3, 0.0))
    angle = 0.3 + 0.4 * time[:, None] * np.array([0.0, 1.0, 0.0]) + 0.8 * tau
    q = np.stack([np.asarray(integrate(model, np.asarray(model.zero), a)) for a in angle[::1]])
    made = recording(
        model,
        time,
        q,
        np.zeros((len(time), 1, 3)),
        np.zeros((len(time), 1, 3)),
        events=((0.4,), (0.9,), (0,)),
        touching=(tau[:, 1:2] > 0),
    )
    result = compliance_at_contact((made,), EstimationOptions(degree=1), (tau,))
    assert result.joint_names == ("joint0_x", "joint0_y", "joint0_z")
    assert statuses(result) == [["not excited", "accepted", "not excited"]]


def test_chosen_joints_and_unknown_ones():
    made, _, _ = pressing()
    result = compliance_at_contact((made,), EstimationOptions(joints=("joint2", "joint0")))
    assert result.joint_names == ("joint0", "joint2")
    with pytest.raises(ValueError, match="unknown compliant joint 'thumb'; the model has joint0, joint1, joint2"):
        compliance_at_contact((made,), EstimationOptions(joints=("thumb",)))
    with pytest.raises(ValueError, match="recordings: none given"):
        compliance_at_contact(())


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"window_before": 0.0}, "window_before = 0.0: a window must be longer"),
        ({"window_after": -0.1}, "window_after = -0.1"),
        ({"window_after": float("nan")}, "window_after = nan"),
        ({"degree": 3}, "degree = 3"),
        ({"coverage": 0.0}, "coverage = 0.0"),
        ({"coverage": 1.5}, "coverage = 1.5"),
        ({"excitation": -1.0}, "excitation = -1.0"),
        ({"blend": -0.01}, "blend = -0.01"),
        ({"given": {"MP": -1.0}}, r"given\['MP'\] = -1.0"),
        ({"given_sd": {"MP": 1.0}}, r"given_sd\['MP'\]"),
    ],
)
def test_options_are_checked(wrong, words):
    with pytest.raises(ValueError, match=words):
        EstimationOptions(**wrong)
