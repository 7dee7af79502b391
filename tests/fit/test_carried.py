"""The rest of the body, pushed aside by a contact: what of its movement the force explains."""

import jax.numpy as jnp
import numpy as np

from icjax.fit._carried import Pushed, carried_torque, pushed
from icjax.fit._inertia import linear_inertia, segment_groups
from icjax.model import index_finger, integrate, inverse_dynamics, neutral

RATE = 500.0
TIME = np.arange(-125, 51) / RATE


def arm(force: np.ndarray, compliance: float, hertz: float, ratio: float) -> np.ndarray:
    """Displacement of a damped spring, by small explicit steps."""
    w, fine, state, found = 2 * np.pi * hertz, 20, np.zeros(2), []
    for f in force:
        found.append(state[0])
        for _ in range(fine):
            a = w**2 * (compliance * f - state[0]) - 2 * ratio * w * state[1]
            state[1] += a / (RATE * fine)
            state[0] += state[1] / (RATE * fine)
    return np.array(found)


def contacts(count: int, generator: np.random.Generator):
    """Forces of two coordinates that rise from zero at contact, and where an arm of 9 Hz goes with them."""
    force, aside = [], []
    for _ in range(count):
        rise = np.clip(TIME / generator.uniform(0.03, 0.09), 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(TIME / 0.09, 0, 1))
        force.append(np.stack([2.0 * rise, generator.uniform(0.2, 0.5) * rise], axis=1))
        moved = arm(force[-1] @ np.array([1.0, 0.4]), 2e-3, 9.0, 0.6)
        aside.append(np.stack([moved, 0.0 * moved], axis=1))
    return force, aside


def test_acceleration_of_an_arm_that_is_pushed():
    """Found from noisy displacement although differences of that are mostly noise; nothing where nothing moved."""
    generator = np.random.default_rng(8)
    force, aside = contacts(16, generator)
    noisy = [
        item + 2e-5 * generator.standard_normal(item.shape) + 1e-3 * generator.standard_normal((1, 2)) for item in aside
    ]
    found, _ = pushed(noisy, force, RATE)
    true = [np.gradient(np.gradient(item[:, 0], 1 / RATE), 1 / RATE) for item in aside]
    differenced = [np.gradient(np.gradient(item[:, 0], 1 / RATE), 1 / RATE) for item in noisy]
    size = np.sqrt(np.mean(np.concatenate(true) ** 2))
    error = np.sqrt(np.mean([(a.acceleration[:, 0] - b) ** 2 for a, b in zip(found, true, strict=True)]))
    assert error < 0.2 * size
    assert np.sqrt(np.mean([(a - b) ** 2 for a, b in zip(differenced, true, strict=True)])) > size
    for item in found:
        np.testing.assert_allclose(
            item.velocity[:, 0], np.gradient(item.aside[:, 0], 1 / RATE), atol=0.05 * np.max(np.abs(item.velocity))
        )
        assert np.max(np.abs(item.aside[:, 1])) < 0.05 * np.max(np.abs(item.aside[:, 0]))


def test_contacts_without_repetitions_say_nothing_of_the_arm():
    """It is found from the others, and holds for them too."""
    generator = np.random.default_rng(10)
    force, aside = contacts(12, generator)
    few, doubt = pushed(aside[:6], force[:6], RATE)
    mixed, mixed_doubt = pushed([*aside[:6], *[None] * 6], force, RATE)
    for one, other in zip(few, mixed, strict=False):
        np.testing.assert_allclose(other.acceleration, one.acceleration, rtol=0.02, atol=0.02)
    true = [np.gradient(np.gradient(item[:, 0], 1 / RATE), 1 / RATE) for item in aside[6:]]
    error = [a.acceleration[:, 0] - b for a, b in zip(mixed[6:], true, strict=True)]
    assert np.sqrt(np.mean(np.square(error))) < 0.2 * np.sqrt(np.mean(np.square(true)))
    assert all(np.any(item.acceleration) for item in (*doubt, *mixed_doubt))
    nothing, _ = pushed([None] * 12, force, RATE)
    assert not any(np.any(item.aside) for item in nothing)


def test_what_the_force_does_not_explain_counts_for_nothing():
    """Wandering that has nothing to do with the contact, and a body that no force reaches."""
    generator = np.random.default_rng(9)
    force, aside = contacts(16, generator)
    wander = [
        0.5e-3 * np.sin(2 * np.pi * (generator.uniform(0.5, 2.0) * TIME + generator.uniform()))[:, None] for _ in force
    ]
    found, _ = pushed([np.repeat(item, 2, axis=1) for item in wander], force, RATE)
    true = np.concatenate([item.acceleration[:, 0] for item in pushed(aside, force, RATE)[0]])
    told = np.concatenate([item.acceleration[:, 0] for item in found])
    assert np.sqrt(np.mean(told**2)) < 0.1 * np.sqrt(np.mean(true**2))
    for item in pushed(aside, [0.0 * part for part in force], RATE)[0]:
        assert not np.any(item.aside)


def test_carried_torque_is_the_change_of_inverse_dynamics():
    """The torque on wrist and finger of a forearm that is displaced, moves and accelerates, to first order."""
    model = index_finger()
    dofs, rest = tuple(range(6, 10)), tuple(range(6))
    groups, names = segment_groups(model, dofs)
    generator = np.random.default_rng(2)
    q = np.asarray(integrate(model, neutral(model), 0.2 * generator.standard_normal(10)))
    v, a = generator.standard_normal(10), 5.0 * generator.standard_normal(10)
    parts = linear_inertia(model, groups, dofs, q[None], v[None], a[None], by=rest)
    d = [1e-6 * generator.standard_normal(10) * np.isin(np.arange(10), rest) for _ in range(3)]
    small = carried_torque(parts, _pushed(d, rest))[0].sum(axis=0)
    assert len(names) == parts[0].shape[1]

    def torque(dq, dv, da):
        return np.asarray(inverse_dynamics(model, integrate(model, q, jnp.asarray(dq)), v + dv, a + da))[list(dofs)]

    np.testing.assert_allclose(small, torque(*d) - torque(0 * d[0], 0 * d[1], 0 * d[2]), atol=1e-10)


def _pushed(d, rest):
    return Pushed(*(item[None, list(rest)] for item in d))
