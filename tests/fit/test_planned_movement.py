"""Free movement as a process: what is learnt of it, and what it leaves open after contact."""

import dataclasses
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from scipy.optimize import minimize

from icjax.fit import _planned_movement, check_fit, fit_record, fit_session, fit_text
from icjax.fit._contacts import systematic
from icjax.fit._dynamic import Common
from icjax.fit._planned_movement import (
    BRAKING,
    GRID,
    STILL,
    PlannedMovement,
    Stretch,
    alike,
    free_stretches,
    learn_movement,
    pace,
    velocity,
)
from icjax.fit._variability import FAST, matern
from icjax.fit._windows import Motion

S = np.arange(-31, 13) * 0.008
NOISE = np.diag([1e-8, 4e-8])
WHITE = np.eye(len(S))
TRUTH = PlannedMovement(np.array([0.3, 0.1]), np.array([0.25, 0.4]), np.radians([0.03, 0.06]), np.ones(2), 1.0)


def stretches(count, generator):
    """Drawn from the process at known paces, which then are those of the drawn movement only roughly."""
    found = []
    for _ in range(count):
        speed = generator.uniform(0.3, 1.5, 2)
        K = TRUTH.covariance(S, speed, NOISE, WHITE).reshape(2 * len(S), -1)
        found.append(Stretch((np.linalg.cholesky(K) @ generator.standard_normal(2 * len(S))).reshape(len(S), 2)))
    return found


def test_length_and_calibration_are_learnt():
    """Foretold from what precedes it, movement that was not learnt from misses as much as is said."""
    generator = np.random.default_rng(3)
    found = learn_movement(S, stretches(120, generator), NOISE, WHITE)
    np.testing.assert_allclose(found.length, TRUTH.length, rtol=0.15)
    squares = []
    for angle, _ in stretches(120, generator):
        K = found.covariance(S, pace(S, angle), NOISE, WHITE).reshape(2 * len(S), -1)
        white = np.linalg.solve(np.linalg.cholesky(K), (angle - angle[:1]).ravel())
        squares.append(np.mean(white.reshape(angle.shape)[S > 0.0] ** 2))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.15)


def test_every_free_sample_counts_once():
    """Of free frames before and after a contact, less its margins; a stretch that is too short is not taken."""
    free = np.ones(330, bool)
    free[310] = False
    events = SimpleNamespace(onset=np.array([1.5]), release=np.array([1.6]))
    recording = SimpleNamespace(time=np.arange(330) / 100.0, touching=~free[:, None], events=events)
    motion = Motion(**dict.fromkeys(Motion._fields))._replace(
        recording=recording, valid=free, angle=np.arange(330.0)[:, None]
    )
    found = free_stretches(motion, samples=11, stride=4, margins=(0.1, 0.2))
    starts = sorted(int(item.angle[0, 0]) for item in found)
    assert all(np.array_equal(item.angle[:, 0], item.angle[0, 0] + 4.0 * np.arange(11)) for item in found)
    assert starts == [19, 39, 59, 79, 99, 189, 209, 229, 249, 269]
    held = {frame for start in starts for frame in range(start, start + 41)}
    assert sum(item.share for item in found) * 41 == pytest.approx(len(held), rel=0.02)


def test_what_is_learnt_is_the_best(monkeypatch):
    """The slope is that of the cost, and the minimum a twentieth of a standard deviation away at most."""
    ended = []

    def kept(cost, start, **others):
        ended.append((cost, minimize(cost, start, **others)))
        return ended[-1][1]

    monkeypatch.setattr(_planned_movement, "minimize", kept)
    found = learn_movement(S, stretches(60, np.random.default_rng(5)), NOISE, WHITE)
    for joint, (cost, end) in enumerate(ended):
        for x, tolerance in ((end.x, 0.05), (end.x + 0.1, 1e-3 * np.abs(end.fun) / 60)):
            slope = [(cost(x + 1e-3 * e)[0] - cost(x - 1e-3 * e)[0]) / 2e-3 for e in np.eye(4)]
            np.testing.assert_allclose(cost(x)[1], slope, atol=tolerance)
        assert cost(end.x)[1] @ found.doubt[joint] @ cost(end.x)[1] < 0.05**2


