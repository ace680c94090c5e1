"""Formats of what is recorded: sessions, target sets, captures, and what lies beside a session."""

from file_formats.vocabulary import (
    SOFTWARE,
    Schema,
    boolean,
    celsius,
    choice,
    digest,
    distortion,
    entries,
    identifier,
    integer,
    items,
    lens_matrix,
    matrix,
    name,
    number,
    numbers,
    one_of,
    path,
    positive,
    record,
    serial,
    text,
    time,
    unread,
    written,
)
from spherecal.files.bar_registry import FIGURES, SERIAL
from spherecal.files.target_set_file import TARGETS, given
from spherecal.geometry.camera import LENS_MODELS
from spherecal.targets.board_pattern import BOARD_KINDS

_IMAGES = entries("Image files by camera id, below the session's folder.", path("An image."), identifier(""))


_CAMERA = record(
    "A camera. It needs `prior`, or `pixel_pitch_um` and `focal_length_mm`.",
    {
        "id": identifier("Its id."),
        "image_size": items("Width and height in px.", integer("", 1, 65536), length=2),
        "serial?": serial("Its serial number."),
        "model?": text("Its maker's name for it."),
        "pixel_pitch_um?": positive("Pixel pitch of the sensor."),
        "focal_length_mm?": positive("Focal length of the lens."),
        "prior?": record(
            "Intrinsics to start with.",
            {
                "matrix": lens_matrix("`[[fu, 0, u0], [0, fv, v0], [0, 0, 1]]` in px."),
                "distortion?": distortion(
                    "4, 5, 8 or 12 numbers in OpenCV's order (4 with `fisheye`: those of `cv2.fisheye`); 0 where absent."  # noqa: E501
                ),
                "assumed?": items("What nobody knows better.", choice("", ("focal_length",))),
            },
        ),
        "intrinsics_group?": name("Cameras with the same group share their intrinsics; its id where absent."),
        "lens_model?": choice("What is estimated; `brown` where absent.", LENS_MODELS),
        "ignore?": items(
            "Rectangles `[left, top, width, height]` in px in which nothing is a target.",
            {
                "type": "array",
                "prefixItems": [number(""), number(""), positive(""), positive("")],
                "minItems": 4,
                "maxItems": 4,
            },
        ),
    },
) | {"anyOf": [given("prior"), given("pixel_pitch_um", "focal_length_mm")]}
_FIGURES: dict[str, Schema] = {one.key: one.kind.schema for one in FIGURES}
_BAR: Schema = record(
    "A reference bar: with `marks` and `lengths`, or with the `serial` of a bar of bars.json.",
    {
        "id": identifier("Its id."),
        "role": choice("Whether it gives the scale or checks it.", ("scale", "check")),
        "serial?": SERIAL.schema,
        "marks?": _FIGURES["marks"],
        "lengths?": _FIGURES["lengths"],
    },
) | {"anyOf": [given("marks", "lengths"), given("serial")]}
_BAR["properties"] |= {key: _FIGURES[key] for key in _FIGURES if key not in _BAR["properties"]}
_SCALE = one_of(
    "Where the scale comes from.",
    record("", {"kind": choice("A bar with role `scale`.", ("bar",)), "bar": name("The bar's id.")}),
    record(
        "",
        {
            "kind": choice("The spacing of two dots of each target.", ("target_spacing",)),
            "from": name("The first dot."),
            "to": name("The second dot."),
            "distance_mm": positive("Their distance as printed."),
            "surface": choice("`sphere`: bent onto the ball, so that the distance is an arc.", ("sphere", "flat")),
        },
    ),
)
_BOARD_POINT = record(
    "",
    {"target": integer("The target."), "point": name("Its point."), "xyz_mm": numbers("Its place on the board.", 3)},
)
_BOARD = record(
    "The board of `--method board`: `points`, or `rows`, `columns` and `pitch_mm`; for images `kind` as well.",
    {
        "points?": items("The board's points, for observations.", _BOARD_POINT, least=1),
        "kind?": choice("What is printed.", BOARD_KINDS),
        "rows?": integer("Rows of dots, inner corners or tags.", 2, 1000),
        "columns?": integer("Columns.", 2, 1000),
        "pitch_mm?": positive("Distance of neighbours."),
        "polarity?": choice("The colour of dots; `dark-on-light` where absent.", ("dark-on-light", "light-on-dark")),
        "rings?": items("`[row, column]` of the dots that have a hole.", items("", integer("", 0, 999), length=2)),
        "rows_upward?": boolean("Whether rows count from the bottom."),
        "dot_diameter_mm?": positive("Diameter of a dot."),
        "marker_mm?": positive("Side of a marker, smaller than `pitch_mm`."),
        "dictionary?": text("OpenCV's name of the markers' dictionary."),
        "legacy?": boolean("Whether a ChArUco board was printed before OpenCV 4.6."),
        "border_bits?": integer("Black bits around a tag.", 1, 2),
        "relative_uncertainty?": number("Relative standard uncertainty of the pitch.", 0, 0.05),
        "shape?": choice("Whether the points are estimated; `nominal` where absent.", ("nominal", "estimated")),
    },
) | {
    "anyOf": [
        given("points"),
        given(
            "rows", "columns", "pitch_mm", kind={"enum": [*sorted(set(BOARD_KINDS) - {"charuco", "aprilgrid"}), None]}
        ),
        given("rows", "columns", "pitch_mm", "marker_mm", kind={"enum": ["aprilgrid"]}),
        given("rows", "columns", "pitch_mm", "marker_mm", "dictionary"),
    ]
}
_PLACEMENT: dict[str, Schema] = {"id": identifier("Its id.")}


