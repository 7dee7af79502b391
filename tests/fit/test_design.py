"""Expected intervals before anyone is recorded: closed forms, information sums, known facts of the finger."""

import dataclasses
import math

import numpy as np
import pytest

from icjax.fit import (
    FitOptions,
    Instruments,
    Parameters,
    PlannedMovement,
    Probe,
    Variability,
    design,
    finger_normal,
    finger_posture,
)
from icjax.fit._dynamic import Common
from icjax.fit._expected_contact import contact_force, intended, smooth_force, touch_of
from icjax.fit._planned_movement import typical_movement
from icjax.inference import QUANTILE, laplace
from icjax.model import index_finger, load_model

MODEL = index_finger(0.19, "fixed")
EXPLORING = tuple(np.radians((3.0, 18.0, 27.0, 20.0)))
TAP = Probe(EXPLORING, "fingertip", name="tap")
HOOKED = (3.0, 18.0, 70.0, 46.0)
PROBES = (
    TAP,
    Probe(finger_posture(MODEL, HOOKED), "fingertip", finger_normal(HOOKED, 0.0), name="hooked, flat pad"),
    Probe(EXPLORING, "fingertip", name="stroke", slide=(-0.1, 0, 0)),
    Probe(EXPLORING, "fingertip", name="fast tap", speed=0.2),
)


@pytest.fixture(scope="module")
def planned():
    return design(MODEL, PROBES)


def test_widths_follow_the_standard_deviation(planned):
    """Width = exp(2 * 1.96 s), 1 / s^2 what the data add to the prior's information; refused above `widest`."""
    known = planned.expected([0])
    added = 1.0 / known.sd**2 - 1.0 / FitOptions().compliance_sd ** 2
    np.testing.assert_allclose(known.width, np.exp(2 * QUANTILE / np.sqrt(added)), rtol=1e-9)
    np.testing.assert_array_equal(known.refused, known.width > FitOptions().widest)
    np.testing.assert_array_equal(planned.refused[0], known.refused)
    assert np.all((known.learned > 0) & (known.learned <= 1))


def test_information_of_independent_contacts_adds(planned):
    """Probes together never tell less; twice the contacts of one are the same as the probe taken twice."""
    both = planned.expected([0, 1])
    for alone in (planned.expected([0]), planned.expected([1])):
        assert np.all(both.sd <= alone.sd + 1e-12)
    np.testing.assert_allclose(planned.expected([0, 0]).sd, planned.expected([0], 24).sd, rtol=1e-9)


def test_many_contacts_reach_the_rate_of_independent_samples(planned):
    """Where the data speak alone, sd falls with at most the square root of the number of contacts, never faster."""
    few, many = planned.expected([1], 10).sd, planned.expected([1], 40).sd
    assert np.all(many >= 0.5 * few - 1e-12)
    assert np.all(many < few)


def test_more_catch_trials_and_more_speed_tell_more(planned):
    more = design(MODEL, PROBES[:1], catch_trials=8)
    assert np.all(more.expected([0]).sd < planned.expected([0]).sd)
    assert np.all(planned.expected([3]).sd[:2] < planned.expected([0]).sd[:2])


@pytest.fixture(scope="module")
def without_catch_trials():
    return design(MODEL, PROBES[:2], catch_trials=0)


def test_the_first_catch_trial_buys_most(planned, without_catch_trials):
    none, one = without_catch_trials, design(MODEL, PROBES[:2], catch_trials=1)
    bought = none.expected([1]).sd - one.expected([1]).sd
    assert np.all(bought > 3 * (one.expected([1]).sd - planned.expected([1]).sd))
    assert np.all(none.doubt > 2 * one.doubt)


def without_common(plan):
    """The plan if it were known what all contacts have in common."""
    at = plan.parameters.slices["common"]
    assert at.stop == plan.parameters.size
    return dataclasses.replace(
        plan,
        parameters=Parameters(plan.parameters.of[:-1]),
        factor=np.stack([np.linalg.qr(item[:, : at.start], mode="r") for item in plan.factor]),
        prior=plan.prior[: at.start - at.stop, : at.start],
    )


def test_what_contacts_have_in_common_is_integrated_out(without_catch_trials):
    """As `DynamicEquilibrium` does it: rows whitened by `Common`, whatever the number of contacts."""
    plan, own = without_catch_trials, without_common(without_catch_trials)
    at = plan.parameters.slices["common"]
    rows = np.sqrt(5) * np.concatenate(plan.factor)
    common = Common.of(rows[:, at])
    white = np.stack([np.asarray(common.whitened(column)) for column in rows[:, : at.start].T], axis=1)
    sd = np.asarray(laplace(white, own.prior).sd)[plan.parameters.slices["compliance"]]
    np.testing.assert_allclose(plan.expected([0, 1], 10).sd, sd, rtol=1e-6)


