"""Pictures of the records: figures (matplotlib), a 3-D scene (viser); both come with the extra ``viz``."""

from icjax.view._contact_plots import plot_compliance as plot_compliance
from icjax.view._contact_plots import plot_contact_event as plot_contact_event
from icjax.view._force_plots import force_components as force_components
from icjax.view._force_plots import plot_forces as plot_forces
from icjax.view._force_plots import plot_measured_forces as plot_measured_forces
from icjax.view._motion_plots import plot_angles as plot_angles
from icjax.view._motion_plots import plot_path as plot_path
from icjax.view._object_course import ObjectCourse as ObjectCourse
from icjax.view._object_course import object_course as object_course
from icjax.view._object_plots import OBJECT_PANELS as OBJECT_PANELS
from icjax.view._object_plots import plot_objects as plot_objects
from icjax.view._objects import object_colour as object_colour
from icjax.view._perturbation_plot import plot_perturbations as plot_perturbations
from icjax.view._scene3d import export_scene as export_scene
from icjax.view._sensitivity_plot import plot_sensitivity as plot_sensitivity
from icjax.view._skeleton import scalar_joints as scalar_joints
from icjax.view._snapshot import draw_snapshot as draw_snapshot
from icjax.view._snapshot import snapshot as snapshot
from icjax.view._style import save as save
from icjax.view._style import svg as svg
from icjax.view._surfaces import scene_name as scene_name
