"""Formats of what the owner of a rig keeps: cameras, drivers, bars, limits, profiles, who issues certificates."""

from file_formats.results import CHECK
from file_formats.sessions import BAR_SERIAL, CERTIFICATE, EXPANSION, LENGTHS, MARKS, REFERENCE_C, TARGETS
from file_formats.vocabulary import (
    SOFTWARE,
    Format,
    Schema,
    boolean,
    celsius,
    choice,
    date,
    digest,
    entries,
    identifier,
    integer,
    items,
    matrix,
    name,
    number,
    one_of,
    positive,
    prose,
    record,
    serial,
    text,
    time,
    unread,
)
from spherecal.cameras.gentl.trust import FORMAT as DRIVERS
from spherecal.profile.entry import FILES, RIG_FILE
from spherecal.profile.limits_file import FORMAT as LIMITS

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
BARS = Format(
    "bars",
    "bars.json",
    "The owner's reference bars, in the user's settings; `SPHERECAL_BARS` names another file.",
    {
        "bars": items(
            "The bars.",
            record(
                "",
                {
                    "serial": BAR_SERIAL,
                    "description?": text("What it is."),
                    "marks": MARKS,
                    "lengths": LENGTHS,
                    "expansion_per_kelvin?": EXPANSION,
                    "reference_temperature_c?": REFERENCE_C,
                    "certificate?": CERTIFICATE,
                },
            ),
        ),
    },
    ("Serial numbers differ.", "A mark that is named is there."),
    more="verification.md",
)
BALLS = Format(
    "balls",
    "balls.json",
    "The owner's balls, in the user's settings; `SPHERECAL_BALLS` names another file.",
    {
        "balls": items(
            "The balls.",
            record(
                "",
                {
                    "name": name("The name that its owner knows it by."),
                    "nominal_diameter_mm": positive("Its diameter, about."),
                    "targets": record("Its targets, as in targets.json.", TARGETS.fields)
                    | {"anyOf": list(TARGETS.forms)},
                    "spacing?": record(
                        "What was measured on a printed sticker.",
                        {
                            "from": name("A dot."),
                            "to": name("Another dot."),
                            "distance_mm": positive("Their distance on the print."),
                        },
                    ),
                },
            ),
        ),
    },
    ("Names and ids differ.", *TARGETS.rules),
    more="guide/bench.md",
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
PROFILE = Format(
    "profile",
    "profile.json",
    "A rig's profile: its name, limits, and which calibration was in use from when on.",
    {
        "name": name("Name of the rig."),
        "validity?": record(
            "When a calibration is ageing or stale.",
            {
                f"{key}?": number(about, 0)
                for key, about in (
                    ("ageing_hours", "Age from which it is ageing, not above `stale_hours`."),
                    ("stale_hours", "Age from which it is stale."),
                    ("ageing_kelvin", "Change of temperature from which it is ageing, not above `stale_kelvin`."),
                    ("stale_kelvin", "Change from which it is stale."),
                )
            },
        ),
        "applied": items(
            "Which calibration was put to use, oldest first.",
            record(
                "",
                {
                    "calibration": {"description": "Its number.", "type": "string", "pattern": "^[0-9]{4,9}$"},
                    "at": time("When."),
                    "note?": text("Why."),
                },
            ),
            most=10_000,
        ),
        "software?": SOFTWARE,
    },
    more="profiles.md",
)
_SETTING = one_of("", boolean(""), text(""), number(""), items("", number("")))
ENTRY = Format(
    "profile-entry",
    "entry.json",
    "A calibration in a profile: what was known when it was saved, and the files beside it.",
    {
        "saved_at": time("When it was saved."),
        "calibrated_at": time("When it was calibrated."),
        "note?": text("A note."),
        "quality": record(
            "As in rig.json.",
            {
                "valid": boolean("As there."),
                "verdict?": unread("As there."),
                "care?": prose("What it is to be used with care for; empty where nothing is."),
                "rms_px?": number("As there.", 0),
                "sigma0?": number("As there.", 0),
            },
        ),
        "scale": record(
            "Where the scale comes from.",
            {
                "source": text("As in rig.json."),
                "artefact?": text("The bar or board."),
                "relative_uncertainty?": number("Relative standard uncertainty.", 0),
            },
        ),
        "sphere_diameter_mm?": positive("Diameter of the ball."),
        "temperature_c?": celsius("The rig's temperature in degrees Celsius."),
        "volume_mm?": matrix("Low and high corner of the calibrated points.", 2, 3),
        "verification?": record(
            "What the bars said.",
            {
                "verdict": text("The verdict."),
                "mean_error_mm?": number("Mean error."),
                "max_abs_error_mm?": number("Largest error, without its sign.", 0),
            },
        ),
        "cameras": items(
            "The cameras.",
            record(
                "",
                {
                    "id": identifier("Its id."),
                    "serial?": serial("Its serial number."),
                    "model?": text("Its maker's name for it."),
                    "pixel_pitch_um?": positive("Pixel pitch of its sensor."),
                    "focal_length_mm?": positive("Focal length of its lens."),
                    "temperature_c?": celsius("Its temperature in degrees Celsius."),
                    "settings?": entries("Its settings by name.", _SETTING) | {"maxProperties": 1000},
                },
            ),
            most=1000,
        ),
        "input_sha256": digest("That of the rig."),
        "files_sha256": record(
            "SHA-256 of the files beside it.",
            {RIG_FILE: text("The rig."), **{f"{file}?": text(f"{file}.") for file in FILES if file != RIG_FILE}},
        ),
        "software?": record("Who wrote it.", {"version?": text("Its version."), "name?": unread("Its name.")}),
    },
    ("`volume_mm` has the low corner first.",),
    more="profiles.md",
)


def _of_check(part: str, read: dict[str, Schema]) -> Schema:
    """A camera, ball or length of check.json, of which only some fields are read."""
    names = CHECK.fields[part]["items"]["properties"]
    others = {f"{key}?": unread("As in check.json.") for key in names if key not in read and f"{key}?" not in read}
    return record("", read | others)


PROFILE_CHECK = Format(
    "profile-check",
    "checks/*.json",
    "A quick check kept in a profile.",
    {
        "checked_at": time("When."),
        "calibration": name("Which calibration was checked."),
        "temperature_c?": celsius("The rig's temperature in degrees Celsius."),
        "check": record(
            "What came out, as in check.json.",
            {
                "verdict": choice("The verdict.", ("ok", "watch", "recalibrate")),
                "sentence": prose("In words."),
                "tolerance_mm?": unread("As in check.json."),
                "cameras": items(
                    "As in check.json.",
                    _of_check(
                        "cameras",
                        {
                            "id": name("Its id."),
                            "point_mm?": number("Largest shift of a point.", 0),
                            "rms_px?": number("Root mean square of its residuals.", 0),
                            "points?": number("Points that it saw.", 0),
                        },
                    ),
                ),
                "balls": items("As in check.json.", _of_check("balls", {"scale_ppm": number("Size of the ball.")})),
                "lengths": items(
                    "As in check.json.", _of_check("lengths", {"error_mm": number("Error of the length.")})
                ),
            },
        ),
        "software?": SOFTWARE,
    },
    more="profiles.md",
)
FORMATS = (CAMERAS, DRIVERS, BARS, BALLS, LIMITS, ISSUER, PROFILE, ENTRY, PROFILE_CHECK)
