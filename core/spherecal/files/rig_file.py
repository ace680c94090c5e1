"""rig.json: the calibrated rig, written and read; what is read back equals what was written."""

import hashlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

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
    unknown_quality,
)
from spherecal.files.codec import Kind, matrix
from spherecal.files.findings_file import FINDING, with_values
from spherecal.files.json_file import (
    MOST_CAMERAS,
    JsonValue,
    finite,
    json_bytes,
    read_bytes,
    read_json,
    software_entry,
    unique,
)
from spherecal.geometry.camera import (
    INTRINSIC_NAMES,
    camera_matrix,
    fisheye_vector,
    intrinsics_vector,
    is_fisheye,
)
from spherecal.geometry.opencv import FISHEYE_LENGTH, distortion_problem
from spherecal.predict.volume_map import LengthMap

FORMAT = "spherecal/rig"
VERSION = 1
COVARIANCE_FILE = "covariance.npy"

_EXPECTED = ("scale", "quality", "input_sha256")
_OPTIONAL = (
    *_EXPECTED, "reference_camera", "covariance", "length_uncertainty", "repairs", "form", "recorded_at"
)  # fmt: skip
INCOMPLETE = "rig-incomplete"
_MISSING = {
    "scale": Phrase("lacks-scale"),
    "quality": Phrase("lacks-quality"),
    "input_sha256": Phrase("lacks-input"),
}

# Rotations come from files of others too, printed with six digits or more.
_ROTATION_TOLERANCE = 1e-5


def rig_bytes(rig: Rig, software: Mapping[str, Any] | None = None) -> bytes:
    """The contents of rig.json; the same rig and software give the same bytes, and numbers are read back unchanged."""
    quality = rig.quality
    document = {
        "format": FORMAT,
        "version": VERSION,
        "reference_camera": rig.reference_camera,
        "cameras": [_camera_entry(camera) for camera in rig.cameras],
        "scale": {
            "source": rig.scale.source,
            "relative_uncertainty": finite(rig.scale.relative_uncertainty),
        },
        "quality": {
            "valid": bool(quality.valid),
            "verdict": quality.verdict,
            "affected": affected_entries(quality),
            "rms_px": finite(quality.rms_px),
            "mean_px": finite(quality.mean_px),
            "sigma0": finite(quality.sigma0),
            "findings": [FINDING.entry(finding) for finding in quality.findings],
        },
        "software": software_entry(software),
        "input_sha256": rig.input_sha256,
    }
    if rig.covariance is not None:
        document["covariance"] = {
            "file": COVARIANCE_FILE,
            "sha256": hashlib.sha256(covariance_bytes(rig.covariance)).hexdigest(),
            "intrinsics": [INTRINSIC_NAMES[i] for i in rig.covariance.intrinsics],
        }
    if rig.length_map is not None:
        document["length_uncertainty"] = _map_entry(rig.length_map)
    if rig.form is not None:
        document["form"] = _form_entry(rig.form)
    if rig.recorded_at is not None:
        document["recorded_at"] = rig.recorded_at.isoformat()
    if rig.repairs:
        document["repairs"] = [_repair_entry(repair) for repair in rig.repairs]
    return json_bytes(document)


def affected_entries(quality: Quality) -> list[dict[str, Any]]:
    """What care concerns, as the files have it."""
    return [_affected_entry(one) for one in quality.affected]


def _affected_entry(one: Affected) -> dict[str, Any]:
    if one.camera is not None:
        return {"camera": one.camera}
    return {"scale": True} if one.scale else {"region_mm": finite(one.region_mm)}


def _read_affected(value: JsonValue) -> Affected:
    f = value.fields((), ("camera", "scale", "region_mm"))
    if len(f) != 1:
        raise value.error(Phrase("problem-affected"))
    if "camera" in f:
        return Affected(camera=f["camera"].name())
    if "scale" in f:
        return Affected(scale=f["scale"].boolean())
    low, high = f["region_mm"].matrix(2, 3)
    return Affected(region_mm=((low[0], low[1], low[2]), (high[0], high[1], high[2])))


