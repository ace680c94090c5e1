"""rig.json: the calibrated rig, written and read; what is read back equals what was written."""

import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.rig import (
    Affected,
    CameraCovariance,
    CameraSigma,
    Form,
    Quality,
    Repair,
    Rig,
    RigCamera,
    RigScale,
    Verdict,
    unknown_quality,
)
from spherecal.geometry.camera import INTRINSIC_NAMES, camera_matrix, fisheye_vector, intrinsics_vector, is_fisheye
from spherecal.geometry.field_table import FieldTable
from spherecal.geometry.length_uncertainty import LengthMap
from spherecal.geometry.opencv import FISHEYE_LENGTH, distortion_problem
from spherecal_files import codec
from spherecal_files.findings_file import FINDING, with_values
from spherecal_files.json_file import MOST_CAMERAS, JsonValue, finite, parse_json, read_bytes, read_json, software_entry

COVARIANCE_FILE = "covariance.npy"

_EXPECTED = ("scale", "quality", "input_sha256")
INCOMPLETE = "rig-incomplete"
_MISSING = {"scale": Phrase("lacks-scale"), "quality": Phrase("lacks-quality"), "input_sha256": Phrase("lacks-input")}

# Rotations come from files of others too, printed with six digits or more.
_ROTATION_TOLERANCE = 1e-5


def rig_bytes(rig: Rig, software: Mapping[str, Any] | None = None) -> bytes:
    """The contents of rig.json; the same rig and software give the same bytes, and numbers are read back unchanged."""
    return RIG.bytes(rig, software=software_entry(software))


def check_rig_bytes(content: bytes, path: Path) -> None:
    """Raise what reading the contents of a rig.json would raise, before they are written."""
    RIG.kind.read(JsonValue(parse_json(content), path))


def affected_entries(quality: Quality) -> list[dict[str, Any]]:
    """What care concerns, as the files have it."""
    return _AFFECTED.entry(quality.affected)


def _read_map(value: JsonValue) -> LengthMap:
    keys = ("length_mm", "coverage_factor", "sigma_px", "places_mm", "directions", "expanded_uncertainty_mm")
    f = value.fields(keys)
    places = np.array([place.numbers(3) for place in f["places_mm"].items()]).reshape(-1, 3)
    directions = np.array([direction.numbers(3) for direction in f["directions"].items()]).reshape(-1, 3)
    rows = [_sigmas(row, len(directions)) for row in f["expanded_uncertainty_mm"].items(len(places))]
    length, factor, sigma = (f[key].number(0) for key in keys[:3])
    return LengthMap(length, factor, sigma, places, directions, np.array(rows).reshape(len(places), len(directions)))


def covariance_bytes(covariance: CameraCovariance) -> bytes:
    """The contents of covariance.npy: the matrix of `rig.CameraCovariance` in numpy's format (decision 0007)."""
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(covariance.matrix, dtype="<f8"), allow_pickle=False)
    return file.getvalue()


def _distortion_entry(camera: RigCamera) -> dict[str, Any]:
    """The distortion of a camera: `opencv` with 12 coefficients or `opencv-fisheye` with 4, and its field."""
    wide = is_fisheye(camera.intrinsics)
    model = "opencv-fisheye" if wide else "opencv"
    coefficients = finite(camera.intrinsics[4:8] if wide else camera.intrinsics[4:])
    if camera.field is None:
        return {"model": model, "coefficients": coefficients}
    return {"model": model + _WITH_FIELD, "coefficients": coefficients, "field": _FIELD.entry(camera.field)}


def read_rig(path: Path) -> Rig:
    """The rig in a file and the covariance beside it; what is not stated is unknown, and `rig-incomplete` says so."""
    document = read_json(path, RIG.name, RIG.version)
    stated = RIG.kind.read(document)
    cameras = stated["cameras"]
    kept = stated.get("covariance")
    covariance = None if kept is None else _read_covariance(path.parent, **kept, n_cameras=len(cameras))
    quality = stated.get("quality") or unknown_quality(cameras)
    quality = replace(quality, findings=with_values(quality.findings, path.parent))
    # files of other programs have no `sigma`; ours write null where it is unknown
    values = [camera.value for camera in document.fields(["cameras"])["cameras"].items()]
    without_sigma = [str(value["id"]) for value in values if isinstance(value, dict) and "sigma" not in value]
    quality = _with_missing(quality, [key for key in _EXPECTED if key not in stated], without_sigma)
    return Rig(
        stated.get("reference_camera"),
        cameras,
        stated.get("scale") or RigScale("given", None),
        quality,
        stated.get("input_sha256") or "",
        covariance,
        stated.get("length_map"),
        stated.get("repairs") or (),
        form=stated.get("form"),
        recorded_at=stated.get("recorded_at"),
    )


