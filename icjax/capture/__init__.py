"""Capture: from the files of a session to joint angles, contact forces and events on one clock."""

from icjax.capture._ball import BallContacts as BallContacts
from icjax.capture._ball import BallSpec as BallSpec
from icjax.capture._ball import ball_contacts as ball_contacts
from icjax.capture._ball import ball_pose as ball_pose
from icjax.capture._ball import read_ball as read_ball
from icjax.capture._ball_recording import ball_recording as ball_recording
from icjax.capture._calibrate import Calibration as Calibration
from icjax.capture._calibrate import calibrate_model as calibrate_model
from icjax.capture._calibration_parameters import CalibrationOptions as CalibrationOptions
from icjax.capture._calibration_summary import calibration_lines as calibration_lines
from icjax.capture._capture import calibrate_session as calibrate_session
from icjax.capture._capture import capture as capture
from icjax.capture._capture import capture_trial as capture_trial
from icjax.capture._check import check as check
from icjax.capture._check_recording import check_recording as check_recording
from icjax.capture._film_calibration import calibrate as calibrate
from icjax.capture._film_calibration import write_curves as write_curves
from icjax.capture._fsr import Curve as Curve
from icjax.capture._fsr import fit_curve as fit_curve
from icjax.capture._fsr import read_curves as read_curves
from icjax.capture._plates import plate_frame as plate_frame
from icjax.capture._plates import plate_wrench as plate_wrench
from icjax.capture._posture import PosturePrior as PosturePrior
from icjax.capture._posture import posture_prior as posture_prior
from icjax.capture._session_file import read_session as read_session
from icjax.capture._spec import SessionSpec as SessionSpec