def _form_entry(form: Form) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": form.name, "reason": form.reason}
    if form.shape_sd_mm is not None:
        entry |= {"shape_sd_mm": finite(form.shape_sd_mm), "shape_sd": "stated" if form.stated else "estimated"}
    return entry


def _read_form(value: JsonValue) -> Form:
    f = value.fields(("name", "reason"), ("shape_sd_mm", "shape_sd"))
    sd = f["shape_sd_mm"].number(0) if "shape_sd_mm" in f else None
    stated = "shape_sd" in f and f["shape_sd"].choice("stated", "estimated") == "stated"
    return Form(f["name"].choice("free", "soft", "rigid"), f["reason"].prose(), sd, stated)


def _repair_entry(repair: Repair) -> dict[str, Any]:
    entry: dict[str, Any] = {"option": repair.option, "value": repair.value}
    if repair.automatic:
        entry["automatic"] = True
    if repair.earlier_pose is not None:
        entry["earlier_pose"] = _camera_entry(repair.earlier_pose)
    return entry


def _read_repair(value: JsonValue) -> Repair:
    f = value.fields(("option", "value"), ("earlier_pose", "automatic"))
    earlier = _read_camera(f["earlier_pose"]) if "earlier_pose" in f else None
    automatic = "automatic" in f and f["automatic"].boolean()
    return Repair(f["option"].prose(), f["value"].prose(), earlier, automatic)


def _map_entry(found: LengthMap) -> dict[str, Any]:
    """The map of a length's expanded uncertainty: a row for each place, a column for each direction, 4 digits."""
    return {
        "length_mm": found.length_mm,
        "coverage_factor": found.coverage_factor,
        "sigma_px": finite(found.sigma_px),
        "places_mm": finite(np.round(found.places_mm, 3)),
        "directions": finite(np.round(found.directions, 6)),
        "expanded_uncertainty_mm": [
            [None if not np.isfinite(u) else float(f"{u:.4g}") for u in row] for row in found.expanded_mm
        ],
    }


def _read_map(value: JsonValue) -> LengthMap:
    keys = ("length_mm", "coverage_factor", "sigma_px", "places_mm", "directions", "expanded_uncertainty_mm")
    f = value.fields(keys)
    places = np.array([place.numbers(3) for place in f["places_mm"].items()]).reshape(-1, 3)
    directions = np.array([direction.numbers(3) for direction in f["directions"].items()]).reshape(-1, 3)
    rows = [_sigmas(row, len(directions)) for row in f["expanded_uncertainty_mm"].items(len(places))]
    length, factor, sigma = (f[key].number(0) for key in keys[:3])
    return LengthMap(length, factor, sigma, places, directions, np.array(rows).reshape(len(places), len(directions)))


def covariance_bytes(covariance: CameraCovariance) -> bytes:
    """The contents of covariance.npy: the matrix of `rig.CameraCovariance` in numpy's own format."""
    file = io.BytesIO()
    np.save(file, np.ascontiguousarray(covariance.matrix, dtype="<f8"), allow_pickle=False)
    return file.getvalue()


def _camera_entry(camera: RigCamera) -> dict[str, Any]:
    sigma = camera.sigma
    return {
        "id": camera.id,
        "serial": camera.serial,
        "image_size": [int(side) for side in camera.image_size],
        "matrix": finite(camera_matrix(camera.intrinsics)),
        "distortion": distortion_entry(camera.intrinsics),
        "rotation": finite(camera.rotation),
        "translation_mm": finite(camera.translation_mm),
        "rms_px": finite(camera.rms_px),
        "observations": int(camera.observations),
        "sigma": sigma
        and {
            "rotation_deg": finite(sigma.rotation_deg),
            "centre_mm": finite(sigma.centre_mm),
            "matrix": finite(sigma.intrinsics[:4]),
            "distortion": finite(sigma.intrinsics[4:8] if is_fisheye(camera.intrinsics) else sigma.intrinsics[4:]),
        },
    }


