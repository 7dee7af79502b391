"""The shipped hand is fitted to a subject's static markers: lengths of all segments and places of all markers."""

import dataclasses

import jax
import numpy as np
import pytest

from icjax.capture import CalibrationOptions, calibrate_model
from icjax.model import human_hand, site_positions

NOISE, DISPLACED, PLACEMENT = 0.0002, 0.0005, 0.001
"""m, per axis: of a marker in a frame, of a marker from its site, and what the calibration is told of the latter."""

LENGTH, NOMINAL = 0.205, 0.19


@pytest.mark.slow
def test_a_static_recording_brings_the_hand_to_the_subjects_size():
    """The subject's hand is 8 % longer than the model's; no pose of the model fits the markers to better than 5 mm."""
    model, subject = human_hand(NOMINAL), human_hand(LENGTH)
    random = np.random.default_rng(0)
    placed = np.asarray(subject.site_position) + DISPLACED * random.normal(size=np.shape(subject.site_position))
    subject = dataclasses.replace(subject, site_position=placed)
    q = np.array(subject.rest)
    q[:3] = [0.3, 0.2, 0.1]
    clean = np.asarray(jax.jit(site_positions)(subject, q))
    markers = clean + NOISE * random.normal(size=(12, *clean.shape))
    options = CalibrationOptions(("static",), size=0.1, lengths=0.05, axes=None, frames=12)
    found = calibrate_model(model, tuple(range(len(placed))), (markers,), PLACEMENT, options)
    assert found.converged
    assert found.residual_before > 0.005
    np.testing.assert_allclose(found.marker_sd, NOISE, rtol=0.1)  # of 12 x 156 measurements

    # Every segment is as much longer as the hand, by its own scale and the common one, within 3 standard deviations.
    rows = [index for index, name in enumerate(found.names) if name.startswith("length ")]
    assert len(rows) == 17
    common = found.names.index("size")
    for row in rows:
        pair = np.ix_([common, row], [common, row])
        error = found.value[[common, row]].sum() - np.log(LENGTH / NOMINAL)
        assert abs(error) < 3 * np.sqrt(found.covariance[pair].sum()), found.names[row]

    def bones(hand):
        return np.linalg.norm(np.asarray(hand.body_position)[3:], axis=1)

    # Lengths between joints to 1 mm, where 0.5 mm at two clusters of three markers each leave some 0.4 mm.
    np.testing.assert_allclose(bones(found.model), bones(subject), rtol=0, atol=0.001)
    np.testing.assert_allclose(found.model.pad_centre, subject.pad_centre, rtol=0, atol=0.001)
    # Places come closer to the subject's own than the sites of a hand of the right length are, 0.5 mm.
    misplaced = np.asarray(found.model.site_position) - placed
    assert np.sqrt(np.mean(misplaced**2)) < 0.6 * DISPLACED
