"""Reference trajectory and the compliance held along it: Eq. 1, continuity, sources, uncertainty."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hand_made import COMPLIANCE, chain, pressing, recording

from icjax.estimation import (
    EstimationOptions,
    compliance_at_contact,
    compliance_path,
    joint_torque,
    reference_trajectory,
    summarise,
)
from icjax.model import difference, human_hand, integrate

IDENTITY = 1e-12
"""Eq. 1 holds by construction; only rounding of numbers of order one is left."""


def path_of(made, options=None):
    options = options or EstimationOptions()
    events = compliance_at_contact((made,), options)
    return compliance_path(made, events, summarise(events), options), events


def two_events(second=(0.5, 0.3, 1.0), gap=0.35):
    """Compliance differs between the two contacts; contacts from 0.4 to 0.65 and from 0.65 + gap on."""
    onset = 0.65 + gap
    made, reference, tau = pressing(onsets=(0.4, onset), releases=(0.65, onset + 0.25), later=second)
    return made, reference, tau, onset


@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_equation_1(kind):
    model = chain(kind=kind)
    random = np.random.default_rng(4)
    home = np.asarray(model.zero)
    q = jax.vmap(lambda dq: integrate(model, home, dq))(0.6 * random.standard_normal((20, model.nv)))
    tau = 0.2 * random.standard_normal((20, model.nv))
    tau[5] = 0.0
    compliance = random.uniform(0.1, 2.0, (20, model.nv))
    reference = reference_trajectory(model, q, tau, compliance)
    back = jax.vmap(lambda a, b: difference(model, a, b))(reference, q)
    np.testing.assert_allclose(back, compliance * tau, atol=IDENTITY)
    np.testing.assert_allclose(reference[5], q[5], atol=1e-15)


def test_reference_derivatives():
    """Forward = reverse = closed form for a hinge: d theta_r / d C = -tau."""
    model = chain()
    q, tau, compliance = jnp.zeros((2, 3)), jnp.array([[0.1, 0.2, 0.0], [0.0, -0.3, 0.1]]), jnp.ones((2, 3))

    def total(c):
        return jnp.sum(reference_trajectory(model, q, tau, c))

    np.testing.assert_allclose(jax.grad(total)(compliance), -tau, atol=1e-15)
    np.testing.assert_allclose(jax.jacfwd(total)(compliance), -tau, atol=1e-15)


@pytest.mark.parametrize("gap", [0.35, 0.13])
def test_reference_is_recovered_and_continuous(gap):
    """With each event's own compliance the reference is the straight line it was made from, kinks and all."""
    made, reference, tau, _ = two_events(gap=gap)
    path, events = path_of(made)
    np.testing.assert_allclose(events.compliance, [COMPLIANCE, (0.5, 0.3, 1.0)], rtol=1e-8)
    found = np.asarray(reference_trajectory(made.model, made.q, np.asarray(joint_torque(made)), path.compliance))
    np.testing.assert_allclose(found, reference, atol=1e-8)
    step = np.abs(np.diff(found, axis=0)).max(axis=0)
    np.testing.assert_allclose(step, np.abs([0.4, 0.2, 0.3]) / 500, rtol=1e-4)
    free = np.asarray(tau)[:, 0] == 0
    np.testing.assert_array_equal(found[free], np.asarray(made.q)[free])


def test_compliance_is_held_and_blended_in_before_the_event():
    made, _, _, onset = two_events()
    path, _ = path_of(made, EstimationOptions(blend=0.05))
    time = np.asarray(made.time)
    held = (time >= 0.4) & (time <= onset - 0.05)
    np.testing.assert_allclose(path.compliance[held], np.tile(COMPLIANCE, (held.sum(), 1)), rtol=1e-8)
    after = time >= onset
    np.testing.assert_allclose(path.compliance[after, 0], 0.5, rtol=1e-8)
    middle = np.argmin(np.abs(time - (onset - 0.025)))
    assert path.compliance[middle, 0] == pytest.approx((COMPLIANCE[0] + 0.5) / 2, abs=0.02)
    fastest = np.abs(np.diff(path.compliance[:, 0])).max()
    assert fastest <= 1.5 * (COMPLIANCE[0] - 0.5) / (0.05 * 500) * 1.001