def distortion_entry(intrinsics: FloatArray) -> dict[str, Any]:
    """The distortion of a lens (16,): `opencv` with 12 coefficients, or `opencv-fisheye` with 4."""
    if is_fisheye(intrinsics):
        return {"model": "opencv-fisheye", "coefficients": finite(intrinsics[4:8])}
    return {"model": "opencv", "coefficients": finite(intrinsics[4:])}


def read_rig(path: Path) -> Rig:
    """The rig in a file; InputError where it is not as the interface says.

    The cameras' covariance lies beside it; a rig.json that was copied alone has none. What it does not state is taken
    as unknown, and the finding `rig-incomplete` says so.
    """
    f = read_json(path, FORMAT, VERSION).fields(("cameras",), _OPTIONAL)
    values = f["cameras"].items(most=MOST_CAMERAS)
    cameras = tuple(_read_camera(value) for value in values)
    unique(values, [camera.id for camera in cameras], "id")
    reference = f["reference_camera"].name() if "reference_camera" in f else None
    if reference is not None and all(camera.id != reference for camera in cameras):
        raise f["reference_camera"].error(Phrase("problem-reference-camera", {"camera": reference}))
    covariance = _read_covariance(path.parent, f["covariance"], len(cameras)) if "covariance" in f else None
    quality = _read_quality(f["quality"]) if "quality" in f else unknown_quality(cameras)
    quality = replace(quality, findings=with_values(quality.findings, path.parent))
    quality = _with_missing(quality, [key for key in _EXPECTED if key not in f], _without_sigma(values))
    lengths = _read_map(f["length_uncertainty"]) if "length_uncertainty" in f else None
    repairs = tuple(_read_repair(repair) for repair in f["repairs"].items()) if "repairs" in f else ()
    form = _read_form(f["form"]) if "form" in f else None
    return Rig(
        reference,
        cameras,
        _read_scale(f["scale"]) if "scale" in f else RigScale("given", None),
        quality,
        f["input_sha256"].digest() if "input_sha256" in f else "",
        covariance,
        lengths,
        repairs,
        form=form,
        recorded_at=f["recorded_at"].time() if "recorded_at" in f else None,
    )


def _read_scale(value: JsonValue) -> RigScale:
    scale = value.fields(("source",), ("relative_uncertainty",))
    source = scale["source"].choice("target_spacing", "bar", "board", "ball", "given", "none")
    return RigScale(source, scale["relative_uncertainty"].number(0) if "relative_uncertainty" in scale else None)


def _without_sigma(cameras: Sequence[JsonValue]) -> list[str]:
    """The cameras without a field `sigma`, as files of other programs have them; ours write null where unknown."""
    values = [camera.value for camera in cameras]
    return [str(value["id"]) for value in values if isinstance(value, dict) and "sigma" not in value]


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


def _read_covariance(folder: Path, entry: JsonValue, n_cameras: int) -> CameraCovariance | None:
    f = entry.fields(("file", "sha256", "intrinsics"))
    f["file"].choice(COVARIANCE_FILE)
    intrinsics = np.array([INTRINSIC_NAMES.index(name.choice(*INTRINSIC_NAMES)) for name in f["intrinsics"].items()])
    path, sha256 = folder / COVARIANCE_FILE, f["sha256"].text()
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
    return CameraCovariance(matrix, intrinsics.astype(np.int64))


def rotation(about: str) -> Kind[FloatArray]:
    """A rotation matrix (3, 3)."""
    return matrix(about, 3, 3).mapped(np.array).checked(_check_rotation)


