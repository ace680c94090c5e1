"""Formats of what is recorded: sessions, target sets, captures, and what lies beside a session."""

from file_formats.vocabulary import (
    Schema,
    boolean,
    celsius,
    choice,
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
    path,
    positive,
    record,
    text,
    written,
)
from spherecal.files.bar_registry import FIGURES, SERIAL
from spherecal.files.bundle_file import BUNDLE
from spherecal.files.capture_file import CAPTURE
from spherecal.files.session_file import BAR_POSES, CAMERAS, PLACEMENTS, SCALE, SPHERE
from spherecal.files.target_set_file import TARGETS, given
from spherecal.targets.board_pattern import BOARD_KINDS

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
SESSION = written(
    "session",
    "session.json",
    "What was recorded: cameras, placements of the ball, bars, and the image files.",
    {
        "cameras": CAMERAS.schema,
        "target_set?": path("The file with the target set, mostly `targets.json`."),
        "sphere?": SPHERE.schema,
        "placements?": PLACEMENTS.schema,
        "scale?": SCALE.schema,
        "bars?": items("The reference bars.", _BAR),
        "bar_poses?": BAR_POSES.schema,
        "board?": _BOARD,
    },
    (
        "Ids of cameras, bars, and of placements and bar poses together, differ.",
        "Every named bar, mark, camera, point and file exists.",
        "A placement or pose has images unless there is an observations.csv.",
        "Cameras with one `intrinsics_group` have one image size and one lens model.",
    ),
    more="#sessionjson",
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
