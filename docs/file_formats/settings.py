"""Formats of what the owner of a rig keeps: cameras, drivers, bars, limits, profiles, who issues certificates."""

from file_formats.vocabulary import (
    Format,
    choice,
    date,
    integer,
    items,
    name,
    number,
    positive,
    record,
    serial,
    text,
)
from spherecal.cameras.gentl.trust import DRIVERS
from spherecal.files.ball_registry import BALLS
from spherecal.files.bar_registry import BARS
from spherecal.profile.checks import PROFILE_CHECK
from spherecal.profile.entry import ENTRY
from spherecal.profile.limits_file import LIMITS
from spherecal.profile.store import PROFILE

CAMERAS = Format(
    "cameras",
    "cameras.json",
    "Settings of cameras by serial number, in the user's settings.",
    {
        "producers?": items("Driver files (.cti) and folders of the user's own.", text("")),
        "cameras?": items(
            "The cameras.",
            record(
                "",
                {
                    "serial": serial("Its serial number."),
                    "name?": name("The name that people know it by."),
                    "focal_length_mm?": positive("Focal length of its lens."),
                    "pixel_pitch_um?": positive("Pixel pitch of its sensor."),
                    "settings?": record(
                        "What is set when it is opened.",
                        {
                            "exposure_us?": positive("Exposure time."),
                            "gain_db?": number("Gain.", -20, 60),
                            "pixel_format?": text("GenICam's name of the pixel format."),
                            "region?": items("`[x, y, width, height]` in px.", integer("", 0, 65536), length=4),
                            "trigger?": choice("Trigger.", ("software", "hardware", "free", "scheduled")),
                            "trigger_source?": text("GenICam's name of the line."),
                            "frame_rate_hz?": positive("Frame rate."),
                            "packet_size?": integer("Bytes of a packet.", 0, 10**9),
                            "packet_delay?": integer("Between packets, in the camera's ticks.", 0, 10**9),
                            "frame_delay?": integer("Before a frame is sent, in the camera's ticks.", 0, 10**9),
                        },
                    ),
                },
            ),
        ),
    },
    ("Serial numbers and names differ.",),
    more="cameras.md",
)
ISSUER = Format(
    "issuer",
    "issuer.json",
    "What `spherecal report --issuer` needs for a calibration certificate: laboratory, customer, person, dates.",
    {
        **{
            key: record(
                about,
                {
                    "name": text("Its name."),
                    "city": text("Where it is."),
                    "country": {"description": "Two capital letters.", "type": "string", "pattern": "^[A-Z]{2}$"},
                    "email?": text("Its e-mail address."),
                },
            )
            for key, about in (("laboratory", "Who issues the certificate."), ("customer", "For whom."))
        },
        "person": text("Who is responsible."),
        "rig_serial": text("Serial number of the rig."),
        "manufacturer?": text("Who made the rig."),
        "number?": text("Number of the certificate."),
        "place?": choice(
            "Where it was measured; `laboratory` where absent.",
            ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other"),
        ),
        "begin?": date("First day of the measurement."),
        "end?": date("Last day."),
    },
    ("No text is empty.",),
)


FORMATS = (CAMERAS, DRIVERS, BARS, BALLS, LIMITS, ISSUER, PROFILE, ENTRY, PROFILE_CHECK)
