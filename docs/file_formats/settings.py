"""Formats of what the owner of a rig keeps: cameras, drivers, bars, limits, profiles, who issues certificates."""

from spherecal.cameras.gentl.trust import DRIVERS
from spherecal.cameras.profile import CAMERAS
from spherecal.files.ball_registry import BALLS
from spherecal.files.bar_registry import BARS
from spherecal.profile.checks import PROFILE_CHECK
from spherecal.profile.entry import ENTRY
from spherecal.profile.limits_file import LIMITS
from spherecal.profile.store import PROFILE
from spherecal.report.dcc import ISSUER

FORMATS = (CAMERAS, DRIVERS, BARS, BALLS, LIMITS, ISSUER, PROFILE, ENTRY, PROFILE_CHECK)