def test_what_contacts_have_in_common_does_not_average_out(without_catch_trials):
    """It matters the more the more contacts there are."""
    plan, own = without_catch_trials, without_common(without_catch_trials)
    few, many = (plan.expected([1], n).sd / own.expected([1], n).sd for n in (3, 1200))
    assert np.all((few >= 1.0) & (many > 3.0 * few))


def test_a_movement_that_is_known_is_as_good_as_repetitions(planned):
    """With next to no reach only tremor is left; with a longer one than typical intervals are wider."""
    typical = typical_movement(4)
    known, wild = (typical._replace(reach=scale * typical.reach) for scale in (1e-4, 2.0))
    sd = [design(MODEL, PROBES[1:2], 0, planned_movement=item).expected([0]).sd for item in (known, typical, wild)]
    assert np.all(sd[0] < planned.expected([1]).sd)
    assert np.all(sd[1] < sd[2])


def test_the_middle_joint_is_barely_loaded_by_a_tap_that_sticks(planned):
    """Bent further, with its pad flat on the surface, the finger tells all joints."""
    assert planned.refused[0, 2]
    assert not planned.refused[1].any()
    assert planned.torque[1, 2] > 3 * planned.torque[0, 2]
    assert planned.ranking()[0] == 1


def test_contacts_needed(planned):
    """With so many there is a number, with many fewer there is none; fewer than three are never fitted."""
    needed = planned.contacts_needed([0])
    assert needed[0] == 3
    assert planned.contacts_needed([1]).min() == 3
    assert needed[2] > 12
    assert not planned.expected([0], needed[2]).refused[2]
    assert planned.expected([0], 0.8 * needed[2]).refused[2]


def test_joints_beyond_the_contact_are_told_little():
    """A contact on the hand moves the wrist; the finger only lags behind it."""
    probe = Probe(EXPLORING, "hand", point=(0.05, 0.0, -0.02), name="hand on table")
    plan = design(MODEL, [probe])
    known = plan.expected([0])
    assert known.width[0] < 1.5
    assert known.refused[2:].all()
    assert np.all(np.diff(known.sd) > 0)
    np.testing.assert_array_equal(plan.torque[0, 1:], 0.0)


def test_the_contact_ends_at_static_equilibrium():
    """Without friction, once all is at rest: f = depth / (n J C J^T n + 1 / k) and e = C J^T f."""
    probe = dataclasses.replace(TAP, friction=0.0, depth=0.008)
    touch = touch_of(MODEL, (0, 1, 2, 3), probe)
    C = np.array([0.35, 1.0, 0.7, 2.0])
    nothing = np.zeros((4, 4))
    force, e = contact_force(probe, touch, (nothing, nothing, 1e-4 * np.eye(4)), C, 0.03, 1500, 0.002)
    J, n = touch.jacobian, np.asarray(probe.normal)
    static = 0.008 / (n @ J @ np.diag(C) @ J.T @ n + 1.0 / touch.stiffness)
    assert force[-1] @ n == pytest.approx(static, rel=1e-6)
    np.testing.assert_allclose(e[-1], C * (J.T @ force[-1]), rtol=1e-6)
    assert np.all(force[:, :2] == 0.0)


def test_friction_stays_in_its_cone_and_opposes_sliding():
    probe = dataclasses.replace(TAP, slide=(-0.3, 0.0, 0.0), friction=0.5)
    touch = touch_of(MODEL, (0, 1, 2, 3), probe)
    nothing = np.zeros((4, 4))
    force, _ = contact_force(probe, touch, (nothing, nothing, 1e-4 * np.eye(4)), np.full(4, 0.5), 0.03, 50, 0.002)
    normal, tangential = force[:, 2], force[:, 0]
    assert np.all(np.abs(tangential) <= 0.5 * normal + 1e-12)
    assert tangential[-1] == pytest.approx(0.5 * normal[-1])


def test_the_intended_movement_passes_the_surface_at_its_speed():
    probe = dataclasses.replace(TAP, depth=0.006, hover=0.02, speed=0.08)
    depth, speed = intended(probe, np.array([-1.0, 0.0, 1.0]))
    np.testing.assert_allclose(depth, [-0.02, 0.0, 0.006], atol=1e-12)
    np.testing.assert_allclose(speed, [0.0, 0.08, 0.0], atol=1e-12)


