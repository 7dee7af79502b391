"""Pooling: exact where events agree, robust to strays, and intervals that cover."""

import numpy as np
import pytest

from icjax.estimation import pool, summarise
from icjax.interaction import CompliancePerEvent


def per_event(compliance, error, status):
    compliance = np.asarray(compliance, float)
    events, joints = compliance.shape
    fits = np.zeros((events, joints, 3))
    return CompliancePerEvent(
        recording=("trial00",) * events,
        joint_names=tuple(f"joint{j}" for j in range(joints)),
        onset=np.arange(events, dtype=float),
        compliance=compliance,
        standard_error=np.asarray(error, float),
        status=np.asarray(status, np.int32),
        r_squared=fits,
        torque_change=np.ones((events, joints)),
        angle_before=fits,
        angle_after=fits,
        torque_after=fits,
        window=np.array([0.1, 0.1]),
    )


def test_no_one_and_equal_values():
    value, lower, upper = pool(np.zeros(0), np.zeros(0))
    assert np.isnan(value)
    assert (lower, upper) == (-np.inf, np.inf)
    assert pool(np.array([0.5]), np.array([0.1])) == pytest.approx((0.5, 0.5 - 0.196, 0.5 + 0.196))
    value, lower, upper = pool(np.full(4, 0.7), np.zeros(4))
    assert value == pytest.approx(0.7)
    assert upper - lower < 1e-10


def test_equal_errors_without_strays_give_the_mean_and_student_interval():
    """Three values: mean, and half width t(2) sd / sqrt(3) (t = 4.302653, sd = 0.1)."""
    value, lower, upper = pool(np.array([0.9, 1.0, 1.1]), np.full(3, 0.01))
    assert value == pytest.approx(1.0)
    assert upper - value == pytest.approx(4.302653 * 0.1 / np.sqrt(3), rel=1e-6)
    assert value - lower == pytest.approx(upper - value)


def test_a_stray_event_moves_the_value_little():
    random = np.random.default_rng(0)
    values = 1.0 + 0.1 * random.standard_normal(20)
    clean, _, _ = pool(values, np.full(20, 0.05))
    stray = values.copy()
    stray[3] = 50.0
    robust, _, _ = pool(stray, np.full(20, 0.05))
    assert abs(robust - clean) < 0.05 < abs(stray.mean() - clean)


def test_precise_events_count_more():
    value, _, _ = pool(np.array([1.0, 1.0, 1.02, 5.0]), np.array([0.05, 0.05, 0.05, 10.0]))
    assert value == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("scatter", [0.0, 0.2])
def test_intervals_cover(scatter):
    """Events with unequal errors and a scatter of their own, 400 seeded sessions of 12.

    Counting error: 3 sd = 3.3 %. Over-coverage is expected: the interval takes the larger of two variances.
    """
    random = np.random.default_rng(5)
    hits = 0
    for _ in range(400):
        errors = random.uniform(0.05, 0.3, 12)
        values = 1.0 + scatter * random.standard_normal(12) + errors * random.standard_normal(12)
        _, lower, upper = pool(values, errors)
        hits += lower <= 1.0 <= upper
    assert 0.92 <= hits / 400 <= 0.995


def test_summary_counts_bounds_and_refuses():
    """Columns: ordinary; none excited; only negative beyond doubt; negative but for its interval."""
    compliance = [
        [1.0, np.nan, -2.0, -0.1],
        [1.2, np.nan, -2.1, 0.05],
        [-0.2, np.nan, -1.9, -0.2],
        [1.1, np.nan, -2.0, 0.1],
    ]
    error = [[0.1, np.inf, 0.01, 0.1]] * 4
    status = [[0, 2, 1, 1], [0, 3, 1, 0], [1, 2, 1, 1], [0, 2, 1, 0]]
    found = summarise(per_event(compliance, error, status))
    np.testing.assert_array_equal(found.accepted, [3, 0, 0, 2])
    np.testing.assert_array_equal(found.negative, [1, 0, 4, 2])
    np.testing.assert_array_equal(found.events, [4, 4, 4, 4])
    assert 0 < found.compliance[0] < 1.1
    assert np.isnan(found.compliance[1:]).all()
    assert np.all(np.asarray(found.lower) >= 0)
    np.testing.assert_array_equal(found.lower[1:], [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(found.upper[1:3], [np.inf, np.inf])
    assert 0 < found.upper[3] < 1


def test_without_an_accepted_event_there_is_no_bound():
    """Two negative estimates whose interval reaches far above zero: no movement supports "less than"."""
    found = summarise(per_event([[-0.5], [-0.1]], [[2.0]] * 2, [[1], [1]]))
    assert np.isnan(found.compliance[0])
    assert (float(found.lower[0]), float(found.upper[0])) == (0.0, np.inf)
    one = summarise(per_event([[-0.5], [0.1]], [[2.0]] * 2, [[1], [0]]))
    assert np.isfinite(one.upper[0])


@pytest.mark.parametrize("true", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("count", [2, 6, 20])
def test_bounds_and_intervals_cover_a_stiff_joint(true, count):
    """Errors of 0.3 to 0.6 rad/Nm about a compliance of 0 to 0.5: what is printed, interval, "less than" or nothing,
    holds the truth in 250 seeded sessions. Counting error: 3 sd = 4.1 % below 95 %. At zero nearly all are bounds.
    """
    random = np.random.default_rng(11)
    held = bounds = 0
    for _ in range(250):
        errors = random.uniform(0.3, 0.6, (count, 1))
        values = true + errors * random.standard_normal((count, 1))
        found = summarise(per_event(values, errors, (values < 0).astype(int)))
        held += bool(found.lower[0] <= true <= found.upper[0])
        bounds += bool(found.lower[0] == 0 and np.isfinite(found.upper[0]))
    assert held / 250 >= 0.909
    assert true > 0 or bounds / 250 > 0.7


def test_leaving_negative_events_out_raises_the_value():
    compliance, error, status = [[1.0], [1.2], [-0.2], [1.1]], [[0.1]] * 4, [[0], [0], [1], [0]]
    kept = summarise(per_event(compliance, error, status))
    dropped = summarise(per_event(compliance, error, status), pool_negative=False)
    assert dropped.compliance[0] == pytest.approx(1.1, abs=1e-6)
    assert kept.compliance[0] < dropped.compliance[0]
    assert int(dropped.negative[0]) == 1