def _with_missing(quality: Quality, missing: Sequence[str], without_sigma: Sequence[str]) -> Quality:
    """The quality with a finding of what the file does not state, unless it has that finding already."""
    is_stated = any(finding.code == INCOMPLETE and "quality" not in missing for finding in quality.findings)
    if is_stated or not (missing or without_sigma):
        return quality
    said = [_MISSING[key] for key in missing]
    if without_sigma:
        said.append(Phrase("lacks-sigmas", {"cameras": without_sigma}))
    others = tuple(finding for finding in quality.findings if finding.code != INCOMPLETE)
    finding = Finding("rig-incomplete", "info", {"missing": said}, tuple(without_sigma), kind="file")
    return replace(quality, findings=(*others, finding))


def _read_covariance(folder: Path, sha256: str, intrinsics: Sequence[str], n_cameras: int) -> CameraCovariance | None:
    indices = np.array([INTRINSIC_NAMES.index(one) for one in intrinsics])
    path = folder / COVARIANCE_FILE
    if not path.exists():
        return None
    size = n_cameras * (6 + len(intrinsics))
    content = read_bytes(path, 8 * size**2 + 4096)
    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(Phrase("error-other-covariance", {"file": path}))
    try:
        matrix = np.load(io.BytesIO(content), allow_pickle=False)
        matrix = np.asarray(matrix, dtype=float)
    except Exception as error:  # whatever numpy's reader makes of a damaged header
        raise InputError(Phrase("error-damaged-covariance", {"file": path, "why": str(error)})) from None
    if matrix.shape != (size, size) or not np.isfinite(matrix).all():
        raise InputError(Phrase("error-not-covariance", {"file": path, "cameras": n_cameras}))
    return CameraCovariance(matrix, indices.astype(np.int64))


def rotation(about: str) -> codec.Kind[FloatArray]:
    """A rotation matrix (3, 3)."""
    return codec.matrix(about, 3, 3).mapped(np.array).checked(_check_rotation)


def _check_rotation(found: FloatArray, value: JsonValue) -> None:
    off = np.abs(found @ found.T - np.eye(3)).max()
    if not off <= _ROTATION_TOLERANCE or np.linalg.det(found) < 0:  # not a number is no rotation either
        raise value.error(Phrase("problem-rotation"))


def _check_matrix(found: FloatArray, value: JsonValue) -> None:
    if not np.array_equal(found, camera_matrix(intrinsics_vector(found, []))) or min(found[0, 0], found[1, 1]) <= 0:
        raise value.error(Phrase("problem-camera-matrix"))


def _camera(matrix: FloatArray, distortion: tuple[bool, list[float], FieldTable | None], **others: Any) -> RigCamera:
    wide, coefficients, field = distortion
    intrinsics = (fisheye_vector if wide else intrinsics_vector)(matrix, coefficients)
    unknown = {"serial": None, "rms_px": None, "observations": 0, "sigma": None}
    return RigCamera(intrinsics=intrinsics, field=field, **unknown | others)


def _check_sigma(camera: RigCamera, f: Mapping[str, JsonValue]) -> None:
    if camera.sigma is not None:
        lens: Any = f["distortion"].value
        given = f["sigma"].fields(["distortion"])["distortion"]
        given.items(len(lens["coefficients"] if isinstance(lens, dict) else lens))


def _read_lens(value: JsonValue) -> tuple[bool, list[float], FieldTable | None]:
    """Whether a lens is of the fisheye model, its coefficients, and its field; a list alone is in OpenCV's order."""
    if isinstance(value.value, list):
        return False, read_distortion(value), None
    lens = value.fields(("model", "coefficients"), ("field",))
    model = lens["model"].choice(
        *(name + field for name in ("opencv", "opencv-fisheye") for field in ("", _WITH_FIELD))
    )
    if ("field" in lens) != model.endswith(_WITH_FIELD):
        raise value.error(Phrase("problem-field", {"model": model}))
    field = _FIELD.read(lens["field"]) if "field" in lens else None
    wide = model.startswith("opencv-fisheye")
    read = lens["coefficients"].numbers(FISHEYE_LENGTH) if wide else read_distortion(lens["coefficients"])
    return wide, read, field


