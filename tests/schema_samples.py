"""A document of every format that is read, and how it is read: for the tests of the schemas.

Each has every optional field, so that every value can be spoilt in turn.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from spherecal.base.errors import InputError
from spherecal_boards.pattern_entry import board_pattern, board_shape, board_uncertainty
from spherecal_cameras.camera_settings import read_profile as read_cameras
from spherecal_cameras.capture import SessionCamera, SessionFolder
from spherecal_cameras.genicam.trust import TrustStore
from spherecal_cameras.plan import CapturePlan, PlannedSet
from spherecal_cameras.simulated.simulated_source import SimulatedSource
from spherecal_cameras.simulated.stage import Stage
from spherecal_documents.report.dcc import ISSUER
from spherecal_files.ball_file import read_ball
from spherecal_files.bar_registry import BAR_REGISTRY
from spherecal_files.bundle_file import original_sha256
from spherecal_files.capture_file import read_captured_sets
from spherecal_files.findings_file import read_findings
from spherecal_files.json_file import JsonValue
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig
from spherecal_files.target_set_file import read_target_set
from spherecal_gui.in_use import last_verification
from spherecal_gui.project_folder import load_project, taken_in
from spherecal_measuring.pose import read_body
from spherecal_rigs.ball_registry import BALL_REGISTRY
from spherecal_rigs.entry import read_entry
from spherecal_rigs.framed_rig import FRAME
from spherecal_rigs.kept_checks import read_checks
from spherecal_rigs.limits_file import read_limits
from spherecal_rigs.result_folder import read_bar_report
from spherecal_rigs.store import open_profile
from tests.example_session import VALID, make_session

TIME = "2026-11-21T09:30:00+00:00"
SHA = "ab" * 32
FINDING = {"severity": "info", "code": "c", "message": "m.", "hint": "h.", "where": ["C01"]}
MATRIX = [[2318.0, 0.0, 1031.5], [0.0, 2318.0, 771.5], [0.0, 0.0, 1.0]]
EYE = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
BARS_CSV = "bar,pose,from,to,length_mm,reference_mm,error_mm,u_mm,views\nA,A-01,A1,A2,412.3,412.3,0.001,0.01,5\n"
Read = Callable[[Path, dict[str, Any]], object]


@dataclass(frozen=True)
class Sample:
    """A document of a format, how it is read in a folder, and what is said about things that no schema can say."""

    short: dict[str, Any]
    read: Read
    beyond: tuple[str, ...] = ()


def _document(name: str, /, **fields: Any) -> dict[str, Any]:
    return {"format": f"spherecal/{name}", "version": 1, **fields}


def _file(name: str, read: Callable[[Path], object]) -> Read:
    """Read a document that lies in a file of this name."""

    def run(folder: Path, document: dict[str, Any]) -> object:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(json.dumps(document), encoding="utf-8")
        return read(folder / name)

    return run


def _folder(name: str, read: Callable[[Path], object]) -> Read:
    return _file(name, lambda path: read(path.parent))


# --- recordings ------------------------------------------------------------------------------------------------------


def _read_session(folder: Path, document: dict[str, Any]) -> object:
    if not (folder / "session.json").exists():
        make_session(folder, document)
    (folder / "session.json").write_text(json.dumps(document), encoding="utf-8")
    session = read_session(folder)
    board = document.get("board")
    if board is not None:
        board_uncertainty(session)
        board_shape(session)
        if board.get("kind") is not None and board.get("points") is None:
            board_pattern(JsonValue(board, folder / "session.json", "board"))
    return session


def _session() -> dict[str, Any]:
    full = json.loads(json.dumps(VALID))
    del full["cameras"][0]["intrinsics_group"], full["cameras"][1]["intrinsics_group"]
    full["cameras"][0] |= {
        "model": "AVT G-319B",
        "lens_model": "brown",
        "ignore": [[0, 0, 10, 10]],
        "intrinsics_group": "g",
    }
    full["cameras"][0]["prior"]["assumed"] = ["focal_length"]
    full["bars"][0] |= {
        "serial": "B-7",
        "certificate": {"number": "1", "laboratory": "L", "date": "2026-01-01", "valid_until": "2027-01-01"},
    }
    full["bars"][0]["lengths"][0]["nominal_mm"] = 412
    full["board"] = {
        "kind": "charuco", "rows": 4, "columns": 5, "pitch_mm": 30, "marker_mm": 20, "dictionary": "DICT_5X5_100",
        "legacy": False, "rows_upward": False, "relative_uncertainty": 1e-4, "shape": "nominal",
        "polarity": "dark-on-light", "rings": [[1, 1]], "dot_diameter_mm": 5.0, "border_bits": 1,
    }  # fmt: skip
    return full


@cache
def _stage() -> Stage:
    return Stage("demo")


def _read_capture(folder: Path, _: dict[str, Any]) -> object:
    cameras = tuple(
        SessionCamera(serial, {"id": name, "image_size": [640, 480], "serial": serial})
        for name, serial in (("C01", "S1"),)
    )
    with SimulatedSource(stage=_stage()) as source:
        SessionFolder(folder, CapturePlan((PlannedSet("P1"),), None, {}), cameras, source).start(True)
    return read_captured_sets(folder), taken_in(folder)


_CAPTURE = _document(
    "capture", source={"kind": "simulated"}, cameras=[{"id": "C01", "serial": "S1"}],
    sets=[{
        "id": "P1", "taken": TIME, "attempts": 1, "seconds": 0.1, "spread_s": None, "late": [], "missing": {},
        "images": {"C01": "placements/P1/C01.png"},
        "cameras": {"C01": {"frame_id": 1, "time_stamp_ns": 5, "exposed": TIME, "temperature_c": 41.5, "bits": 8}},
    }],
)  # fmt: skip


def _read_bundle(folder: Path, document: dict[str, Any]) -> object:
    return _folder("bundle.json", lambda one: original_sha256(one, {"session.json": SHA}))(folder, document)


# --- results ---------------------------------------------------------------------------------------------------------

_CAMERA = {
    "id": "C01", "serial": "S1", "image_size": [2064, 1544], "matrix": MATRIX,
    "distortion": {"model": "opencv", "coefficients": [0.0] * 12}, "rotation": EYE, "translation_mm": [0.0, 0.0, 0.0],
    "rms_px": 0.05, "observations": 100,
    "sigma": {"rotation_deg": [0.01, 0.01, None], "centre_mm": [0.1] * 3, "matrix": [0.1] * 4, "distortion": [0.0] * 12},  # noqa: E501
}  # fmt: skip
_RIG = _document(
    "rig", reference_camera="C01", cameras=[_CAMERA, {**_CAMERA, "id": "C02", "distortion": [0.0] * 5, "sigma": None}],
    scale={"source": "bar", "relative_uncertainty": 1e-5},
    quality={
        "valid": True, "verdict": "use-with-care", "affected": [{"camera": "C01"}, {"scale": True}, {"region_mm": [[0, 0, 0], [1, 1, 1]]}],  # noqa: E501
        "rms_px": 0.05, "mean_px": 0.04, "sigma0": 1.0, "findings": [FINDING],
    },
    software={"name": "SphereCal", "version": "0"}, input_sha256=SHA,
    covariance={"file": "covariance.npy", "sha256": SHA, "intrinsics": ["fu", "fv"]},
    length_uncertainty={
        "length_mm": 500, "coverage_factor": 2, "sigma_px": 0.05, "places_mm": [[0, 0, 0]], "directions": [[1, 0, 0]],
        "expanded_uncertainty_mm": [[0.05]],
    },
    form={"name": "soft", "reason": "r", "shape_sd_mm": 0.1, "shape_sd": "stated"}, recorded_at=TIME,
    repairs=[{"option": "--leave-out", "value": "C03", "automatic": True, "earlier_pose": _CAMERA}],
)  # fmt: skip
_ENDS = {"bar": "A", "from": "A1", "to": "A2"}
_STATISTICS = {"mean_error_mm": 0.01, "sd_mm": 0.01, "max_abs_error_mm": 0.02}
_VERIFICATION = _document(
    "verification",
    lengths=[{
        **_ENDS, "n": 1, **_STATISTICS, "expanded_uncertainty_mm": 0.02, "coverage_factor": 2.0,
        "standard_uncertainties_mm": {
            "repeatability": 0.01, "calibration": 0.01, "scale": 0.01, "certificate": 0.01, "temperature": None,
        },
    }],
    overall={"n": 1, **_STATISTICS, "rms_error_mm": 0.01, "expanded_uncertainty_mm": 0.01},
    decision={
        "rule": "r", "rule_phrase": {"phrase": "decision-nothing", "values": {"k": 1}},
        "verdict": "consistent", "coverage_factor": 2.0, "chi_square": 40.0, "most_chi_square": 84.0,
        "exceeding": [{"pose": "A-01", "from": "A1", "to": "A2"}], "cameras": ["C01"],
    },
    cameras=[{"id": "C01", "views": 4, "used": 4, "rms_px": 0.05, "state": "verified"}], findings=[FINDING],
    procedure={
        "title": "t", "departures": ["d"], "departure_phrases": [{"phrase": "departure-by-hand", "values": {}}],
        "volume_mm": {"sides": [1, 2, 3], "diagonal": 4.0},
        "bars": [{
            "id": "A", "serial": "B-7", "certificate": {"number": "1", "laboratory": "L", "date": "2026-01-01", "valid_until": "2027-01-01"},  # noqa: E501
            "expansion_per_kelvin": 1e-5, "reference_temperature_c": 20.0, "assumed": [],
            "lengths": [{"from": "A1", "to": "A2", "length_mm": 412.3, "expanded_uncertainty_mm": 0.004, "coverage_factor": 2, "nominal_mm": 412}],  # noqa: E501
        }],
        "poses": [{"id": "A-01", "bar": "A", "temperature_c": 20.0, "from": "A1", "to": "A2", "ends_mm": None}],
        "acceptance": {
            "rule": "r", "limit": {"words": "0.1", "constant_mm": 0.1, "divisor": 1000.0}, "verdict": "pass", "doubts": ["d"],  # noqa: E501
            "lengths": [{**_ENDS, "worst_pose": "A-01", "worst_error_mm": 0.01, "limit_mm": 0.1, "expanded_uncertainty_mm": 0.01, "verdict": "pass"}],  # noqa: E501
        },
        "budgets": [{
            **_ENDS, "combined_mm": 0.01, "effective_degrees_of_freedom": 12.0, "coverage_factor": 2.0,
            "expanded_uncertainty_mm": 0.02, "remedy": "r",
            "remedy_phrase": {"phrase": "remedy-certificate", "values": {}},
            "contributions": [{
                "name": "n", "evaluation": "A", "distribution": "normal", "standard_uncertainty_mm": 0.01,
                "degrees_of_freedom": 5.0, "share": 1.0, "contained_in_repeatability_mm": 0.0,
            }],
        }],
        "cameras_moved": ["C01"],
    },
    override={"by": "n", "reason": "r", "at": TIME}, software={},
)  # fmt: skip


def _read_verification(folder: Path, document: dict[str, Any]) -> object:
    if not (folder / "bars.csv").exists():
        (folder / "bars.csv").write_text(BARS_CSV)
    return _folder("verification.json", read_bar_report)(folder, document)


_DOTS = [
    {
        "target": i,
        "point": "A",
        "xyz_mm": [float(i), float(i * i), float(i**3)],
        "covariance_mm2": [1e-4, 0, 0, 1e-4, 0, 1e-4],
    }
    for i in range(13)
]
_BALL = _document(
    "ball",
    name="Ball 1",
    calibrated="2026-11-21",
    targets={"family": "dots8", "size_mm": 28.0},
    scale={"source": "bar", "relative_uncertainty": 1e-5},
    input_sha256=SHA,
    software={},
    dots=_DOTS,
)
_FRAME = _document(
    "frame",
    rotation=EYE,
    translation_mm=[0.0, 0.0, 0.0],
    definition={"origin": "P1", "x": "P2", "xy": "P3", "offset_mm": [0, 0, 1], "turns": ["z90"]},
    reference_camera="C01",
    input_sha256=SHA,
    distance_mm=1.0,
    angle_deg=90.0,
    origin_sigma_mm=[0.1] * 3,
    axes_sigma_deg=[0.1] * 3,
    software={},
)
_FINDINGS = _document(
    "findings",
    findings=[
        {"code": "no-scale", "kind": "", "values": {}, "where": ["C01"], "repairs": [{"kind": "swap", "target": "C01"}]}
    ],
)

# --- settings --------------------------------------------------------------------------------------------------------

_BAR = {key: VALID["bars"][0][key] for key in ("marks", "lengths", "expansion_per_kelvin", "reference_temperature_c")}
_BARS = _document("bars", bars=[{
    "serial": "B-7", "description": "carbon", **_BAR, "certificate": "K-1",
}])  # fmt: skip
_CAMERAS = _document("cameras", producers=["/opt/x.cti"], cameras=[{
    "serial": "S1", "name": "left", "focal_length_mm": 8.0, "pixel_pitch_um": 3.45,
    "settings": {
        "exposure_us": 8000.0, "gain_db": 0.0, "pixel_format": "Mono8", "region": [0, 0, 640, 480], "trigger": "hardware",  # noqa: E501
        "trigger_source": "Line1", "frame_rate_hz": 10.0, "packet_size": 9000, "packet_delay": 0, "frame_delay": 0,
        "throughput_bytes_s": 9000000,
    },
}])  # fmt: skip
_LIMITS = _document(
    "limits",
    limits={
        "needed_dots": 100, "ageing_hours": 5.0, "stale_hours": 12.0, "ageing_kelvin": 1.0, "stale_kelvin": 2.0,
        "verification_limit": "0.03+L/20000", "verification_limit_open": False, "unverified_use": True,
    },
)  # fmt: skip
_CONTACT = {"name": "Room 3", "city": "Ulm", "country": "DE", "email": "m@example.com"}
_ISSUER = _document(
    "issuer",
    laboratory=_CONTACT,
    customer=_CONTACT,
    person="A. Person",
    rig_serial="R-7",
    manufacturer="M",
    number="1",
    place="customer",
    begin="2026-11-20",
    end="2026-11-21",
)
_PROFILE = _document(
    "profile",
    name="Rig 7",
    applied=[{"calibration": "0001", "at": TIME, "note": "n"}],
    software={},
    validity={"ageing_hours": 5.0, "stale_hours": 12.0, "ageing_kelvin": 1.0, "stale_kelvin": 2.0},
)
_ENTRY = _document(
    "profile-entry", saved_at=TIME, calibrated_at=TIME, note="n",
    quality={"valid": True, "verdict": "valid", "care": "", "rms_px": 0.05, "sigma0": 1.0},
    scale={"source": "bar", "artefact": "B", "relative_uncertainty": 1e-5}, sphere_diameter_mm=500.0, temperature_c=20.0,  # noqa: E501
    volume_mm=[[0, 0, 0], [1, 1, 1]], verification={"verdict": "consistent", "mean_error_mm": -0.01, "max_abs_error_mm": 0.1, "failed": True, "override": {"by": "n", "reason": "r", "at": TIME}},  # noqa: E501
    cameras=[{
        "id": "C01", "serial": "S1", "model": "m", "pixel_pitch_um": 3.45, "focal_length_mm": 8.0, "temperature_c": 41.0,  # noqa: E501
        "settings": {"gain": 1.5, "format": "Mono8", "on": True, "region": [0, 0, 1, 1]},
    }],
    input_sha256=SHA, software={"name": "SphereCal", "version": "0.1"},
    files_sha256={name: SHA for name in ("rig.json", "targets.json", "verification.json", "bars.csv", "covariance.npy", "points.csv")},  # noqa: E501
)  # fmt: skip
_CHECK = _document(
    "profile-check", checked_at=TIME, calibration="0001", temperature_c=20.0, software={},
    check={
        "verdict": "ok", "sentence": "s", "tolerance_mm": 0.1,
        "cameras": [{"id": "C01", "point_mm": 0.01, "rms_px": 0.05, "points": 10}],
        "balls": [{"scale_ppm": 1.0}], "lengths": [{"error_mm": 0.01}],
    },
)  # fmt: skip


def _read_check(folder: Path, document: dict[str, Any]) -> object:
    found, problems = _file("checks/20261121T171530123456Z.json", lambda path: read_checks(path.parents[1]))(
        folder, document
    )  # type: ignore[misc]
    if problems:
        raise InputError(problems[0])
    return found


def _read_last(folder: Path, document: dict[str, Any]) -> object:
    found = _folder("last-verification.json", lambda one: last_verification(one, document.get("calibration")))(
        folder, document
    )
    if found is None:
        raise InputError("not read")
    return found


_BODY = _document("body", name="tool", points=[
    {"target": 1, "point": "A", "xyz_mm": [0, 0, 0], "sigma_mm": 0.01}, {"target": 2, "xyz_mm": [50, 0, 0]},
    {"target": 3, "xyz_mm": [0, 40, 0]}, {"target": 4, "xyz_mm": [0, 40, 50]}, {"target": 5, "xyz_mm": [40, 40, 50]},
])  # fmt: skip
_RUN = {"inputs": [["a", "b"]], "verdict": "valid"}
_WIZARD = _document(
    "wizard", source="replay:x", step="place", cameras=["S1"], looked=["S1"], placements=["P1"], scale_poses=["B1"],
    check_poses=["A1"], bench="b.json", purpose="check",
    artefacts={
        "target_set": "t", "ball": "b", "scale": "s", "scale_bar": "B", "check_bars": ["A"], "check": "c",
        "board": False,
    },
    calibrated=_RUN, accepted=_RUN, verified=_RUN, saved=_RUN, checked=_RUN, repaired=_RUN, failures={"solve": "no"},
    repairs=[["--leave-out", "C05"]], masks=[{"camera": "C01", "rectangle": [0, 0, 1, 1]}], limit="0.1", bar_celsius=20.0,  # noqa: E501
    pose_bars=[["A1", "A"]], note="n", method="tao2021",
    flaws=[{"set": "P1", "taken": TIME, "code": "taken moving", "cameras": ["C01"], "kept": True}],
)  # fmt: skip

SAMPLES: Mapping[str, Sample] = {
    "session": Sample(
        _session(), _read_session,
        ("the same id", "does not have", "5 % of", "1 % apart", "is the same mark", "names the same point", "not exist",
         "no target has", "shares intrinsics_group", "before the certificate", "whose role is", "must be smaller",
         "an OpenCV dictionary", "leaves the session", "need .* tags", "is given (?:beside|although)", "must be a date",
         "cannot be found in images", r"observations\.csv", "registry has no bar", "must be a path below", "must be from 0 to",  # noqa: E501
         "must be a point in"),
    ),
    "targets": Sample(
        json.loads(json.dumps(_document(
            "targets", family="dots8", polarity="light-on-dark", size_mm=28.0, dot_diameter_mm=3.0,
            targets=[{"id": 1, "dots": {"A": [1.0, 2.0], "B": [3.0, -2.0]}}, {"id": 2, "dots": {"A": [1.0, 2.0]}}],
        ))),
        _file("targets.json", read_target_set), ("the same id", "off the sticker", "must be smaller"),
    ),
    "capture": Sample(_CAPTURE, lambda folder, document: _file("capture.json", lambda path: _read_capture(path.parent, document))(folder, document), ("with other cameras", "has a part", "is not a relative path")),  # noqa: E501
    "bundle": Sample(_document("bundle", input_sha256=SHA, files_sha256={"session.json": SHA}, images="none", software={}), _read_bundle),  # noqa: E501
    "rig": Sample(
        _RIG, _file("rig.json", read_rig),
        ("the same id", "does not have", "not a rotation", "contradicts", "must have one of", r"must have \d+ values"),
    ),
    "verification": Sample(_VERIFICATION, _read_verification),
    "findings": Sample(_FINDINGS, _folder("findings.json", read_findings)),
    "ball": Sample(_BALL, _file("ball.json", read_ball), ("the same dot", "on one line", "not a covariance", "must be a date")),  # noqa: E501
    "frame": Sample(_FRAME, _file("frame.json", FRAME.read), ("not a rotation", "or none of them")),
    "cameras": Sample(_CAMERAS, _file("cameras.json", read_cameras), ("the same",)),
    "drivers": Sample(
        _document("drivers", drivers=[{"file": "/opt/x.cti", "sha256": SHA}], written_at=TIME),
        _file("drivers.json", TrustStore),
    ),
    "bars": Sample(
        _BARS, _file("bars.json", BAR_REGISTRY.read),
        ("the same", "does not have", "5 % of", "1 % apart", "before the certificate", "must be a date"),
    ),
    "balls": Sample(
        _document("balls", balls=[{
            "name": "hall 3", "nominal_diameter_mm": 500.0,
            "targets": {
                "family": "dots8", "polarity": "light-on-dark", "size_mm": 28.0, "dot_diameter_mm": 3.0,
                "targets": [{"id": 7, "dots": {"A": [-10.0, 10.0], "B": [0.0, -10.0]}}],
            },
            "spacing": {"from": "A", "to": "B", "distance_mm": 22.3},
        }]),
        _file("balls.json", BALL_REGISTRY.read), ("the same", "off the sticker", "must be smaller"),
    ),
    "limits": Sample(_LIMITS, _file("limits.json", read_limits), ("above stale", "is not a limit")),
    "issuer": Sample(_ISSUER, _file("issuer.json", ISSUER.read), ("is empty", "must be a date")),
    "profile": Sample(_PROFILE, _folder("profile.json", open_profile), ("ageing not above stale",)),
    "profile-entry": Sample(_ENTRY, _folder("entry.json", read_entry), ("low corner first",)),
    "profile-check": Sample(_CHECK, _read_check),
    "body": Sample(_BODY, _file("body.json", read_body), ("the same point", "on one line")),
    "wizard": Sample(_WIZARD, _folder("wizard.json", load_project)),
    "last-verification": Sample(
        _document("last-verification", calibration="0001", at=TIME, verdict="valid"), _read_last
    ),
}  # fmt: skip
