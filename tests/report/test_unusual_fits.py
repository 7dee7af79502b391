"""The page of a fit that is not the usual one: without catch trials, with a compliance that changes."""

import dataclasses

import numpy as np
from view.example_fit import make_fit

from icjax.fit import FitPeriods, check_fit, fit_text
from icjax.report._fits import _fit
from icjax.report._summary import _fit_lead


def test_headline():
    assert "held against 4 catch trials" in _fit_lead(make_fit())
    assert "no catch trials" in _fit_lead(dataclasses.replace(make_fit(), catch_trials=0))


def test_compliance_by_trial():
    """A table of every trial, and no word of one compliance throughout; without several periods neither."""
    fit = make_fit(refused=("", ""))
    assert "may change between" not in _fit(0, fit, {}, named=False)
    periods = FitPeriods(
        period_names=("trial00", "trial01"),
        joint_names=fit.joint_names,
        compliance=np.array([[0.2, 0.6], [0.3125, 0.8]]),
        lower=np.array([[0.18, 0.1], [0.27, 0.5]]),
        upper=np.array([[0.22, 2.9], [0.36, 1.3]]),
        refused=np.array([[False, True], [False, False]]),
        factor=np.array([[1.0, 1.0], [1.56, 1.33]]),
        factor_lower=np.array([[1.0, 1.0], [1.3, 0.4]]),
        factor_upper=np.array([[1.0, 1.0], [1.9, np.inf]]),
        learned=np.array([[0.9, 0.2], [0.9, 0.5]]),
    )
    page = _fit(0, dataclasses.replace(fit, periods=periods), {}, named=False)
    assert "may change between" in page
    assert "same in every contact" not in page
    for told in ("trial01", "0.312", "refused"):
        assert told in page
    lines = fit_text(dataclasses.replace(fit, periods=periods))
    rows = [line.split() for line in lines.splitlines() if line.startswith("trial0")]
    assert rows[0] == ["trial00", "0.2", "[0.18,", "0.22]", "refused", "[0.1,", "2.9]"]
    assert rows[2] == ["trial01", "1.56", "[1.3,", "1.9]", "1.33", ">", "0.4"]
    assert "1.56" in page
    assert rows[1] == ["trial01", "0.312", "[0.27,", "0.36]", "0.8", "[0.5,", "1.3]"]
    broken = dataclasses.replace(periods, lower=periods.lower + 1.0)
    assert any("of a period" in line for line in check_fit(dataclasses.replace(fit, periods=broken)))
