"""Frictional contact of one time step: friction cone, complementarity problem, forces, slip state, margin."""

from icjax.contact._assemble import assemble as assemble
from icjax.contact._cone import FrictionCone as FrictionCone
from icjax.contact._cone import friction_cone as friction_cone
from icjax.contact._cone import gauge as gauge
from icjax.contact._frame import contact_frame as contact_frame
from icjax.contact._grasps import FAMILIES as FAMILIES
from icjax.contact._grasps import random_grasp as random_grasp
from icjax.contact._interior import InteriorPoint as InteriorPoint
from icjax.contact._judge import OPEN as OPEN
from icjax.contact._judge import SLIDING as SLIDING
from icjax.contact._judge import STICKING as STICKING
from icjax.contact._problem import ContactForces as ContactForces
from icjax.contact._problem import ContactProblem as ContactProblem
from icjax.contact._projected import Projected as Projected
from icjax.contact._scale import dimensionless as dimensionless
from icjax.contact._solve import solve as solve