def _check_field(found: FieldTable, f: Mapping[str, JsonValue]) -> None:
    if not (found.du.size and all(t.shape == found.du.shape for t in (found.dv, found.sd_px) if t is not None)):
        raise f["dv"].error(Phrase("problem-field-table"))


def _table(about: str) -> codec.Kind[FloatArray]:
    """Rows of numbers, all of one length."""
    row = codec.items("", codec.number(""))

    def read(value: JsonValue) -> FloatArray:
        rows = [[cell.number() for cell in one.items()] for one in value.items()]
        if len({len(one) for one in rows}) > 1:
            raise value.error(Phrase("problem-field-table"))
        return np.array(rows, dtype=float).reshape(len(rows), -1)

    return codec.Kind(codec.items(about, row).schema, read, lambda table: np.round(table, 6).tolist())


def read_distortion(value: JsonValue) -> list[float]:
    """4, 5, 8 or 12 numbers in OpenCV's order."""
    numbers = [number.number() for number in value.items()]
    if problem := distortion_problem(len(numbers), fisheye=False):
        raise value.error(problem)
    return numbers


def _sigma(rotation_deg: FloatArray, centre_mm: FloatArray, matrix: FloatArray, distortion: FloatArray) -> CameraSigma:
    rest = np.zeros(max(0, 12 - len(distortion)))
    return CameraSigma(rotation_deg, centre_mm, np.concatenate([matrix, distortion, rest]))


def _sigma_of_distortion(camera: RigCamera) -> FloatArray | None:
    if camera.sigma is None:
        return None
    return camera.sigma.intrinsics[4:8] if is_fisheye(camera.intrinsics) else camera.sigma.intrinsics[4:]


def _sigmas(values: JsonValue, length: int | None = None) -> FloatArray:
    """Standard uncertainties; null, as NaN is written, is NaN again."""
    return np.array([np.nan if item.value is None else item.number(0) for item in values.items(length)])


def _form(name: str, reason: str, shape_sd_mm: float | None = None, shape_sd: str = "") -> Form:
    return Form(name, reason, shape_sd_mm, shape_sd == "stated")


def _shape_sd(form: Form) -> str | None:
    return None if form.shape_sd_mm is None else "stated" if form.stated else "estimated"


def _check_affected(_: Affected, value: JsonValue) -> None:
    if len(value.fields((), ("camera", "scale", "region_mm"))) != 1:
        raise value.error(Phrase("problem-affected"))


def _check_verdict(quality: Quality, f: Mapping[str, JsonValue]) -> None:
    if "verdict" in f and f["verdict"].value != quality.verdict:
        raise f["verdict"].error(Phrase("problem-verdict", {"verdict": quality.verdict}))


def _check_reference(stated: Mapping[str, Any], f: Mapping[str, JsonValue]) -> None:
    reference = stated.get("reference_camera")
    if reference is not None and all(camera.id != reference for camera in stated["cameras"]):
        raise f["reference_camera"].error(Phrase("problem-reference-camera", {"camera": reference}))


def sigmas(about: str, length: int | None = None) -> codec.Kind[FloatArray]:
    """Standard uncertainties; null where unknown, which is NaN in memory."""
    schema = codec.items(about, codec.number("", 0), length=length).schema
    schema["items"] = schema["items"] | {"type": ["number", "null"]}
    return codec.Kind(schema, lambda value: _sigmas(value, length), finite)


def lens_matrix(about: str) -> codec.Schema:
    """A camera matrix [[fu, 0, u0], [0, fv, v0], [0, 0, 1]]."""
    zero, one = {"type": "number", "const": 0}, {"type": "number", "const": 1}
    above, any_ = codec.positive("").schema, codec.number("").schema
    rows = ([above, zero, any_], [zero, above, any_], [zero, zero, one])
    return {"description": about, **_tuple([_tuple(row) for row in rows])}


def _tuple(each: Sequence[codec.Schema]) -> codec.Schema:
    return {"type": "array", "prefixItems": list(each), "minItems": len(each), "maxItems": len(each)}


def distortion(about: str) -> codec.Schema:
    """4, 5, 8 or 12 numbers in OpenCV's order."""
    lengths = [{"minItems": n, "maxItems": n} for n in (4, 5, 8, 12)]
    return ({"description": about} if about else {}) | codec.items("", codec.number("")).schema | {"anyOf": lengths}


