"""Fit compliance, reference trajectory and all else that a measurement depends on, and say how sure the result is."""

from icjax.fit._dynamic import DynamicEquilibrium as DynamicEquilibrium
from icjax.fit._dynamic import response as response
from icjax.fit._options import FitOptions as FitOptions
from icjax.fit._parameters import Parameter as Parameter
from icjax.fit._parameters import Parameters as Parameters
from icjax.fit._parameters import Values as Values
from icjax.fit._problem import Measurement as Measurement
from icjax.fit._problem import Problem as Problem
from icjax.fit._result import JointFit as JointFit
from icjax.fit._result import SessionFit as SessionFit
from icjax.fit._result import fit_session as fit_session
from icjax.fit._rollout_forces import ContactForces as ContactForces
from icjax.fit._session import SessionProblem as SessionProblem
from icjax.fit._session import session_problem as session_problem
from icjax.fit._solve import Minimum as Minimum
from icjax.fit._solve import Progress as Progress
from icjax.fit._solve import Solver as Solver
from icjax.fit._solve import multi_start as multi_start
from icjax.fit._solve import solve as solve
from icjax.fit._spline import spline_basis as spline_basis
from icjax.fit._static import StaticEquilibrium as StaticEquilibrium
