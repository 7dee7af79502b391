"""Rotations and poses, twists and wrenches, adjoint, Gamma(r), spatial cross product, inertia (Section 6.1)."""

from icjax.spatial._pose import Pose as Pose
from icjax.spatial._pose import twist_exp as twist_exp
from icjax.spatial._pose import twist_log as twist_log
from icjax.spatial._rotation import left_jacobian_inverse as left_jacobian_inverse
from icjax.spatial._rotation import quaternion_exp as quaternion_exp
from icjax.spatial._rotation import quaternion_log as quaternion_log
from icjax.spatial._rotation import quaternion_multiply as quaternion_multiply
from icjax.spatial._rotation import quaternion_to_rotation as quaternion_to_rotation
from icjax.spatial._rotation import rotation_exp as rotation_exp
from icjax.spatial._rotation import rotation_log as rotation_log
from icjax.spatial._rotation import rotation_to_quaternion as rotation_to_quaternion
from icjax.spatial._rotation import safe_norm as safe_norm
from icjax.spatial._rotation import skew as skew
from icjax.spatial._spatial import adjoint as adjoint
from icjax.spatial._spatial import gamma as gamma
from icjax.spatial._spatial import newton_euler as newton_euler
from icjax.spatial._spatial import spatial_cross as spatial_cross
from icjax.spatial._spatial import spatial_inertia as spatial_inertia
from icjax.spatial._spatial import wrench_adjoint as wrench_adjoint
