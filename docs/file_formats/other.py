"""Formats of measuring with a rig, of the wizard, and of the studies."""

from file_formats.vocabulary import (
    SOFTWARE,
    boolean,
    choice,
    digest,
    identifier,
    integer,
    items,
    matrix,
    name,
    number,
    numbers,
    path,
    prose,
    record,
    text,
    written,
)
from spherecal_gui.in_use import LAST_VERIFICATION
from spherecal_gui.project_folder import WIZARD
from spherecal_measuring.pose import BODY

SERIES = written(
    "series",
    "series.json",
    "A recorded measurement, beside its tables.",
    {
        "sets": integer("How many sets were measured.", 0),
        "table": choice("Kind of the tables.", ("csv", "parquet")),
        "rig": record(
            "The rig.",
            {
                "input_sha256": digest("`input_sha256` of its rig.json."),
                "reference_camera?": name("The camera whose frame is the world."),
            },
        ),
        "health": record(
            "The rig's health at the end.",
            {
                "sets": integer("Sets that were used.", 0),
                "cameras": items(
                    "The cameras.",
                    record(
                        "",
                        {
                            "id": identifier("Its id."),
                            "observations": integer("Its image points.", 0),
                            "rms_px?": number("Root mean square of their residuals.", 0),
                            "calibrated_rms_px?": number("Root mean square of the residuals at the calibration.", 0),
                            "left_out": integer("Points left out.", 0),
                            "moved": boolean("Whether it moved."),
                            "named_at_set?": integer("The set at which that was noticed.", 0),
                            "move_px?": number("By how much its image moved.", 0),
                        },
                    ),
                ),
            },
        ),
        "software": SOFTWARE,
    },
    is_read=False,
    more="measuring.md#the-series",
)
MEASUREMENTS = written(
    "measurements",
    "stream of measure --stream",
    "First line of the stream of measured sets; the others are sets (`#/$defs/set`).",
    {"cameras?": items("Ids of the cameras.", identifier(""))},
    is_read=False,
    more="measuring.md",
)
MEASURED_SET = record(
    "One measured set.",
    {
        "set": integer("Its number from 1.", 1),
        "id": prose("Its id."),
        "time_s?": number("Since the first set."),
        "points": items(
            "The points.",
            record(
                "",
                {
                    "target": integer("The target."),
                    "point": name("Its point."),
                    "xyz_mm": numbers("Its position.", 3),
                    "covariance_mm2": items("xx, xy, xz, yy, yz, zz.", {"type": ["number", "null"]}, length=6),
                    "views": integer("Cameras that saw it.", 0),
                    "dots": integer("Dots that were used.", 0),
                    "speed_mm_s?": number("Its speed."),
                },
            ),
        ),
        "values": items(
            "Lengths, angles and other values.",
            record(
                "",
                {
                    "kind": prose("What it is."),
                    "name": prose("Its name."),
                    "value": number("The value."),
                    "unit": prose("Its unit."),
                    "u?": number("Standard uncertainty.", 0),
                    "nominal?": number("Nominal value."),
                    "deviation?": number("Deviation from that."),
                    "u_deviation?": number("Standard uncertainty of the deviation.", 0),
                },
            ),
        ),
        "bodies": items(
            "Poses of bodies.",
            record(
                "",
                {
                    "name": identifier("Its name."),
                    "rotation": matrix("Body to world.", 3, 3),
                    "translation_mm": numbers("Body to world.", 3),
                    "covariance": items(
                        "Of a small turn in rad, then of the shift.",
                        items("", {"type": ["number", "null"]}, length=6),
                        length=6,
                    ),
                    "points": integer("Points used.", 0),
                    "left_out": items("Points left out.", prose("")),
                    "rms_mm": number("Root mean square of the points' residuals.", 0),
                },
            ),
        ),
        "missing": items("What could not be measured.", record("", {"name": prose(""), "reason": prose("")})),
        "contradictions": items(
            "Views that contradict the others.",
            record(
                "",
                {
                    "target": integer("The target."),
                    "camera?": name("The camera; absent where it cannot be determined."),
                    "views": integer("Contradicting views.", 0),
                    "of": integer("Views of the point in all.", 0),
                },
            ),
        ),
        "cameras": items(
            "The cameras.",
            record(
                "",
                {
                    "id": identifier("Its id."),
                    "observations": integer("Its image points.", 0),
                    "left_out": integer("Points left out.", 0),
                    "rms_px?": number("Root mean square of their residuals.", 0),
                },
            ),
        ),
        "skew_s?": number("Between the first and the last exposure."),
        "latency_s?": number("From the arrival of the last image to the result."),
        "moved?": items("Cameras that moved since the calibration.", identifier("")),
    },
)
STUDY = written(
    "study",
    "STUDY.json",
    "A study's figures, beside its page and pictures.",
    {
        "study": text("Its name."),
        "title": text("Its title."),
        "options": {"description": "Its options by name.", "type": "object"},
        "pdf": path("Its page."),
        "pictures": items("The page as pictures.", path("")),
        "compared": items("Lines of the table paper / ours.", {"type": "object"}),
        "trials": items(
            "Every trial.",
            record(
                "",
                {
                    "kind": text("Its kind."),
                    "settings": {"description": "Its settings by name.", "type": "object"},
                    "result": {"description": "Its figures."},
                },
            ),
        ),
    },
    is_read=False,
    more="studies.md",
)
FORMATS = (BODY, SERIES, MEASUREMENTS, WIZARD, LAST_VERIFICATION, STUDY)
