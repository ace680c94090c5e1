"""Formats of what comes out: rigs, verifications, findings, checks, balls, frames, reports, exports."""

from file_formats.vocabulary import (
    SOFTWARE,
    Format,
    Schema,
    boolean,
    choice,
    digest,
    distortion,
    entries,
    finding,
    identifier,
    integer,
    items,
    lens_matrix,
    matrix,
    name,
    number,
    numbers,
    one_of,
    prose,
    record,
    serial,
    sigmas,
    text,
    time,
)
from spherecal.files.ball_file import BALL
from spherecal.files.codec import record as frame_record
from spherecal.files.findings_file import FINDINGS
from spherecal.files.frame_file import FIELDS as FRAME_FIELDS
from spherecal.files.frame_file import FRAME
from spherecal.geometry.camera import INTRINSIC_NAMES
from spherecal.verify.verification_file import VERIFICATION

_MOST_MM = 1e9
_FINDINGS = items("What was found.", finding())
_COEFFICIENTS = one_of(
    "The distortion; a list alone is in OpenCV's order.",
    distortion(""),
    record(
        "",
        {
            "model": choice("OpenCV's model.", ("opencv",)),
            "coefficients": distortion("k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4; 4, 5, 8 or 12 of them."),
        },
    ),
    record(
        "",
        {
            "model": choice("The model of `cv2.fisheye`.", ("opencv-fisheye",)),
            "coefficients": numbers("k1 k2 k3 k4.", 4),
        },
    ),
)
_CAMERA_FIELDS: dict[str, Schema] = {
    "id": identifier("Its id."),
    "image_size": items("Width and height in px.", integer("", 1), length=2),
    "matrix": lens_matrix("`[[fu, 0, u0], [0, fv, v0], [0, 0, 1]]` in px."),
    "distortion": _COEFFICIENTS,
    "rotation": matrix("World to camera: x_cam = R x_world + t.", 3, 3),
    "translation_mm": numbers("World to camera.", 3),
    "serial?": serial("Its serial number."),
    "rms_px?": number("Root mean square of its residuals.", 0),
    "observations?": integer("Used image points.", 0),
    "sigma?": record(
        "Standard uncertainties.",
        {
            "rotation_deg": sigmas("About the camera's axes.", 3),
            "centre_mm": sigmas("Of the projection centre.", 3),
            "matrix": sigmas("Of fu, fv, u0, v0 in px.", 4),
            "distortion": sigmas("Of the coefficients; 0 where fixed."),
        },
    ),
}
_FORM = record(
    "How the ball was modelled.",
    {
        "name": choice("The form.", ("free", "soft", "rigid")),
        "reason": prose("Why."),
        "shape_sd_mm?": number("Standard deviation of a dot's place on the ball.", 0),
        "shape_sd?": choice("Where that comes from.", ("stated", "estimated")),
    },
)
_AFFECTED = items(
    "What care concerns: each has one of these fields.",
    record(
        "",
        {
            "camera?": name("A camera."),
            "scale?": boolean("The scale."),
            "region_mm?": matrix("Low and high corner of a part of the volume.", 2, 3),
        },
    ),
)
RIG = Format(
    "rig",
    "rig.json",
    "The calibrated cameras. The world is the reference camera's frame; lengths in mm. Of another program's rig only "
    "`cameras` is needed.",
    {
        "reference_camera?": name("Whose frame the world is."),
        "cameras": items("The cameras.", record("", _CAMERA_FIELDS), most=1000),
        "scale?": record(
            "Where the scale comes from; without it lengths are taken as mm.",
            {
                "source": choice("Its source.", ("target_spacing", "bar", "board", "ball", "given", "none")),
                "relative_uncertainty?": number("Relative standard uncertainty.", 0),
            },
        ),
        "quality?": record(
            "Whether the rig can be trusted.",
            {
                "valid": boolean("False exactly when the command ends with 3."),
                "verdict?": choice("The verdict.", ("valid", "use-with-care", "not-valid")),
                "affected?": _AFFECTED,
                "rms_px?": number("sqrt(mean(du^2 + dv^2)) of the used observations.", 0),
                "mean_px?": number("Mean length of (du, dv).", 0),
                "sigma0?": number("sqrt(v'Pv / redundancy).", 0),
                "findings": _FINDINGS,
            },
        ),
        "software?": SOFTWARE,
        "input_sha256?": digest("SHA-256 over session.json and every file that it names."),
        "covariance?": record(
            "The covariance of all cameras together, in a file beside this one.",
            {
                "file": choice("Its name.", ("covariance.npy",)),
                "sha256": text("Its SHA-256."),
                "intrinsics": items("Which intrinsics it holds after turn and shift.", choice("", INTRINSIC_NAMES)),
            },
        ),
        "length_uncertainty?": record(
            "A map of the expanded uncertainty of a length.",
            {
                "length_mm": number("The length.", 0),
                "coverage_factor": number("The factor k.", 0),
                "sigma_px": number("Standard deviation of an image coordinate.", 0),
                "places_mm": items("Places in the volume.", numbers("", 3)),
                "directions": items("Directions, unit vectors.", numbers("", 3)),
                "expanded_uncertainty_mm": items("A row for each place, a value for each direction.", sigmas("")),
            },
        ),
        "form?": _FORM,
        "recorded_at?": time("When the last placement was taken."),
        "repairs?": items(
            "Repairs that went into it.",
            record(
                "",
                {
                    "option": prose("Option of the command line."),
                    "value": prose("Its value."),
                    "automatic?": boolean("Whether the program chose it."),
                    "earlier_pose?": record("The camera before it moved.", _CAMERA_FIELDS),
                },
            ),
        ),
    },
    (
        "Ids differ; the reference camera is one of them.",
        "A rotation is orthogonal within 1e-5.",
        "`verdict` agrees with `valid` and `affected`.",
        "A covariance.npy beside it is the one that it names.",
    ),
    more="#result-folder",
)
_ENDS: dict[str, Schema] = {
    "bar": name("The bar."),
    "from": name("The mark at which the length begins."),
    "to": name("At which it ends."),
}
CHECK = Format(
    "check",
    "check.json",
    "The quick check of a rig, as `spherecal check --json` prints it.",
    {
        "verdict": choice("The verdict.", ("ok", "watch", "recalibrate")),
        "sentence": prose("In words."),
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
                    "calibrated_rms_px?": number("That of the calibration.", 0),
                    "moved": boolean("Whether it moved."),
                    "move_px?": number("By how much its image moved."),
                    "shift_mm?": number("Shift of its centre.", 0),
                    "turn_deg?": number("Its turn.", 0),
                    "point_mm?": number("Largest shift of a point that this brings about.", 0),
                    "probability?": number("Probability of such a deviation by chance.", 0, 1),
                    "reason": prose("Why this verdict."),
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
                    "scale_ppm?": number("Its size against the calibration."),
                    "scale_sd_ppm?": number("Standard deviation of that.", 0),
                    "shape_rms_mm?": number("Its shape against the calibration.", 0),
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
        "columns": items("Heads.", prose("")),
        "rows": items("Cells as printed.", items("", prose(""))),
    },
)
REPORT = Format(
    "report",
    "report.json",
    "What the report says, as data.",
    {
        "verdicts": items(
            "The verdicts.",
            record("", {"of": prose("Of what."), "verdict": prose("The word."), "sentence": prose("Why.")}),
        ),
        "key_figures": items(
            "The key figures.",
            record(
                "",
                {"name": prose("What."), "value": prose("As printed."), "unit": prose("Unit."), "note": prose("Note.")},
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
        "input_sha256": digest("That of the rig."),
        "software": SOFTWARE,
    },
    is_read=False,
)
EXPORT = Format(
    "export",
    "export.json",
    "What an exported folder holds; by it the folder is known as one that may be replaced.",
    {
        "export_format": text("The format."),
        "length_unit": text("Unit of lengths."),
        "source": text("Which rig."),
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
        "frame?": frame_record(
            "The user's frame in which poses are given, as in frame.json.", dict, *FRAME_FIELDS
        ).schema,
        "software": SOFTWARE,
    },
    is_read=False,
    more="exports.md",
)
FORMATS = (RIG, VERIFICATION, FINDINGS, CHECK, BALL, FRAME, REPORT, EXPORT)
