"""The inertial correction of Eq. 2 on a joint whose whole dynamics are known."""

import dataclasses

import equinox as eqx
import hand_made
import numpy as np
import pytest

from icjax.estimation import EstimationOptions, compliance_at_contact

RATE, ONSET, RELEASE = 1000.0, 0.5, 0.7
COMPLIANCE, INERTIA, DAMPING = 0.5, 2e-3, 0.01
OPTIONS = EstimationOptions(inertia_cutoff=200.0)


@pytest.fixture(scope="module")
def pressed():
    """A hinge that moves on a parabola and deviates from it after contact by e = 0.6 s + 4 s^2 (rad).

    The contact supplies M e'' + B e' + e / C exactly, but for the impulse that the sudden slope would need.
    """
    model = hand_made.chain((0.05,), (COMPLIANCE,))
    model = eqx.tree_at(
        lambda item: (item.armature, item.damping), model, (np.array([INERTIA - 1e-6]), np.array([DAMPING]))
    )
    time = np.arange(1000) / RATE
    s = time - ONSET
    touching = (s > 0) & (time < RELEASE)
    deviation = np.where(s > 0, 0.6 * s + 4.0 * s**2, 0.0)
    torque = INERTIA * 8.0 + DAMPING * (0.6 + 8.0 * s) + deviation / COMPLIANCE
    force = np.zeros((1000, 1, 3))
    force[:, 0, 2] = np.where(touching, -torque / 0.05, 0.0)
    point = np.tile([0.05, 0.0, 0.0], (1000, 1, 1))
    q = (0.3 + 0.5 * s - 2.0 * s**2 + deviation)[:, None]
    events = ((ONSET,), (RELEASE,), (0,))
    return hand_made.recording(model, time, q, force, point, touching=touching[:, None], events=events)


def test_the_correction_restores_the_spring(pressed):
    """Without it the joint looks too stiff: the constant 16 + 6 mNm at the contact are read as a steeper rise.

    2 %: the smoothing spline blurs the corner at the contact over 1 / 200 Hz, a twentieth of the window.
    """
    static = compliance_at_contact((pressed,), OPTIONS).compliance[0, 0]
    moving = compliance_at_contact((pressed,), dataclasses.replace(OPTIONS, inertia=True)).compliance[0, 0]
    assert static < 0.85 * COMPLIANCE
    assert moving == pytest.approx(COMPLIANCE, rel=0.02)


def test_without_masses_and_damping_nothing_changes(pressed):
    """A model of (nearly) no inertia: the option alters nothing."""
    model = pressed.model
    light = eqx.tree_at(lambda item: (item.model.armature, item.model.damping), pressed, (np.zeros(1), np.zeros(1)))
    light = eqx.tree_at(lambda item: item.model.body_inertia, light, 1e-6 * model.body_inertia)
    for degree in (1, 2):
        options = dataclasses.replace(OPTIONS, degree=degree)
        static = compliance_at_contact((light,), options)
        moving = compliance_at_contact((light,), dataclasses.replace(options, inertia=True))
        np.testing.assert_allclose(moving.compliance, static.compliance, rtol=1e-6)  # 1e-12 kg m2 are left


def test_too_few_frames_before_the_contact_give_no_correction(pressed):
    valid = np.arange(1000) >= 497
    moving = compliance_at_contact(
        (eqx.tree_at(lambda item: item.valid, pressed, valid),), dataclasses.replace(OPTIONS, inertia=True)
    )
    assert np.isnan(moving.compliance).all()


def test_the_cutoff_is_checked():
    with pytest.raises(ValueError, match="inertia_cutoff"):
        EstimationOptions(inertia_cutoff=0.0)
