"""Estimates over windows and degrees: equal to single estimates, and a rule that says in words what is wrong."""

import equinox as eqx
import numpy as np
import pytest
from hand_made import COMPLIANCE, pressing

from icjax.estimation import EstimationOptions, Sensitivity, compliance_at_contact, joint_torque, sensitivity
from icjax.estimation._stability import judge
from icjax.files import load_record, save_record

WINDOWS = (0.04, 0.06, 0.1)


def test_every_choice_is_the_single_estimate():
    made, _, tau = pressing(angle_noise=1e-4, torque_noise=5e-4)
    found = sensitivity((made,), WINDOWS, (1, 2), torques=(tau,), separate=True)
    assert found.compliance.shape == (2, 3, 9, 2)
    for index, (before, after) in enumerate(found.window):
        for column, degree in enumerate((1, 2)):
            options = EstimationOptions(window_before=before, window_after=after, degree=degree)
            single = compliance_at_contact((made,), options, (tau,))
            for name in ("compliance", "standard_error", "status"):
                np.testing.assert_array_equal(getattr(found, name)[..., index, column], getattr(single, name))


def test_stable_where_the_law_holds_and_torques_are_computed_where_absent():
    made, _, _ = pressing()
    found = sensitivity((made,), WINDOWS)
    assert found.stable.all()
    assert all(reason.startswith("stable: ") for row in found.reason for reason in row)
    # The law is exact, so every choice finds it but for rounding.
    expected = np.broadcast_to(np.asarray(COMPLIANCE)[:, None, None], found.pooled.shape)
    np.testing.assert_allclose(found.pooled, expected, rtol=1e-8)
    given = sensitivity((made,), WINDOWS, torques=(np.asarray(joint_torque(made)),))
    np.testing.assert_array_equal(found.compliance, given.compliance)
    assert [tuple(pair) for pair in found.window] == [(w, w) for w in WINDOWS]


def test_a_planned_turn_makes_the_windows_disagree():
    """The reference bends after contact against the torque, so long windows see what short ones do not."""
    made, _, tau = pressing(onsets=(0.4,), releases=(0.65,))
    s = np.clip(np.asarray(made.time) - 0.4, 0, 0.2)
    turned = eqx.tree_at(lambda r: r.q, made, np.asarray(made.q) - np.outer(s**2, [0.0, 2.0, 0.0]))
    found = sensitivity((turned,), (0.03, 0.05, 0.07, 0.1), (1,), torques=(tau,))
    assert found.stable[0].tolist() == [True, False, True]
    assert "changes sign" in found.reason[0][1]


def test_idle_joints_and_short_contacts_say_so():
    idle, _, tau = pressing(rates=(0.3, 0.2, 0.0))
    found = sensitivity((idle,), WINDOWS, torques=(tau,))
    assert found.reason[0][2] == "not excited for 6 of 6 choices: the torque changes by 0 mNm at most"
    short, _, tau = pressing(onsets=(0.4,), releases=(0.42,))
    found = sensitivity((short,), WINDOWS, torques=(tau,))
    assert "too few samples" in found.reason[0][0]
    assert not found.stable.any()


@pytest.mark.parametrize(
    ("values", "error", "stable", "words"),
    [
        ([1.0, 1.1, 0.9, 1.0], 0.1, True, "stable: 1 rad/Nm"),
        ([1.0, 1.1, 0.9, 1.0], 1.2, False, "undetermined: median 1 rad/Nm with a standard error of 1.2"),
        ([0.4, 1.0, 1.6, 2.2], 0.1, False, "spread over windows and degrees, more than its errors explain: 1.3 rad/Nm"),
        ([0.4, 1.0, 1.6, 2.2], 1.0, False, "which its errors explain: 1.3 rad/Nm, spread 0.89, standard error 1"),
        ([0.8, 1.1, 1.5, 1.8], 0.1, True, "stable: 1.3 rad/Nm, spread 0.52, standard error 0.1"),
        ([-0.2, 1.0, 1.1, 1.2], 0.1, False, "changes sign with the window or degree: 1 of 4 negative"),
        ([-1.0, -1.1, -0.9, 0.1], 0.1, False, "negative for 3 of 4 choices, median -0.95 rad/Nm"),
        ([-1.0, -1.1, 0.9, 0.1], 0.1, False, "changes sign with the window or degree: 2 of 4 negative"),
    ],
)
def test_the_rule(values, error, stable, words):
    """Worked by hand: the spread of 0.4, 1, 1.6, 2.2 is 1.4826 * 0.6 = 0.89, its limit half of 1.3."""
    table = np.asarray(values)[:, None]
    status = (table < 0).astype(int)
    verdict = judge(table, np.full_like(table, error), status, np.ones_like(table))
    assert verdict.stable == stable
    assert words in verdict.reason


def test_half_the_choices_without_an_estimate():
    status = np.array([[0], [2], [2], [3]])
    value = np.where(status == 0, 1.0, np.nan)
    change = np.array([[2e-3], [1e-3], [2.5e-3], [np.nan]])
    verdict = judge(value, np.full_like(value, 0.1), status, change)
    assert verdict.reason == "not excited for 2 of 4 choices: the torque changes by 2.5 mNm at most"


def test_it_is_a_record(tmp_path):
    made, _, tau = pressing()
    found = sensitivity((made,), WINDOWS, torques=(tau,))
    back = load_record(save_record(tmp_path / "sensitivity.nc", found), Sensitivity)
    assert back.reason == found.reason
    np.testing.assert_array_equal(back.stable, found.stable)
    np.testing.assert_array_equal(back.compliance, found.compliance)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"windows": ()}, r"windows = \(\): give at least one"),
        ({"windows": (0.1, 0.1)}, r"windows = \(0.1, 0.1\)"),
        ({"degrees": ()}, r"degrees = \(\)"),
        ({"degrees": (3,)}, "degree = 3"),
        ({"windows": (0.0,)}, "window_before = 0.0"),
    ],
)
def test_bad_choices_are_named(arguments, words):
    made, _, tau = pressing()
    with pytest.raises(ValueError, match=words):
        sensitivity((made,), torques=(tau,), **arguments)