def _sets(about: str, fields: dict[str, Schema]) -> Schema:
    return items(about, record("", {**_PLACEMENT, **fields, "images?": _IMAGES}))


SESSION = written(
    "session",
    "session.json",
    "What was recorded: cameras, placements of the ball, bars, and the files that hold the images.",
    {
        "cameras": items("The cameras.", _CAMERA, 1, 1000),
        "target_set?": path("The file with the target set, mostly `targets.json`."),
        "sphere?": record("The ball.", {"nominal_diameter_mm": positive("Its diameter.")}),
        "placements?": _sets("The placements of the ball.", {}),
        "scale?": _SCALE,
        "bars?": items("The reference bars.", _BAR),
        "bar_poses?": _sets(
            "The poses of the bars.",
            {"bar": name("The bar's id."), "temperature_c?": celsius("The bar's temperature in degrees Celsius.")},
        ),
        "board?": _BOARD,
    },
    (
        "Ids of cameras, bars, and of placements and bar poses together, differ.",
        "A bar, mark, camera or point that is named is there, and so is every file.",
        "A placement or pose has images unless there is an observations.csv.",
        "Cameras with one `intrinsics_group` have one image size and one lens model.",
    ),
    more="#sessionjson",
)
CAPTURE = written(
    "capture",
    "capture.json",
    "When and how a session was captured, beside its session.json.",
    {
        "source?": unread("The source of the images: `kind`, `label`, `simulated`."),
        "cameras": items(
            "The cameras.", record("", {"id": identifier("Its id."), "serial": serial("Its serial number.")})
        ),
        "sets": items(
            "The sets of images, in the order in which they were taken.",
            record(
                "",
                {
                    "id": identifier("The placement or bar pose."),
                    "taken": time("When."),
                    "images": entries("Image files by camera.", path("")),
                    "attempts?": unread("How often it was tried."),
                    "seconds?": unread("How long it took."),
                    "spread_s?": unread("Between the first and the last exposure."),
                    "late?": unread("Cameras whose images came too late."),
                    "missing?": unread("Cameras without an image, with the cause."),
                    "cameras?": entries(
                        "What each camera noted of its image.",
                        record(
                            "",
                            {
                                "frame_id?": integer("Number of the frame."),
                                "time_stamp_ns?": integer("The camera's own clock.", -(2**64), 2**64),
                                "exposed?": time("When it was exposed."),
                                "temperature_c?": celsius("The camera's temperature in degrees Celsius."),
                                "exposure_us?": unread("Exposure time."),
                                "gain_db?": unread("Gain."),
                                "pixel_format?": unread("Pixel format."),
                                "bits?": unread("Significant bits."),
                                "averaged?": unread("How many frames were averaged."),
                                "dots?": unread("Dots that were found."),
                                "motion_px?": unread("How far they moved between frames."),
                                "noise_px?": unread("Their noise between frames."),
                            },
                        ),
                    ),
                },
            ),
        ),
    },
)
BUNDLE = written(
    "bundle",
    "bundle.json",
    "Beside a session whose images were left out for a support bundle: what the original was.",
    {
        "input_sha256": digest("`input_sha256` of the original session.") | {"minLength": 64},
        "files_sha256": {
            "description": "SHA-256 of the session's files by name.",
            "type": "object",
            "additionalProperties": text(""),
        },
        "images?": unread("Whether the images are in it: `all`, `none` ..."),
        "software?": SOFTWARE,
    },
)
TRUTH = written(
    "truth",
    "truth.json",
    "The exact values behind a simulated session, in the frame of the simulated rig.",
    {
        "preset": text("The rig that was simulated."),
        "seed": integer("The seed of its random numbers."),
        "options": {"description": "Options of the simulation by name.", "type": "object"},
        "cameras": items(
            "The cameras.",
            record(
                "",
                {
                    "id": identifier("Its id."),
                    "matrix": lens_matrix("Camera matrix."),
                    "distortion": distortion("12 numbers in OpenCV's order, or 4 of a fisheye lens."),
                    "rotation": matrix("World to camera.", 3, 3),
                    "translation_mm": numbers("World to camera.", 3),
                    "sigma_px": number("Noise of an image coordinate.", 0),
                },
            ),
        ),
        "ball": record(
            "The ball.",
            {
                "radius_mm": positive("Its mean radius."),
                "dots": items(
                    "Its dots in its own frame.",
                    record("", {"target": integer("The target."), "point": name("The dot."), "xyz_mm": numbers("", 3)}),
                ),
            },
        ),
        "placements": items(
            "The ball's poses, ball to world.",
            record("", {"id": identifier(""), "rotation": matrix("", 3, 3), "translation_mm": numbers("", 3)}),
        ),
        "bars": items(
            "The bars: places of their marks along the bar in mm.",
            record("", {"id": identifier(""), "marks": entries("", number("")), "targets": items("", integer(""))}),
        ),
        "bar_poses": items(
            "The bars' poses, bar to world.",
            record(
                "",
                {
                    "id": identifier(""),
                    "bar": name(""),
                    "rotation": matrix("", 3, 3),
                    "translation_mm": numbers("", 3),
                    "temperature_c": celsius(""),
                },
            ),
        ),
        "outliers": items("Rows of observations.csv that were spoilt, from 0.", integer("", 0)),
    },
    is_read=False,
)
WRITTEN = written(
    "written",
    "written.json",
    "Files of a folder that this program wrote beside those of its kind; such a folder may be replaced as a whole.",
    {"files": items("Their names.", text(""))},
    is_read=False,
)
FORMATS = (SESSION, TARGETS, CAPTURE, BUNDLE, TRUTH, WRITTEN)