def test_blend_waits_for_the_release():
    made, _, tau, onset = two_events(gap=0.13)
    path, _ = path_of(made, EstimationOptions(blend=0.5))
    loaded = (np.asarray(tau)[:, 0] != 0) & (np.asarray(made.time) < 0.65)
    np.testing.assert_allclose(path.compliance[loaded & (np.asarray(made.time) >= 0.4), 0], COMPLIANCE[0], rtol=1e-8)
    assert np.abs(np.diff(path.compliance[:, 0])).max() < 0.02
    assert onset == pytest.approx(0.78)


def test_zero_blend_steps_at_the_onset():
    made, _, _, onset = two_events()
    path, _ = path_of(made, EstimationOptions(blend=0.0))
    changed = np.flatnonzero(np.abs(np.diff(path.compliance[:, 0])) > 1e-6)
    np.testing.assert_allclose(np.asarray(made.time)[changed + 1], [0.4, onset], atol=0.0021)


def test_an_event_that_knows_nothing_does_not_stand_for_itself():
    """A standard error as large as the value: the pooled value is held there, and stated for it."""
    made, _, _, onset = two_events()
    events = compliance_at_contact((made,))
    error = np.array(events.standard_error)
    error[1, 0] = 1.01 * float(events.compliance[1, 0])
    events = eqx.tree_at(lambda e: e.standard_error, events, error)
    summary = summarise(events)
    path = compliance_path(made, events, summary)
    assert path.sources["joint0"] == ("session", "event", "session")
    assert path.sources["joint1"] == ("session", "event", "event")
    after = np.asarray(made.time) >= onset
    np.testing.assert_array_equal(path.compliance[after, 0], float(summary.compliance[0]))
    np.testing.assert_allclose(path.compliance[after, 1], 0.3, rtol=1e-8)


def test_sources_and_their_fallbacks():
    made, _, _ = pressing(rates=(0.3, 0.2, 0.0))
    path, events = path_of(made)
    assert path.sources["joint0"] == ("session", "event", "event")
    assert path.sources["joint2"] == ("stated by the model",) * 3
    np.testing.assert_array_equal(path.compliance[:, 2], COMPLIANCE[2])
    np.testing.assert_array_equal(path.compliance_sd[:, 2], 0.5 * COMPLIANCE[2])
    pooled, _ = path_of(made, EstimationOptions(source="session"))
    assert pooled.sources["joint0"] == ("session",) * 3
    assert np.ptp(pooled.compliance[:, 0]) == 0
    given, _ = path_of(made, EstimationOptions(given={"joint0": 0.3}, given_sd={"joint0": 0.02}))
    assert given.sources["joint0"] == ("given",) * 3
    np.testing.assert_array_equal(given.compliance[:, 0], 0.3)
    np.testing.assert_array_equal(given.compliance_sd[:, 0], 0.02)
    unstated = eqx.tree_at(lambda r: r.model.compliance, made, np.array([0.9, 0.7, np.inf]))
    unknown = compliance_path(unstated, events, summarise(events))
    assert unknown.sources["joint2"][0] == "unknown, treated as rigid"
    np.testing.assert_array_equal(unknown.compliance[:, 2], 0.0)
    assert np.isinf(unknown.compliance_sd[:, 2]).all()


def test_a_root_yields_as_the_model_states():
    """The arm behind a hand (Section 6.2); a driven root does not."""
    for root, expected in (("compliant", True), ("free", False)):
        model = human_hand(root=root)
        time = np.arange(200) / 500
        q = np.tile(np.asarray(model.rest), (len(time), 1))
        pads = len(model.pad_names)
        made = recording(model, time, q, np.zeros((len(time), pads, 3)), np.full((len(time), pads, 3), np.nan))
        path, _ = path_of(made)
        arm = slice(0, 6)
        stated = np.asarray(model.compliance)[arm] if expected else np.zeros(6)
        assert np.all(stated > 0) == expected
        np.testing.assert_array_equal(path.compliance[:, arm], np.tile(stated, (len(time), 1)))
        np.testing.assert_array_equal(path.compliance_sd[:, arm], 0.5 * np.tile(stated, (len(time), 1)))
        assert ("root_x" in path.sources) == expected
