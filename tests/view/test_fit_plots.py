"""Figures of a fit: what they draw is what the record holds."""

import dataclasses

import numpy as np
import pytest
from view.example_fit import make_fit

from icjax import view
from icjax.fit import FitPeriods


@pytest.fixture(scope="module")
def fit():
    return make_fit()


def line(axis, label):
    (found,) = [item for item in axis.lines if item.get_label() == label]
    return np.asarray(found.get_xdata()), np.asarray(found.get_ydata())


def test_strongest_contact_comes_first(fit):
    """The first window of the example is pushed hardest, the last least."""
    drawing = view.plot_fit_response(fit, ("wrist",))
    titles = [axis.get_title(loc="left") for axis in drawing.axes]
    assert titles[0].startswith("trial00, 0.60 s")
    assert titles[-1].startswith("trial01, 1.60 s")
    time, predicted = line(drawing.axes[0], "predicted by the fit")
    windows = fit.windows
    kept = windows.time[0] > windows.onset[0] - 0.12
    np.testing.assert_allclose(time, 1e3 * (windows.time[0] - windows.onset[0])[kept])
    np.testing.assert_allclose(predicted, np.degrees(windows.deviation[0, kept, 0]))
    _, measured = line(drawing.axes[0], "measured")
    np.testing.assert_allclose(
        measured, np.degrees((windows.angle - windows.repetition - windows.drift)[0, kept, 0]), atol=1e-12
    )


def test_reference_of_a_joint_that_nothing_determines_has_no_band(fit):
    unknown = dataclasses.replace(
        fit.windows, reference_sd=np.where(fit.windows.deviation < 0, np.inf, fit.windows.reference_sd)
    )
    drawing = view.plot_fit_reference(dataclasses.replace(fit, windows=unknown))
    _, reference = line(drawing.axes[0], "reference")
    assert np.isfinite(reference).all()
    assert np.isfinite(drawing.axes[0].get_ylim()).all()


def test_refused_joints_have_no_mark(fit):
    marks = [item for item in view.plot_fit_compliance(fit).axes[0].lines if item.get_marker() == "o"]
    assert len([item for item in marks if len(item.get_xdata())]) == 1
    given = make_fit(refused=("", ""))
    marks = [item for item in view.plot_fit_compliance(given).axes[0].lines if item.get_marker() == "o"]
    assert len([item for item in marks if len(item.get_xdata())]) == 2


def test_white_residuals_have_a_flat_spectrum(fit):
    """Mean over frequencies of the mean periodogram is the mean square, but for the mean of each window."""
    axis = view.plot_fit_spectrum(fit).axes[0]
    for joint in fit.joint_names:
        _, power = line(axis, joint)
        assert 0.6 < power.mean() < 1.4


def test_unknown_joint_is_named(fit):
    with pytest.raises(ValueError, match="'thumb'"):
        view.plot_fit_response(fit, ("thumb",))


def test_a_refused_period_has_no_mark(fit):
    number = np.array([[0.2, 0.6], [0.3, 0.8], [0.3, 0.7]])
    periods = FitPeriods(
        ("trial00", "trial01", "trial02"),
        fit.joint_names,
        number,
        0.9 * number,
        np.array([[0.22, np.inf], [0.33, 0.9], [0.33, 0.8]]),
        np.array([[False, True], [False, False], [False, False]]),
        number / number[0],
        0.8 * number / number[0],
        1.2 * number / number[0],
        0.5 * np.ones((3, 2)),
    )
    axes = view.plot_fit_periods(dataclasses.replace(fit, periods=periods)).axes
    marks = [len([item for item in axis.lines if item.get_marker() == "o"]) for axis in axes]
    assert marks == [3, 2]