def test_the_filter_smooths_the_onset_only():
    force = np.ones((150, 3))
    smooth, rate = smooth_force(force, 100, 50, Instruments())
    assert smooth.shape == rate.shape == (151, 3)
    np.testing.assert_allclose(smooth[[0, -1], 0], [0.0, 1.0], atol=1e-3)
    assert smooth[100, 0] == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"speed": 0.0}, "speed = 0.0: must be above zero"),
        ({"speed": math.nan}, "speed"),
        ({"normal": (0, 0, 0)}, "normal"),
        ({"normal": (0, 1)}, "normal"),
        ({"duration": 0.01}, "duration"),
        ({"contacts": 0}, "contacts"),
        ({"friction": -0.1}, "friction"),
        ({"depth": 0.0}, "depth"),
        ({"q": (math.inf, 0, 0, 0)}, "q"),
    ],
)
def test_bad_probes(change, said):
    with pytest.raises(ValueError, match=said):
        dataclasses.replace(TAP, **change)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"q": (0.0,)}, "1 numbers, the model 4 coordinates"),
        ({"q": (0.0, 0.0, 3.0, 0.0)}, "PIP = 171.9 degrees; its range is"),
        ({"contact": "thumb"}, "'thumb' is no pad or body of the model"),
        ({"contact": "hand"}, "say which point"),
    ],
)
def test_probes_that_the_model_cannot_do(change, said):
    with pytest.raises(ValueError, match=said):
        design(MODEL, [dataclasses.replace(TAP, **change)])


def test_bad_designs(planned):
    with pytest.raises(ValueError, match="probes: none given"):
        design(MODEL, [])
    with pytest.raises(ValueError, match="two are named 'tap'"):
        design(MODEL, [TAP, TAP])
    for catch_trials in (-1, True):
        with pytest.raises(ValueError, match=f"catch_trials = {catch_trials}"):
            design(MODEL, [TAP], catch_trials=catch_trials)
    with pytest.raises(ValueError, match="no compliant joint"):
        design(dataclasses.replace(MODEL, compliance=np.zeros(4)), [TAP])
    with pytest.raises(ValueError, match="amplitude"):
        design(MODEL, [TAP], variability=Variability(np.ones((2, 3)), np.ones(3), 1.0))
    with pytest.raises(ValueError, match=r"planned_movement: reach is \[3\]"):
        design(MODEL, [TAP], 0, planned_movement=PlannedMovement(*np.ones((4, 3)), 1.0))
    with pytest.raises(ValueError, match="planned_movement: tremor = .*nan.*: must be above zero and finite"):
        design(MODEL, [TAP], 0, planned_movement=typical_movement(4)._replace(tremor=np.full(4, np.nan)))
    for contacts in (0, -1.0, math.nan):
        with pytest.raises(ValueError, match=f"contacts = {contacts}"):
            planned.expected([0], contacts=contacts)
    stiff = dataclasses.replace(TAP, pad_stiffness=1e6)  # widths would be those of a simulation that went astray
    with pytest.raises(ValueError, match=r"'tap': pad_stiffness = 1e\+06 N/m: its contact can be simulated up to 2"):
        design(MODEL, [stiff])
    with pytest.raises(ValueError, match="chosen"):
        planned.expected([7])
    with pytest.raises(ValueError, match="marker_sd"):
        Instruments(marker_sd=0.0)
    with pytest.raises(ValueError, match="belong together"):
        Instruments(angle_sd=0.001)


def test_without_marker_sites_angles_must_be_stated():
    bare = dataclasses.replace(MODEL, site_names=(), site_bodies=(), site_position=np.zeros((0, 3)))
    with pytest.raises(ValueError, match="do not determine 'wrist'; state angle_sd"):
        design(bare, [TAP])
    known = design(bare, [TAP], noise=Instruments(angle_sd=0.002, offset_sd=0.02)).expected([0])
    assert np.isfinite(known.width).all()


def test_a_ball_joint_is_refused():
    """As `fit_session` does: a fit takes hinges and slides only."""
    text = """<mujoco><worldbody><body name="arm"><joint name="shoulder" type="ball"/>
      <inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody></mujoco>"""
    with pytest.raises(ValueError, match="'shoulder' is a ball joint"):
        design(load_model(text), [Probe((1, 0, 0, 0), "arm", point=(0.2, 0, 0))])
