"""Virtual capture studio: independent MuJoCo subjects that are recorded as a motion-capture laboratory would.

A finger taps and strokes a plate (`record`); a hand grasps and lifts free objects (`grasp_session`), or rolls or
turns a ball that measures pressure (`ball_session`).

Nothing here is shared with the estimators or the synthesis; the truth is written apart from the recording.
"""

from icjax.laboratory._ball_session import ball_session as ball_session
from icjax.laboratory._dynamics import Truth as Truth
from icjax.laboratory._free_object import FreeObject as FreeObject
from icjax.laboratory._gait import Gait as Gait
from icjax.laboratory._grasp import GraspTruth as GraspTruth
from icjax.laboratory._grasp_session import grasp_session as grasp_session
from icjax.laboratory._grasp_session import load_grasp as load_grasp
from icjax.laboratory._grasp_session import regrasp as regrasp
from icjax.laboratory._hand import HAND_JOINTS as HAND_JOINTS
from icjax.laboratory._hand import Hand as Hand
from icjax.laboratory._instruments import Noise as Noise
from icjax.laboratory._lift import Lift as Lift
from icjax.laboratory._pressure_ball import PressureBall as PressureBall
from icjax.laboratory._record import Paths as Paths
from icjax.laboratory._record import record as record
from icjax.laboratory._replay import bump_under as bump_under
from icjax.laboratory._replay import load_truth as load_truth
from icjax.laboratory._replay import replay as replay
from icjax.laboratory._stand import Stand as Stand
from icjax.laboratory._subject import Subject as Subject
from icjax.laboratory._surface import Bump as Bump
from icjax.laboratory._surface import Surface as Surface
