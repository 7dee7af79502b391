"""Records as files of other programs: OpenSim, C3D viewers, MuJoCo, and by `icjax.view` Blender and slides."""

from icjax.export._mujoco import export_mujoco as export_mujoco
from icjax.export._mujoco import mujoco_coordinates as mujoco_coordinates
from icjax.export._mujoco import mujoco_model as mujoco_model
from icjax.export._opensim import Y_UP as Y_UP
from icjax.export._opensim import Table as Table
from icjax.export._opensim import contact_marks as contact_marks
from icjax.export._opensim import coordinate_table as coordinate_table
from icjax.export._opensim import force_table as force_table
from icjax.export._opensim import rollout_coordinates as rollout_coordinates
from icjax.export._opensim import rollout_forces as rollout_forces
from icjax.export._opensim import safe as safe
from icjax.export._opensim import sensor_table as sensor_table
from icjax.export._opensim import torque_names as torque_names
from icjax.export._record import export_record as export_record
from icjax.export._trial import export_interaction as export_interaction
from icjax.export._trial import export_recording as export_recording
from icjax.export._trial import export_rollout as export_rollout
