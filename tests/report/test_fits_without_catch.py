"""The page of a fit without catch trials does not speak of any."""

import dataclasses

from view.example_fit import make_fit

from icjax.report._summary import _fit_lead


def test_headline():
    assert "held against 4 catch trials" in _fit_lead(make_fit())
    assert "no catch trials" in _fit_lead(dataclasses.replace(make_fit(), catch_trials=0))
