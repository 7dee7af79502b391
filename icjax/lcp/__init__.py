"""The linear complementarity problem z >= 0, Mz + q >= 0, z^T (Mz + q) = 0: Lemke's method, central path."""

from icjax.lcp._adjoint import Exact as Exact
from icjax.lcp._adjoint import Smoothed as Smoothed
from icjax.lcp._adjoint import carried as carried
from icjax.lcp._central_path import Path as Path
from icjax.lcp._central_path import System as System
from icjax.lcp._central_path import central_path as central_path
from icjax.lcp._central_path import factored as factored
from icjax.lcp._central_path import solve_factored as solve_factored
from icjax.lcp._central_path import times as times
from icjax.lcp._lemke import Lemke as Lemke
from icjax.lcp._residual import residual as residual
from icjax.lcp._residual import tolerance as tolerance
from icjax.lcp._solve import solve as solve
