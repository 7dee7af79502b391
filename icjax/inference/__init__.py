"""Batched least squares on manifolds: what marker solving, estimation and fitting share."""

from icjax.inference._least_squares import Fit as Fit
from icjax.inference._least_squares import covariance as covariance
from icjax.inference._least_squares import least_squares as least_squares
