"""What session.json holds, part by part: cameras, placements, poses of bars, scale, board (docs/formats.md)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.messages.values import Phrase
from spherecal.data.lens_model import prior_in_model
from spherecal.data.session import BoardPoint, CameraSpec, Scale
from spherecal.geometry.camera import LENS_MODELS, LensModel, fisheye_vector, intrinsics_vector
from spherecal.geometry.opencv import FISHEYE_LENGTH
from spherecal.targets.masks import Rectangle
from spherecal_files import codec
from spherecal_files.json_file import MOST_CAMERAS, JsonValue, unique
from spherecal_files.rig_file import LENS_MATRIX, distortion, read_distortion
from spherecal_files.target_set_file import given

BoardKind = Literal["circles", "asymmetric-circles", "chessboard", "charuco", "aprilgrid"]
BOARD_KINDS: tuple[BoardKind, ...] = get_args(BoardKind)


def board_grid(kind: str, rows: int, columns: int, pitch_mm: float, marker_mm: float | None) -> FloatArray:
    """Places (n, 2) mm of points row by row, x along the rows; dots and inner corners are `pitch_mm` apart.

    Every second row of `asymmetric-circles` is shifted by it (OpenCV); an `aprilgrid` has four corners a tag (Kalibr).
    """
    if kind == "aprilgrid":
        assert marker_mm is not None
        along, across = (
            np.repeat(np.arange(count) * pitch_mm, 2) + np.tile([0.0, marker_mm], count) for count in (rows, columns)
        )
    else:
        along, across = np.arange(rows) * pitch_mm, np.arange(columns) * pitch_mm
    x, y = np.tile(across, len(along)), np.repeat(along, len(across))
    if kind == "asymmetric-circles":
        x = 2 * x + np.repeat(np.arange(rows) % 2, columns) * pitch_mm
    return np.column_stack([x, y]).astype(np.float64)


_PATH = r"^(?!/)(?!\.$)(?!(.*/)?\.\.(/|$))[^\\\u0000-\u001f]+$"
_LARGEST_IMAGE_PX = 65536
MOST_BOARD_ROWS = 1000  # and columns


def named_file(about: str) -> codec.Kind[JsonValue]:
    """A path below a folder, with "/" between its parts, read as it is: only the caller knows the folder."""
    schema = {"type": "string", "minLength": 1, "maxLength": 500, "pattern": _PATH}
    return codec.Kind({"description": about, **schema} if about else schema, lambda value: value)


@dataclass(frozen=True)
class _Prior:
    """A camera matrix (3, 3), coefficients in OpenCV's order, None where not stated, and what was only assumed."""

    matrix: FloatArray
    distortion: list[float] | None
    assumed: tuple[str, ...] = ()

    def intrinsics(self, model: LensModel) -> tuple[FloatArray, tuple[str, ...]]:
        """As 16 intrinsics of a lens model, and what the prior does not state or only assumes."""
        known = [] if self.distortion is None else self.distortion
        wide = model == "fisheye" and (self.distortion is None or len(known) == FISHEYE_LENGTH)
        lacking = ("distortion",) if self.distortion is None else ()
        return (fisheye_vector if wide else intrinsics_vector)(self.matrix, known), (*lacking, *self.assumed)


def _read_rectangle(value: JsonValue) -> Rectangle:
    left, top, width, height = value.numbers(4)
    if width <= 0 or height <= 0:
        raise value.error(Phrase("problem-rectangle"))
    return left, top, width, height


_SIDES = [codec.number("").schema, codec.number("").schema, codec.positive("").schema, codec.positive("").schema]
_RECTANGLE = codec.Kind({"type": "array", "prefixItems": _SIDES, "minItems": 4, "maxItems": 4}, _read_rectangle)
_DISTORTION = "4, 5, 8 or 12 numbers in OpenCV's order (4 with `fisheye`: those of `cv2.fisheye`); 0 where absent."
_PRIOR = codec.record(
    "Intrinsics to start with.",
    _Prior,
    codec.field("matrix", LENS_MATRIX),
    codec.optional("distortion", codec.Kind(distortion(_DISTORTION), read_distortion)),
    codec.optional("assumed", codec.items("Values that are only assumed.", codec.choice("", ("focal_length",)))),
)
_CAMERA = codec.record(
    "A camera. It needs `prior`, or `pixel_pitch_um` and `focal_length_mm`.",
    dict,
    codec.field("id", codec.identifier("Its id.")),
    codec.field(
        "image_size", codec.items("Width and height in px.", codec.integer("", 1, _LARGEST_IMAGE_PX), length=2)
    ),
    codec.optional("serial", codec.serial("Its serial number.")),
    codec.optional("model", codec.text("The model name that its maker uses.")),
    codec.optional("pixel_pitch_um", codec.positive("Pixel pitch of the sensor.", "um")),
    codec.optional("focal_length_mm", codec.positive("Focal length of the lens.", "mm")),
    codec.optional("prior", _PRIOR),
    codec.optional(
        "intrinsics_group", codec.name("Cameras with the same group share their intrinsics; its id where absent.")
    ),
    codec.optional("lens_model", codec.choice("The lens model that is estimated; `brown` where absent.", LENS_MODELS)),
    codec.optional(
        "ignore", codec.items("Rectangles `[left, top, width, height]` in px in which nothing is a target.", _RECTANGLE)
    ),
)