def _check_rotation(found: FloatArray, value: JsonValue) -> None:
    off = np.abs(found @ found.T - np.eye(3)).max()
    if not off <= _ROTATION_TOLERANCE or np.linalg.det(found) < 0:  # not a number is no rotation either
        raise value.error(Phrase("problem-rotation"))


def _read_camera(camera: JsonValue) -> RigCamera:
    required = ("id", "image_size", "matrix", "distortion", "rotation", "translation_mm")
    f = camera.fields(required, ("serial", "rms_px", "observations", "sigma"))
    width, height = (side.integer(1) for side in f["image_size"].items(2))
    lens = np.array(f["matrix"].matrix(3, 3))
    if not np.array_equal(lens, camera_matrix(intrinsics_vector(lens, []))) or min(lens[0, 0], lens[1, 1]) <= 0:
        raise f["matrix"].error(Phrase("problem-camera-matrix"))
    wide, coefficients = _read_lens(f["distortion"])
    return RigCamera(
        id=f["id"].id(),
        serial=f["serial"].serial() if "serial" in f else None,
        image_size=(width, height),
        intrinsics=fisheye_vector(lens, coefficients) if wide else intrinsics_vector(lens, coefficients),
        rotation=rotation("").read(f["rotation"]),
        translation_mm=np.array(f["translation_mm"].numbers(3)),
        rms_px=f["rms_px"].number(0) if "rms_px" in f else None,
        observations=f["observations"].integer(0) if "observations" in f else 0,
        sigma=_read_sigma(f["sigma"], len(coefficients)) if "sigma" in f else None,
    )


def _read_lens(value: JsonValue) -> tuple[bool, list[float]]:
    """Whether a lens is of the fisheye model, and its coefficients; a list alone is in OpenCV's order."""
    if isinstance(value.value, list):
        return False, read_distortion(value)
    lens = value.fields(("model", "coefficients"))
    wide = lens["model"].choice("opencv", "opencv-fisheye") == "opencv-fisheye"
    return wide, lens["coefficients"].numbers(FISHEYE_LENGTH) if wide else read_distortion(lens["coefficients"])


def read_distortion(value: JsonValue) -> list[float]:
    """4, 5, 8 or 12 numbers in OpenCV's order; InputError, of 14 with the reason."""
    numbers = [number.number() for number in value.items()]
    if problem := distortion_problem(len(numbers), fisheye=False):
        raise value.error(problem)
    return numbers


def _read_sigma(sigma: JsonValue, n_distortion: int) -> CameraSigma:
    f = sigma.fields(("rotation_deg", "centre_mm", "matrix", "distortion"))
    distortion = _sigmas(f["distortion"], n_distortion)
    intrinsics = np.concatenate([_sigmas(f["matrix"], 4), distortion, np.zeros(12 - n_distortion)])
    return CameraSigma(_sigmas(f["rotation_deg"], 3), _sigmas(f["centre_mm"], 3), intrinsics)


def _sigmas(values: JsonValue, length: int) -> FloatArray:
    """Standard uncertainties; null, as NaN is written, is NaN again."""
    return np.array([np.nan if item.value is None else item.number(0) for item in values.items(length)])


def _read_quality(quality: JsonValue) -> Quality:
    f = quality.fields(("valid", "findings"), ("verdict", "affected", "rms_px", "mean_px", "sigma0"))
    rms_px, mean_px, sigma0 = (f[key].number(0) if key in f else None for key in ("rms_px", "mean_px", "sigma0"))
    findings = tuple(FINDING.read(finding) for finding in f["findings"].items())
    affected = tuple(_read_affected(one) for one in f["affected"].items()) if "affected" in f else ()
    found = Quality(f["valid"].boolean(), rms_px, mean_px, sigma0, findings, affected)
    if "verdict" in f and f["verdict"].choice("valid", "use-with-care", "not-valid") != found.verdict:
        raise f["verdict"].error(Phrase("problem-verdict", {"verdict": found.verdict}))
    return found
