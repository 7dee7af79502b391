"""Postures with a given k_G: the equation holds, nothing closer does, limits are kept."""

import numpy as np
import pytest
from hand_made import COMPLIANCE, chain

from icjax.estimation import directional_stiffness, posture_search
from icjax.model import index_finger, pad_positions

TABLE_1 = np.array([0.3488, 0.9882, 0.6715, 2.0052])
SPREAD = np.radians([10.0, 15.0, 15.0, 10.0])


def test_the_posture_found_has_the_stiffness_and_is_the_closest():
    model = index_finger(root="fixed")
    natural = np.radians([0.0, 20.0, 20.0, 10.0])
    found = posture_search(model, "fingertip", TABLE_1, 81.86, SPREAD, scale_spread=1e-4)(natural, 1.0)
    assert found.found
    tip = model.pad_bodies[0]
    point = np.asarray(pad_positions(model, found.q))[0]
    assert float(directional_stiffness(model, found.q, tip, point, TABLE_1)) == pytest.approx(81.86, rel=1e-3)
    assert found.share[:2].sum() > 0.9
    # At the closest point of a surface the way back to the natural posture is along its normal.
    off = (found.q - natural) / SPREAD**2
    step = 1e-5
    slope = np.array(
        [
            float(
                directional_stiffness(
                    model, found.q + d, tip, np.asarray(pad_positions(model, found.q + d))[0], TABLE_1
                )
            )
            - found.stiffness
            for d in step * np.eye(4)
        ]
    )
    assert abs(off @ slope) / np.linalg.norm(off) / np.linalg.norm(slope) > 0.99
    assert found.distance == pytest.approx(np.linalg.norm((found.q - natural) / SPREAD), rel=1e-3)


def test_only_hinges():
    with pytest.raises(ValueError, match="ball"):
        posture_search(chain(kind="ball"), "pad0", np.repeat(COMPLIANCE, 3), 100.0, np.ones(12))