def _read_camera(value: JsonValue) -> CameraSpec:
    f = _CAMERA.read(value)
    prior, assumed = _start_values(f, value)
    lacking: dict[str, Any] = {"intrinsics_group": f["id"], "lens_model": "brown"}
    return CameraSpec(**lacking | f | {"prior": prior, "prior_given": "prior" in f, "assumed": assumed})


def _start_values(f: Mapping[str, Any], value: JsonValue) -> tuple[FloatArray, tuple[str, ...]]:
    """The intrinsics (16,) that the calibration starts from: the prior's, else of pixel pitch and focal length."""
    model, size = f.get("lens_model", "brown"), f["image_size"]
    if "prior" in f:
        prior, assumed = f["prior"].intrinsics(model)
        if model == "fisheye":  # one in OpenCV's other model is replaced by the nearest
            prior = prior_in_model(f["id"], prior, size, model)
        return prior, assumed
    if "pixel_pitch_um" not in f or "focal_length_mm" not in f:
        raise value.error(Phrase("problem-needs-prior"))
    f_px = f["focal_length_mm"] / f["pixel_pitch_um"] * 1000
    matrix = np.array([[f_px, 0, (size[0] - 1) / 2], [0, f_px, (size[1] - 1) / 2], [0, 0, 1]])
    return (fisheye_vector if model == "fisheye" else intrinsics_vector)(matrix, []), ()


def _check_groups(cameras: Sequence[CameraSpec], value: JsonValue) -> None:
    first_of_group: dict[str, CameraSpec] = {}
    for own, camera in zip(value.items(), cameras, strict=True):
        other = first_of_group.setdefault(camera.intrinsics_group, camera)
        said = {"group": camera.intrinsics_group, "camera": other.id}
        if other.image_size != camera.image_size:
            raise own.error(Phrase("problem-group-size", said))
        if other.lens_model != camera.lens_model:
            raise own.error(Phrase("problem-group-lens", said))


_NEEDED = {"anyOf": [given("prior"), given("pixel_pitch_um", "focal_length_mm")]}
CAMERAS = codec.items(
    "The cameras.", codec.Kind(_CAMERA.schema | _NEEDED, _read_camera), least=1, most=MOST_CAMERAS, differ="id"
).checked(_check_groups)

_IMAGES = codec.entries(
    "Image files by camera id, below the session's folder.", named_file("An image."), codec.identifier("")
)
PLACEMENT = codec.record("", dict, codec.field("id", codec.identifier("Its id.")), codec.optional("images", _IMAGES))
PLACEMENTS = codec.items("The placements of the ball.", PLACEMENT)
BAR_POSE = codec.record(
    "",
    dict,
    codec.field("id", codec.identifier("Its id.")),
    codec.field("bar", codec.name("The bar's id.")),
    codec.optional("temperature_c", codec.celsius("The bar's temperature in degrees Celsius.")),
    codec.optional("images", _IMAGES),
)


def _sphere(
    nominal_diameter_mm: float, expanded_uncertainty_mm: float | None = None, coverage_factor: float = 2.0
) -> tuple[float, float | None]:
    """The ball's diameter and its standard uncertainty in mm."""
    u = expanded_uncertainty_mm
    return nominal_diameter_mm, None if u is None else u / coverage_factor


BAR_POSES = codec.items("The poses of the bars.", BAR_POSE)
SPHERE = codec.record(
    "The ball.",
    _sphere,
    codec.field("nominal_diameter_mm", codec.positive("Its diameter; over the targets where it was measured.", "mm")),
    codec.optional("expanded_uncertainty_mm", codec.positive("Of the measured diameter; absent: not measured.", "mm")),
    codec.optional("coverage_factor", codec.positive("The factor k of that; 2 where absent.")),
)

WANTED = codec.positive("The expanded uncertainty (k = 2) that lengths are wanted with; absent: any.", "mm")


def _check_spacing(scale: Scale, f: Mapping[str, JsonValue]) -> None:
    if scale.from_point == scale.to_point:
        raise f["to"].error(Phrase("problem-same-point", {"point": scale.to_point}))


