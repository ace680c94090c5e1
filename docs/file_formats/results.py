"""Formats of what comes out: rigs, verifications, findings, checks, balls, frames, reports, exports."""

from file_formats.vocabulary import (
    SOFTWARE,
    Schema,
    boolean,
    choice,
    digest,
    entries,
    finding,
    identifier,
    integer,
    items,
    name,
    number,
    prose,
    record,
    text,
    written,
)
from spherecal_files.ball_file import BALL
from spherecal_files.codec import record as frame_record
from spherecal_files.findings_file import FINDINGS
from spherecal_files.rig_file import RIG
from spherecal_files.verification_file import VERIFICATION
from spherecal_rigs.framed_rig import FIELDS as FRAME_FIELDS
from spherecal_rigs.framed_rig import FRAME

_MOST_MM = 1e9
_FINDINGS = items("What was found.", finding())
_ENDS: dict[str, Schema] = {
    "bar": name("The bar."),
    "from": name("The mark at which the length begins."),
    "to": name("The mark at which it ends."),
}
CHECK = written(
    "check",
    "check.json",
    "The quick check of a rig, as `spherecal check --json` prints it.",
    {
        "verdict": choice("The verdict.", ("ok", "watch", "recalibrate")),
        "sentence": prose("The verdict in words."),
        "tolerance_mm?": number("A camera whose move shifts a point by more is to be recalibrated.", 0),
        "cameras": items(
            "The cameras, worst first.",
            record(
                "",
                {
                    "id": identifier("Its id."),
                    "verdict": choice("Its verdict.", ("ok", "watch", "recalibrate")),
                    "points": integer("Points that it saw.", 0),
                    "rms_px?": number("Root mean square of their residuals.", 0),
                    "calibrated_rms_px?": number("Root mean square of the residuals at the calibration.", 0),
                    "moved": boolean("Whether it moved."),
                    "move_px?": number("By how much its image moved."),
                    "shift_mm?": number("Shift of its centre.", 0),
                    "turn_deg?": number("Rotation of the camera.", 0),
                    "point_mm?": number("Largest shift of a point that this causes.", 0),
                    "probability?": number("Probability of such a deviation by chance.", 0, 1),
                    "reason": prose("The reason for this verdict."),
                },
            ),
        ),
        "untested": items("Cameras that saw too little.", identifier("")),
        "balls": items(
            "Each placement of the ball.",
            record(
                "",
                {
                    "placement": identifier("The placement."),
                    "dots": integer("Dots compared.", 0),
                    "scale_ppm?": number("Its size compared with the calibration."),
                    "scale_sd_ppm?": number("Standard deviation of `scale_ppm`.", 0),
                    "shape_rms_mm?": number("Its shape compared with the calibration.", 0),
                    "changed": integer("Dots that moved on the ball.", 0),
                },
            ),
        ),
        "lengths": items(
            "Lengths of bars.",
            record(
                "",
                {
                    **_ENDS,
                    "pose": identifier("The pose."),
                    "length_mm?": number("Measured.", 0),
                    "reference_mm?": number("Certified, at the pose's temperature.", 0),
                    "error_mm?": number("Their difference."),
                    "u_mm?": number("Standard uncertainty of the error.", 0),
                },
            ),
        ),
        "findings": _FINDINGS,
        "software": SOFTWARE,
    },
    is_read=False,
)
_TABLE = record(
    "",
    {
        "title": prose("Its title."),
        "columns": items("Column headings.", prose("")),
        "rows": items("Cells as printed.", items("", prose(""))),
    },
)
REPORT = written(
    "report",
    "report.json",
    "What the report says, as data.",
    {
        "verdicts": items(
            "The verdicts.",
            record(
                "", {"of": prose("What is judged."), "verdict": prose("The verdict."), "sentence": prose("The reason.")}
            ),
        ),
        "key_figures": items(
            "The key figures.",
            record(
                "",
                {"name": prose("Name."), "value": prose("As printed."), "unit": prose("Unit."), "note": prose("Note.")},
            ),
        ),
        "findings": _FINDINGS,
        "sections": items(
            "The sections.",
            record(
                "",
                {
                    "key": prose("Its name for programs."),
                    "title": prose("Its title."),
                    "paragraphs": items("Its text.", prose("")),
                    "tables": items("Its tables.", _TABLE),
                },
            ),
        ),
        "input_sha256": digest("`input_sha256` of the rig."),
        "software": SOFTWARE,
    },
    is_read=False,
)
EXPORT = written(
    "export",
    "export.json",
    "The contents of an exported folder, which may be replaced.",
    {
        "export_format": text("The format."),
        "length_unit": text("Unit of lengths."),
        "source": text("The rig that was exported."),
        "verdict": choice("The rig's verdict.", ("valid", "use-with-care", "not-valid")),
        "cameras": entries("Names of the cameras there, by id.", prose("")),
        "files_sha256": {
            "description": "SHA-256 of the files by name.",
            "type": "object",
            "additionalProperties": digest(""),
        },
        "refit": entries(
            "Lenses that were replaced by the nearest one of the format, by camera.",
            record(
                "",
                {
                    "rms_px": number("Difference of projections, rms.", 0),
                    "max_px": number("Largest difference.", 0),
                    "max_px_over_image?": number("Largest difference all over the image.", 0),
                },
            ),
        ),
        "fields_lost": entries(
            "Fields of lenses that the format cannot hold, by camera.",
            record(
                "",
                {
                    "max_px": number("The largest of the field where it is known.", 0),
                    "max_mm": number("The same at the rig's distance.", 0),
                },
            ),
        ),
        "frame?": frame_record(
            "The user's frame in which poses are given, as in frame.json.", dict, *FRAME_FIELDS
        ).schema,
        "software": SOFTWARE,
    },
    is_read=False,
    more="exports.md",
)
FORMATS = (RIG, VERIFICATION, FINDINGS, CHECK, BALL, FRAME, REPORT, EXPORT)