def test_movement_rougher_than_said_inflates():
    """Jumps after s = 0 that nothing before foretells raise the inflation."""
    generator = np.random.default_rng(4)
    smooth = stretches(40, generator)
    late = S[:, None] > 0.05
    jumps = [Stretch(angle + np.where(late, generator.choice([-0.3, 0.3]), 0.0)) for angle, _ in smooth]
    assert learn_movement(S, smooth, NOISE, WHITE).inflation < 1.3
    assert learn_movement(S, jumps, NOISE, WHITE).inflation > 1.5


def test_modes_are_the_conditional_covariance():
    """Of a noiseless process given all before contact; nothing before it."""
    at, modes = TRUTH.modes(0.25, 0.1)
    before = at <= 0.0
    for joint, part in enumerate(modes):
        assert not part[before].any()
        K = TRUTH.reach[joint] ** 2 * matern(at[:, None] - at[None, :], TRUTH.length[joint])
        K += 1e-10 * TRUTH.reach[joint] ** 2 * np.eye(len(at))
        schur = K[np.ix_(~before, ~before)] - K[np.ix_(~before, before)] @ np.linalg.solve(
            K[np.ix_(before, before)], K[np.ix_(before, ~before)]
        )
        found = part[~before] @ part[~before].T
        np.testing.assert_allclose(found, schur, atol=2e-3 * schur.max())
        np.testing.assert_array_less(np.linalg.norm(part[:, -1]), 0.01 * np.linalg.norm(part[:, 0]))
        assert part[-1, 0] != 0.0
    assert at[1] - at[0] == pytest.approx(GRID)


def test_pace():
    """Root mean square of the velocity before contact, and a floor for what rests."""
    ramp = np.stack([0.7 * S, 0.0 * S], axis=1) + np.where(S[:, None] > 0, 5.0, 0.0)
    np.testing.assert_allclose(pace(S, ramp), [np.hypot(0.7, STILL), STILL])
    assert S[1] - S[0] < FAST


def test_velocity():
    """Signed, of the last 40 ms before contact, whatever comes after."""
    ramp = np.stack([-0.7 * S, 0.2 * np.abs(S + 0.5 * BRAKING)], axis=1) + np.where(S[:, None] > 0, 5.0, 0.0)
    fine = np.linspace(-0.2, 0.1, 301)
    np.testing.assert_allclose(velocity(S, ramp)[0], -0.7)
    np.testing.assert_allclose(velocity(fine, np.abs(fine + 0.5 * BRAKING)[:, None]), [0.0], atol=1e-12)


def test_what_contacts_do_alike():
    """In proportion to pace, to signed velocity, and to torque whatever its unit; what is never pushed has none."""
    pace, torque = np.array([[1.0, 2.0], [3.0, 1.0]]), np.array([[0.03, 0.0], [-0.01, 0.0]])
    found = alike(pace, -pace, torque)
    np.testing.assert_array_equal(found[:, 0], pace)
    np.testing.assert_array_equal(found[:, 1], -pace)
    np.testing.assert_allclose(found[:, 2, 0], np.sqrt(5.0) * np.array([3.0, -1.0]) / np.sqrt(5.0))
    np.testing.assert_array_equal(found[:, 2, 1], 0.0)
    np.testing.assert_allclose(alike(pace, -pace, 1e3 * torque), found)
    at, modes = TRUTH.modes(0.25, 0.1)
    moved = systematic((at, modes), at, found[0])
    kinds = modes[0].shape[1]
    assert moved.shape == (len(at), 2, 2 * 3 * kinds)
    np.testing.assert_allclose(moved[:, 0, 2 * kinds : 3 * kinds], found[0, 2, 0] * modes[0])
    np.testing.assert_allclose(moved[:, 1, 4 * kinds : 5 * kinds], found[0, 1, 1] * modes[1])
    assert not moved[:, 0, 3 * kinds :].any()