_BAR_SCALE = codec.record(
    "",
    Scale,
    codec.field("kind", codec.choice("A bar with role `scale`.", ("bar",))),
    codec.field("bar", codec.name("The bar's id.")),
)
_SPACING = codec.record(
    "",
    Scale,
    codec.field("kind", codec.choice("The spacing of two dots of each target.", ("target_spacing",))),
    codec.field("from", codec.name("The first dot."), "from_point"),
    codec.field("to", codec.name("The second dot."), "to_point"),
    codec.field("distance_mm", codec.positive("Their distance as printed.", "mm")),
    codec.field(
        "surface", codec.choice("`sphere`: bent onto the ball, so that the distance is an arc.", ("sphere", "flat"))
    ),
    codec.optional(
        "expanded_uncertainty_mm",
        codec.number("Of the distance as measured on the print; absent: not measured.", 0),
        omit=None,
    ),
    codec.optional(
        "coverage_factor",
        codec.positive("The factor k of that; 2 where absent."),
        lambda scale: None if scale.expanded_uncertainty_mm is None else scale.coverage_factor,
        "coverage_factor",
        omit=None,
    ),
    check=_check_spacing,
)
_NO_SCALE = codec.record("", Scale, codec.field("kind", codec.choice("Lengths do not matter, by choice.", ("none",))))


_SCALES = {"target_spacing": _SPACING, "bar": _BAR_SCALE, "none": _NO_SCALE}
SCALE = replace(
    codec.one_of("Where the scale comes from.", _BAR_SCALE, _SPACING, _NO_SCALE),
    read=lambda value: _SCALES[value.fields(("kind",))["kind"].choice(*_SCALES)].read(value),
    entry=lambda scale: _SCALES[scale.kind].entry(scale),
)


_BOARD_POINT = codec.record(
    "",
    BoardPoint,
    codec.field("target", codec.integer("The target.")),
    codec.field("point", codec.name("Its point.")),
    codec.field("xyz_mm", codec.numbers("Its position on the board.", 3)),
)
_POINTS = codec.items("The board's points, for observations.", _BOARD_POINT, least=1).checked(
    lambda points, value: unique(value.items(), [f"{one.target} {one.point}" for one in points], "target and point")
)
_RING = codec.items("", codec.integer("", 0, MOST_BOARD_ROWS - 1), length=2)
_BOARD = codec.record(
    "The board of `--method board`: `points`, or `rows`, `columns` and `pitch_mm`; for images `kind` as well.",
    dict,
    codec.optional("points", _POINTS),
    codec.optional("kind", codec.choice("What is printed.", BOARD_KINDS)),
    codec.optional("rows", codec.integer("Rows of dots, inner corners or tags.", 2, MOST_BOARD_ROWS)),
    codec.optional("columns", codec.integer("Columns.", 2, MOST_BOARD_ROWS)),
    codec.optional("pitch_mm", codec.positive("Distance of neighbours.", "mm")),
    codec.optional(
        "polarity",
        codec.choice(
            "The colour of dots; `light-on-dark`: another board in inverted colours. `dark-on-light` where absent.",
            ("dark-on-light", "light-on-dark"),
        ),
    ),
    codec.optional("rings", codec.items("`[row, column]` of the dots that have a hole.", _RING)),
    codec.optional("rows_upward", codec.boolean("Whether rows count from the bottom.")),
    codec.optional("dot_diameter_mm", codec.positive("Diameter of a dot.", "mm")),
    codec.optional("marker_mm", codec.positive("Side of a marker, smaller than `pitch_mm`.", "mm")),
    codec.optional("dictionary", codec.text("OpenCV's name of the markers' dictionary.")),
    codec.optional("first_id", codec.integer("The id of its first marker; 0 where absent.", 0, 100_000)),
    codec.optional("legacy", codec.boolean("Whether a ChArUco board was printed before OpenCV 4.6.")),
    codec.optional("border_bits", codec.integer("Black bits around a tag.", 1, 2)),
    codec.optional("relative_uncertainty", codec.number("Relative standard uncertainty of the pitch.", 0, 0.05)),
    codec.optional(
        "shape",
        codec.choice(
            "Whether the points are estimated; where absent, if the data show that they are not where they should be.",
            ("nominal", "estimated"),
        ),
    ),
)
_WITHOUT_TAGS = {"enum": [*sorted(set(BOARD_KINDS) - {"charuco", "aprilgrid"}), None]}
_BOARD_FORMS = [
    given("points"),
    given("rows", "columns", "pitch_mm", kind=_WITHOUT_TAGS),
    given("rows", "columns", "pitch_mm", "marker_mm", kind={"enum": ["aprilgrid"]}),
    given("rows", "columns", "pitch_mm", "marker_mm", "dictionary"),
]
BOARD = replace(_BOARD, schema=_BOARD.schema | {"anyOf": _BOARD_FORMS})
