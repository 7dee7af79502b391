"""The linear complementarity problem z >= 0, Mz + q >= 0, z^T (Mz + q) = 0: residual, Lemke's method, derivative."""

from icjax.lcp._lemke import Lemke as Lemke
from icjax.lcp._residual import residual as residual
from icjax.lcp._solve import solve as solve