def _lens(about: str, model: str, coefficients: codec.Schema, field: codec.Schema | None = None) -> codec.Schema:
    properties = {"model": codec.choice(about, (model,)).schema, "coefficients": coefficients}
    properties |= {} if field is None else {"field": field}
    return {"type": "object", "properties": properties, "required": list(properties)}


LENS_MATRIX = codec.Kind(
    lens_matrix("`[[fu, 0, u0], [0, fv, v0], [0, 0, 1]]` in px."),
    codec.matrix("", 3, 3).mapped(np.array).checked(_check_matrix).read,
    lambda intrinsics: finite(camera_matrix(intrinsics)),
)
_WITH_FIELD = "+field"  # so that who does not know fields refuses the model
_FIELD = codec.record(
    "What the lens does beyond its model, which predicts `uv - F(uv)` of the measured pixel uv.",
    FieldTable,
    codec.field("pitch_px", codec.positive("Distance of neighbouring entries in px.")),
    codec.field("origin_px", codec.numbers("The pixel of the first entry.", 2).mapped(np.array)),
    codec.field("du", _table("F along u in px, a list a row; bilinear between the entries.")),
    codec.field("dv", _table("F along v in px.")),
    codec.optional("sd_px", _table("Standard uncertainty of a coordinate of F in px."), omit=None),
    check=_check_field,
)
_DISTORTION = codec.Kind(
    {
        "description": "The distortion; a list alone is in OpenCV's order.",
        "anyOf": [
            distortion(""),
            _lens(
                "OpenCV's model.", "opencv", distortion("k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4; 4, 5, 8 or 12 of them.")
            ),
            _lens(
                "The model of `cv2.fisheye`.", "opencv-fisheye", codec.numbers("k1 k2 k3 k4.", FISHEYE_LENGTH).schema
            ),
            _lens("OpenCV's model and a field.", "opencv+field", distortion("As of `opencv`."), _FIELD.schema),
            _lens(
                "The model of `cv2.fisheye` and a field.",
                "opencv-fisheye+field",
                codec.numbers("k1 k2 k3 k4.", FISHEYE_LENGTH).schema,
                _FIELD.schema,
            ),
        ],
    },
    _read_lens,
    _distortion_entry,
)
_SIGMA = codec.record(
    "Standard uncertainties.",
    _sigma,
    codec.field("rotation_deg", sigmas("About the camera's axes.", 3), "sigma.rotation_deg"),
    codec.field("centre_mm", sigmas("Of the projection centre.", 3), "sigma.centre_mm"),
    codec.field("matrix", sigmas("Of fu, fv, u0, v0 in px.", 4), lambda camera: camera.sigma.intrinsics[:4], "matrix"),
    codec.field("distortion", sigmas("Of the coefficients; 0 where fixed."), _sigma_of_distortion, "distortion"),
)
_CAMERA = codec.record(
    "",
    _camera,
    codec.field("id", codec.identifier("Its id.")),
    codec.optional("serial", codec.serial("Its serial number.")),
    codec.field("image_size", codec.items("Width and height in px.", codec.integer("", 1), length=2)),
    codec.field("matrix", LENS_MATRIX, "intrinsics", "matrix"),
    codec.field("distortion", _DISTORTION, lambda camera: camera, "distortion"),
    codec.field("rotation", rotation("World to camera: x_cam = R x_world + t.")),
    codec.field("translation_mm", codec.numbers("World to camera.", 3).mapped(np.array)),
    codec.optional("rms_px", codec.number("Root mean square of its residuals.", 0)),
    codec.optional("observations", codec.integer("Used image points.", 0)),
    codec.optional("sigma", _SIGMA, lambda camera: camera if camera.sigma is not None else None, "sigma"),
    check=_check_sigma,
)
_AFFECTED = codec.items(
    "The parts that require care; each has one of these fields.",
    codec.record(
        "",
        Affected,
        codec.optional("camera", codec.name("A camera."), omit=None),
        codec.optional("scale", codec.boolean("The scale."), omit=False),
        codec.optional("region_mm", codec.matrix("Low and high corner of a part of the volume.", 2, 3), omit=None),
    ).checked(_check_affected),
)
_QUALITY = codec.record(
    "Whether the rig can be trusted.",
    Quality,
    codec.field("valid", codec.boolean("False exactly when the command ends with 3.")),
    codec.optional("verdict", codec.choice("The verdict.", get_args(Verdict)), lambda quality: quality.verdict),
    codec.optional("affected", _AFFECTED),
    codec.optional("rms_px", codec.number("sqrt(mean(du^2 + dv^2)) of the used observations.", 0)),
    codec.optional("mean_px", codec.number("Mean length of (du, dv).", 0)),
    codec.optional("sigma0", codec.number("sqrt(v'Pv / redundancy).", 0)),
    codec.field("findings", codec.items("What was found.", FINDING)),
    check=_check_verdict,
)
_COVARIANCE = codec.record(
    "The covariance of all cameras together, in a file beside this one.",
    dict,
    codec.field("file", codec.choice("Its name.", (COVARIANCE_FILE,)), lambda _: COVARIANCE_FILE),
    codec.field(
        "sha256", codec.text("Its SHA-256."), lambda one: hashlib.sha256(covariance_bytes(one)).hexdigest(), "sha256"
    ),
    codec.field(
        "intrinsics",
        codec.items("The intrinsics in it, after rotation and translation.", codec.choice("", INTRINSIC_NAMES)),
        lambda one: [INTRINSIC_NAMES[i] for i in one.intrinsics],
        "intrinsics",
    ),
)
_MAP = codec.record(
    "A map of the expanded uncertainty of a length.",
    dict,
    codec.field("length_mm", codec.number("The length.", 0)),
    codec.field("coverage_factor", codec.number("The factor k.", 0)),
    codec.field("sigma_px", codec.number("Standard deviation of an image coordinate.", 0)),
    codec.field(
        "places_mm", codec.items("Places in the volume.", codec.numbers("", 3)), lambda one: np.round(one.places_mm, 3)
    ),
    codec.field(
        "directions",
        codec.items("Directions, unit vectors.", codec.numbers("", 3)),
        lambda one: np.round(one.directions, 6),
    ),
    codec.field(
        "expanded_uncertainty_mm",
        codec.items("A row for each place, a value for each direction.", sigmas("")),
        lambda one: [[float(f"{u:.4g}") for u in row] for row in one.expanded_mm],
    ),
)
_FORM = codec.record(
    "How the ball was modelled.",
    _form,
    codec.field("name", codec.choice("The form.", ("free", "soft", "rigid"))),
    codec.field("reason", codec.prose("The reason for this form.")),
    codec.optional("shape_sd_mm", codec.number("Standard deviation of a dot's place on the ball.", 0), omit=None),
    codec.optional(
        "shape_sd",
        codec.choice("Where `shape_sd_mm` comes from.", ("stated", "estimated")),
        _shape_sd,
        "shape_sd",
        omit=None,
    ),
)
_REPAIR = codec.record(
    "",
    Repair,
    codec.field("option", codec.prose("Option of the command line.")),
    codec.field("value", codec.prose("Its value.")),
    codec.optional("automatic", codec.boolean("Whether the program chose it."), omit=False),
    codec.optional("earlier_pose", _CAMERA.described("The camera before it moved."), omit=None),
)
_SCALE = codec.record(
    "Where the scale comes from; without it lengths are assumed to be in mm.",
    RigScale,
    codec.field("source", codec.choice("Its source.", ("target_spacing", "bar", "board", "ball", "given", "none"))),
    codec.optional("relative_uncertainty", codec.number("Relative standard uncertainty.", 0)),
)
RIG = codec.FileFormat(
    "spherecal/rig",
    "rig.json",
    "The calibrated cameras. The world is the reference camera's frame; lengths in mm. Of another program's rig only "
    "`cameras` is needed.",
    codec.record(
        "",
        dict,
        codec.optional("reference_camera", codec.name("The camera whose frame is the world.")),
        codec.field("cameras", codec.items("The cameras.", _CAMERA, most=MOST_CAMERAS, differ="id")),
        codec.optional("scale", _SCALE),
        codec.optional("quality", _QUALITY),
        codec.software(),
        codec.optional("input_sha256", codec.digest("SHA-256 over session.json and every file that it names.")),
        codec.optional("covariance", _COVARIANCE, omit=None),
        codec.optional("length_uncertainty", replace(_MAP, read=_read_map), "length_map", omit=None),
        codec.optional("form", _FORM, omit=None),
        codec.optional("recorded_at", codec.time("When the last placement was taken."), omit=None),
        codec.optional("repairs", codec.items("Repairs that were made.", _REPAIR), omit=()),
        check=_check_reference,
    ),
    (
        "Ids differ; the reference camera is one of them.",
        "A rotation is orthogonal within 1e-5.",
        "`verdict` agrees with `valid` and `affected`.",
        "A covariance.npy beside it is the one that it names.",
    ),
    more="#result-folder",
)
