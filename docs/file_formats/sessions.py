"""Formats of what is recorded: sessions, target sets, captures, and what lies beside a session."""

from file_formats.vocabulary import (
    Schema,
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
from spherecal_files.bar_registry import FIGURES, SERIAL
from spherecal_files.bundle_file import BUNDLE
from spherecal_files.capture_file import CAPTURE
from spherecal_files.session_file import BAR_POSES, BOARD, CAMERAS, PLACEMENTS, SCALE, SPHERE, WANTED
from spherecal_files.target_set_file import TARGETS, given

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
SESSION = written(
    "session",
    "session.json",
    "What was recorded: cameras, placements of the ball, bars, and the image files.",
    {
        "cameras": CAMERAS.schema,
        "target_set?": path("The file with the target set, mostly `targets.json`."),
        "sphere?": SPHERE.schema,
        "wanted_uncertainty_mm?": WANTED.schema,
        "placements?": PLACEMENTS.schema,
        "scale?": SCALE.schema,
        "bars?": items("The reference bars.", _BAR),
        "bar_poses?": BAR_POSES.schema,
        "board?": BOARD.schema,
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
    "Other files of a folder that this program wrote and may replace.",
    {"files": items("Their names.", text(""))},
    is_read=False,
)
FORMATS = (SESSION, TARGETS, CAPTURE, BUNDLE, TRUTH, WRITTEN)
