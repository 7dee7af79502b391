"""The spring law of the fingertip: Coulomb's cone, no creep, dissipation; the bump's closest point."""

import math

import numpy as np
import pytest

from icjax.laboratory._fingertip import Fingertip, closest_on_ellipse
from icjax.laboratory._subject import Subject
from icjax.laboratory._surface import Bump, Surface

DT = 0.00025
SUBJECT = Subject()
RADIUS = SUBJECT.pad_radius


def follow(path, friction=0.5, bump=None):
    tip = Fingertip(SUBJECT, Surface(friction=friction, bump=bump))
    return np.array([tip.touch(float(x), float(z), DT) for x, z in path])


def test_no_force_without_contact():
    assert np.all(follow([(0.0, RADIUS), (0.001, RADIUS + 1e-6)])[:, :2] == 0.0)


def test_static_press_is_a_spring():
    force = follow([(0.0, RADIUS - 0.001)] * 3)
    assert force[-1, 1] == pytest.approx(SUBJECT.pad_stiffness * 0.001, rel=1e-12)
    assert force[-1, 0] == 0.0
    assert force[-1, 3] == pytest.approx(0.0, abs=1e-15)  # the contact point lies on the plate


def test_stuck_fingertip_keeps_its_force_for_ten_seconds():
    shear = [(x, RADIUS - 0.001) for x in np.linspace(0.0, 0.0002, 200)]
    force = follow([*shear, *[shear[-1]] * 40_000])
    assert force[-1, 0] == pytest.approx(-SUBJECT.pad_stiffness * 0.0002, rel=1e-9)
    assert np.ptp(force[-39_000:, 0]) == 0.0


def test_force_stays_in_the_cone_and_slides_on_its_edge():
    generator = np.random.default_rng(3)
    x = np.cumsum(generator.standard_normal(4000)) * 2e-5
    z = RADIUS - 0.001 + 0.0012 * np.sin(np.linspace(0.0, 20.0, 4000))
    force = follow(np.column_stack([x, z]), friction=0.4)
    assert np.all(force[:, 1] >= 0.0)
    assert np.all(np.abs(force[:, 0]) <= 0.4 * force[:, 1] + 1e-12)
    slide = follow([(0.05 * DT * step, RADIUS - 0.001) for step in range(1000)], friction=0.4)
    assert slide[-1, 0] == pytest.approx(-0.4 * slide[-1, 1], rel=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.2])
def test_a_closed_cycle_takes_energy(friction):
    """Work done on the finger over a closed path is never positive, on the plate and on the bump."""
    phase = np.linspace(0.0, 2.0 * math.pi, 8001)
    path = np.column_stack([0.004 * np.sin(phase), RADIUS - 0.0005 + 0.002 * np.cos(phase)])
    for bump in (None, Bump(centre=(0.001, 0.0, 0.0), radii=(0.006, 0.03, 0.001))):
        force = follow(path, friction, bump)[:, :2]
        work = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(path, axis=0)))
        assert work < 0.0


@pytest.mark.parametrize(("a", "b"), [(0.012, 0.003), (0.004, 0.009), (0.01, 0.01)])
def test_closest_point_of_the_ellipse(a, b):
    """Against a search over 200 000 points of the curve; their spacing limits the agreement to 1e-9 m."""
    angle = np.linspace(-math.pi, math.pi, 200_001)
    curve = np.column_stack([a * np.cos(angle), b * np.sin(angle)])
    for x, z in [(0.0, b + 0.007), (0.006, 0.009), (-0.013, 0.004), (0.016, 1e-5), (0.001, -0.012)]:
        best = float(np.min(np.linalg.norm(curve - [x, z], axis=1)))
        on = np.asarray(closest_on_ellipse(x, z, a, b))
        assert (on[0] / a) ** 2 + (on[1] / b) ** 2 == pytest.approx(1.0, abs=1e-12)
        assert float(np.linalg.norm(on - [x, z])) == pytest.approx(best, abs=2e-8)
