"""What every file of SphereCal holds, as JSON Schemas: docs/schemas and the tables of docs/formats.md are made of it.

A format that is read and written by its declaration has it in its own module; the modules here have those that are
read by hand or only written.
"""

from typing import Any

from file_formats.other import FORMATS as _OTHER
from file_formats.results import FORMATS as _RESULTS
from file_formats.sessions import FORMATS as _SESSIONS
from spherecal_cameras.camera_settings import CAMERAS
from spherecal_cameras.genicam.trust import DRIVERS
from spherecal_documents.report.dcc import ISSUER
from spherecal_files.bar_registry import BARS
from spherecal_files.codec import FileFormat
from spherecal_rigs.ball_registry import BALLS
from spherecal_rigs.entry import ENTRY
from spherecal_rigs.kept_checks import PROFILE_CHECK
from spherecal_rigs.limits_file import LIMITS
from spherecal_rigs.store import PROFILE

_SETTINGS = (CAMERAS, DRIVERS, BARS, BALLS, LIMITS, ISSUER, PROFILE, ENTRY, PROFILE_CHECK)
FORMATS: tuple[FileFormat[Any], ...] = (*_SESSIONS, *_RESULTS, *_SETTINGS, *_OTHER)
