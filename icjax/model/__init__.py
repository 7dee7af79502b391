"""Articulated bodies: kinematic tree, kinematics and dynamics, loading, the shipped finger."""

from icjax.model._coordinates import acceleration_to_mujoco as acceleration_to_mujoco
from icjax.model._coordinates import difference as difference
from icjax.model._coordinates import integrate as integrate
from icjax.model._coordinates import neutral as neutral
from icjax.model._coordinates import velocity_from_mujoco as velocity_from_mujoco
from icjax.model._coordinates import velocity_map as velocity_map
from icjax.model._coordinates import velocity_to_mujoco as velocity_to_mujoco
from icjax.model._dynamics import gravity_torque as gravity_torque
from icjax.model._dynamics import inverse_dynamics as inverse_dynamics
from icjax.model._dynamics import mass_matrix as mass_matrix
from icjax.model._edit import lock_joints as lock_joints
from icjax.model._edit import part_of as part_of
from icjax.model._edit import with_sites as with_sites
from icjax.model._index_finger import index_finger as index_finger
from icjax.model._kinematics import body_jacobian as body_jacobian
from icjax.model._kinematics import forward_kinematics as forward_kinematics
from icjax.model._kinematics import frames as frames
from icjax.model._kinematics import jacobian_at as jacobian_at
from icjax.model._kinematics import pad_positions as pad_positions
from icjax.model._kinematics import point_jacobian as point_jacobian
from icjax.model._kinematics import site_positions as site_positions
from icjax.model._kinematics import world_jacobian as world_jacobian
from icjax.model._load import load_model as load_model
from icjax.model._model import Model as Model
from icjax.model._tree import tree as tree
