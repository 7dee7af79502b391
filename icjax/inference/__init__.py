"""Least squares, transforms of parameters and intervals: what marker solving, estimation and fitting share."""

from icjax.inference._laplace import QUANTILE as QUANTILE
from icjax.inference._laplace import Laplace as Laplace
from icjax.inference._laplace import interval as interval
from icjax.inference._laplace import jacobian as jacobian
from icjax.inference._laplace import laplace as laplace
from icjax.inference._least_squares import Fit as Fit
from icjax.inference._least_squares import covariance as covariance
from icjax.inference._least_squares import least_squares as least_squares
from icjax.inference._transforms import Cholesky as Cholesky
from icjax.inference._transforms import Identity as Identity
from icjax.inference._transforms import Log as Log
from icjax.inference._transforms import Logistic as Logistic
from icjax.inference._transforms import Softplus as Softplus
from icjax.inference._transforms import Synergies as Synergies
from icjax.inference._transforms import Tied as Tied
from icjax.inference._transforms import Transform as Transform
from icjax.inference._transforms import tied as tied