def test_braking_in_proportion_to_velocity_is_not_taken_for_compliance():
    """Contacts of different speed, each slowed in proportion: the information about a yielding of that shape
    has a bound that no number of contacts exceeds, one over the sum of the three variances."""
    generator = np.random.default_rng(4)
    at, modes = TRUTH.modes(0.25, 0.1)
    for count in (5, 50):
        speed = generator.uniform(0.5, 1.5, (count, 1)) * np.ones((1, 2))
        sizes = alike(speed, speed, 0.02 * speed)
        A = np.concatenate([systematic((at, modes), at, size).reshape(-1, 36) / 0.01 for size in sizes])
        yielding = np.concatenate([(one * np.stack([modes[0][:, 0], 0 * at], axis=1)).ravel() for one in speed[:, :1]])
        white = np.asarray(Common.of(A).whitened(yielding / 0.01))
        assert 0.99 / 3.0 < white @ white < 1.0 / 3.0


def test_too_little_free_movement():
    with pytest.raises(ValueError, match=r"2 stretches of 0.34 s without contact"):
        learn_movement(S, [Stretch(np.zeros((len(S), 2)))] * 2, NOISE, WHITE)


@pytest.mark.slow
def test_without_catch_trials(session, fit):
    """Wider intervals that hold the truth, and everybody is told what is missing."""
    alone = dataclasses.replace(session, recordings=session.trials())
    found = fit_session(alone)
    for joint, other, truth in zip(found.joints, fit.joints, (0.25, 0.70, 0.45, 1.10), strict=True):
        assert joint.lower <= truth <= joint.upper
        assert joint.width > 1.15 * other.width or joint.width > 10.0
        if joint.refused:
            assert "catch trials" in joint.refused
    assert "catch trials are what is missing" in found.warnings[0]
    assert not any("catch" in text for text in fit.warnings)
    record = fit_record(found, alone)
    told = " ".join(fit_text(record).split())
    assert "against no catch trials" in told
    assert "catch trials are what is missing" in told
    assert record.catch_trials == 0
    assert np.isnan(record.variability).all()
    assert np.isfinite(record.planned_movement).all()
    assert not [line for line in check_fit(record) if line.startswith("error")]
    # what was planned and what contact did add up to what was measured, but for noise
    left = record.windows.angle - record.windows.repetition - record.windows.drift
    early = np.nan_to_num(record.windows.time - record.windows.onset[:, None], nan=1.0) < -0.05
    np.testing.assert_allclose(left[early], record.windows.deviation[early], atol=1e-9)


@pytest.mark.slow
def test_mixed_session(session, mixed):
    """A trial that lost its catch trials stays, beside one that has them."""
    windows = mixed.made.windows
    counts = {window.trial: len(window.repetitions) for window in windows}
    assert counts[session.trials()[0].name] == 0
    assert sorted(counts.values())[1] == 2
    basis = np.asarray(mixed.made.problem.measurements[0].common.basis).reshape(len(windows), -1)
    assert [bool(np.abs(item).max() > 1e-9) for item in basis] == [not w.repetitions for w in windows]


def test_common_part_is_integrated_out():
    """The same cost and the same information as with p among the numbers, and its mean."""
    generator = np.random.default_rng(8)
    A, r, J = generator.standard_normal((30, 4)), generator.standard_normal(30), generator.standard_normal((30, 2))
    common = Common.of(A)
    V = np.eye(30) + A @ A.T
    white = np.asarray(common.whitened(r))
    np.testing.assert_allclose(white @ white, r @ np.linalg.solve(V, r), rtol=1e-12)
    W = np.asarray(jax.vmap(common.whitened, in_axes=1, out_axes=1)(J))
    np.testing.assert_allclose(W.T @ W, J.T @ np.linalg.solve(V, J), rtol=1e-10)
    np.testing.assert_allclose(common.plain(white), r, atol=1e-12)
    p = np.linalg.solve(np.eye(4) + A.T @ A, A.T @ r)
    np.testing.assert_allclose(common.expected(r), A @ p, atol=1e-12)


def test_doubt_is_the_spread_over_people():
    """Reach and length learnt from many times 30 stretches scatter as one set's curvature says."""
    generator = np.random.default_rng(12)
    found = [learn_movement(S, stretches(30, generator), NOISE, WHITE) for _ in range(12)]
    told = np.sqrt(np.mean([np.diagonal(item.doubt, axis1=1, axis2=2) for item in found], axis=0))
    scattered = np.std(np.log([np.stack(item[:4]) for item in found]), axis=0, ddof=1).T
    ratio = scattered[:, :2] / told[:, :2]
    assert np.all(ratio > 0.5)
    assert np.all(ratio < 2.0)
