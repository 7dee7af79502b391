"""Capture: from the files of a session to joint angles, contact forces and events on one clock."""

from icjax.capture._calibrate import calibrate as calibrate
from icjax.capture._calibrate import write_curves as write_curves
from icjax.capture._capture import capture as capture
from icjax.capture._capture import capture_trial as capture_trial
from icjax.capture._check import check as check
from icjax.capture._check_recording import check_recording as check_recording
from icjax.capture._fsr import Curve as Curve
from icjax.capture._fsr import fit_curve as fit_curve
from icjax.capture._fsr import read_curves as read_curves
from icjax.capture._plates import plate_frame as plate_frame
from icjax.capture._plates import plate_wrench as plate_wrench
from icjax.capture._session_file import read_session as read_session
from icjax.capture._spec import SessionSpec as SessionSpec
