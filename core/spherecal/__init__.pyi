# What a type checker sees of the package; tests/test_api.py compares it with spherecal.api and with the package.
from spherecal.api import FORMATS as FORMATS
from spherecal.api import Calibration as Calibration
from spherecal.api import CalibrationSettings as CalibrationSettings
from spherecal.api import Cancelled as Cancelled
from spherecal.api import Context as Context
from spherecal.api import Exported as Exported
from spherecal.api import Finding as Finding
from spherecal.api import InputError as InputError
from spherecal.api import MeasuredPoints as MeasuredPoints
from spherecal.api import OutputError as OutputError
from spherecal.api import Progress as Progress
from spherecal.api import Quality as Quality
from spherecal.api import Rig as Rig
from spherecal.api import RigCamera as RigCamera
from spherecal.api import Session as Session
from spherecal.api import SpherecalError as SpherecalError
from spherecal.api import UserFrame as UserFrame
from spherecal.api import Verification as Verification
from spherecal.api import calibrate_session as calibrate_session
from spherecal.api import define_frame as define_frame
from spherecal.api import export_rig as export_rig
from spherecal.api import load_frame as load_frame
from spherecal.api import load_rig as load_rig
from spherecal.api import load_session as load_session
from spherecal.api import project_points as project_points
from spherecal.api import save_calibration as save_calibration
from spherecal.api import save_frame as save_frame
from spherecal.api import save_verification as save_verification
from spherecal.api import triangulate_points as triangulate_points
from spherecal.api import verify_rig as verify_rig

__version__: str
