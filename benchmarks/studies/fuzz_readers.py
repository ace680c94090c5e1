"""The readers of files that come from others, each with a valid file to spoil."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.studies.fuzz import Reader, zipped
from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal_documents.export.write_export import export_rig
from spherecal_files.write_result import write_result
from spherecal_files.write_verification import write_verification
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions
from spherecal_verify.limit import parse_limit
from spherecal_verify.verify_bars import VerifySettings, verify
from tests.example_session import VALID, make_session
from tests.export_rigs import make_rig

Read = Callable[[Path], object]


def all_readers(folder: Path) -> list[Reader]:
    """Sessions, results, profiles, registries, settings, certificates' issuers, lenses of others, archives, images."""
    return [*_session_readers(folder), *_result_readers(folder), *_other_readers(folder), *_foreign_readers(folder)]


def _json(name: str, path: Path, read: Callable[[], object], valid: Any | None = None) -> Reader:
    """A reader of a JSON file, in the place where it lies."""
    document = json.loads(path.read_bytes()) if valid is None else valid
    return Reader(name, _through(path, read), document)


def _text(name: str, path: Path, read: Callable[[], object]) -> Reader:
    """A reader of a text or binary file, in the place where it lies."""
    return Reader(name, _through(path, read), path.read_bytes())


def _through(path: Path, read: Callable[[], object]) -> Callable[[Path, bytes], object]:
    def one(_: Path, data: bytes) -> object:
        original = path.read_bytes() if path.is_file() else None
        path.write_bytes(data)
        try:
            return read()
        finally:
            if original is not None:
                path.write_bytes(original)

    return one


def _session_readers(folder: Path) -> list[Reader]:
    from spherecal_boards.pattern_entry import read_board_pattern
    from spherecal_cameras.plan import read_plan
    from spherecal_documents.support.support_bundle import unpacked_session, write_bundle
    from spherecal_files.read_session import read_session
    from spherecal_files.target_set_file import read_target_set

    session = folder / "session"
    session.mkdir()
    make_session(session)
    board = folder / "board"
    shutil.copytree(session, board)
    write_bundle(session, folder / "bundle.zip")
    bundle = folder / "bundled"
    with unpacked_session(folder / "bundle.zip") as inside:
        shutil.copytree(inside, bundle)

    def unpacked() -> object:
        with unpacked_session(folder / "bundle.zip") as inner:
            return read_session(inner)

    small = zipped({"session/session.json": json.dumps(VALID).encode(), "session/observations.csv": b"x"})
    return [
        _json("session.json", session / "session.json", lambda: read_session(session)),
        _json("board in session.json", board / "session.json", lambda: read_board_pattern(read_session(board))),
        _text("observations.csv", session / "observations.csv", lambda: read_session(session)),
        _json("targets.json", session / "targets.json", lambda: read_target_set(session / "targets.json")),
        _json("capture plan", session / "session.json", lambda: read_plan(session / "session.json")),
        _json("bundle.json", bundle / "bundle.json", lambda: read_session(bundle)),
        Reader("bundle.zip", _through(folder / "bundle.zip", unpacked), small),
    ]


def _result_readers(folder: Path) -> list[Reader]:
    from spherecal_documents.report.write_report import make_report
    from spherecal_files.ball_file import read_ball
    from spherecal_files.rig_file import read_rig
    from spherecal_rigs.check_rig import read_known_ball
    from spherecal_rigs.framed_rig import FRAME, define_frame, write_frame
    from spherecal_rigs.result_folder import read_bar_report, read_result
    from spherecal_rigs.save_entry import prepare
    from spherecal_rigs.user_frame import FrameDefinition

    session, truth = simulate_session("rigA", 1, SimulationOptions(targets=12, placements=3, bar_poses=1))
    done = calibrate(session)
    result = folder / "result"
    write_result(done, result)
    write_session(session, truth, folder / "simulated")
    verified = verify(session, done.rig, None, VerifySettings(parse_limit("0.1+L/5000")))
    write_verification(verified, result, result / "rig.json")
    definition = FrameDefinition("P1", "P2", "P3", (0.0, 0.0, 250.0), ("x90",))
    write_frame(define_frame(result, definition), result / "frame.json")
    # short tables spoil faster
    for name in ("points.csv", "residuals.csv"):
        lines = (result / name).read_text().splitlines()
        (result / name).write_text("\n".join(lines[:40]) + "\n")

    def said() -> object:
        return make_report(read_result(result))

    return [
        _json("rig.json", result / "rig.json", said),
        _text("covariance.npy", result / "covariance.npy", lambda: read_rig(result / "rig.json")),
        _text("points.csv", result / "points.csv", lambda: (said(), read_known_ball(result / "points.csv"))),
        _text("residuals.csv", result / "residuals.csv", said),
        _text("spheres.csv", result / "spheres.csv", said),
        _text("bars.csv", result / "bars.csv", lambda: read_bar_report(result)),
        _json("verification.json", result / "verification.json", said),
        _json("verification.json, to be saved", result / "verification.json", lambda: prepare(result)),
        _json("ball.json", result / "ball.json", lambda: read_ball(result)),
        _json("frame.json", result / "frame.json", lambda: FRAME.read(result / "frame.json")),
    ]


def _other_readers(folder: Path) -> list[Reader]:
    from spherecal_cameras.camera_settings import CameraDescription, CameraProfile, read_profile, write_profile
    from spherecal_cameras.genicam.trust import TrustStore
    from spherecal_cameras.protocol import CameraSettings
    from spherecal_documents.report.dcc import ISSUER
    from spherecal_files.bar_registry import BAR_REGISTRY
    from spherecal_files.read_session import read_session
    from spherecal_files.rig_file import read_rig
    from spherecal_rigs.check_rig import check, check_json
    from spherecal_rigs.kept_checks import keep_check, read_checks
    from spherecal_rigs.limits_file import Limits, read_limits, write_limits
    from spherecal_rigs.save_entry import save_result
    from spherecal_rigs.store import apply, create_profile, open_profile

    profile = folder / "profile"
    saved = save_result(create_profile(profile), folder / "result")
    apply(open_profile(profile), saved)

    def opened() -> object:
        whole = open_profile(profile)
        return whole.validity(20.0), whole.rig(), whole.last_good_id

    entry = profile / "history" / saved / "entry.json"
    cameras = folder / "cameras.json"
    write_profile(
        cameras, CameraProfile({"50-1": CameraDescription("50-1", "left", CameraSettings(exposure_us=5000.0))})
    )
    registry = folder / "bars.json"
    bar = VALID["bars"][0]
    kept = {key: bar[key] for key in ("marks", "lengths", "expansion_per_kelvin", "reference_temperature_c")}
    kept["lengths"] = [{**length, "nominal_mm": round(length["length_mm"])} for length in kept["lengths"]]
    certificate = {"number": "K-1", "laboratory": "lab", "date": "2026-01-01", "valid_until": "2028-01-01"}
    registry.write_text(
        json.dumps(
            {"format": "spherecal/bars", "version": 1, "bars": [{"serial": "B-1", "certificate": certificate, **kept}]}
        )
    )
    limits = folder / "limits.json"
    write_limits(Limits(needed_dots=150, verification_limit="0.03+L/20000"), limits)
    issuer = folder / "issuer.json"
    place = {"name": "Lab", "city": "Ulm", "country": "DE"}
    issuer.write_text(json.dumps({
        "format": "spherecal/issuer", "version": 1, "laboratory": place, "customer": place, "person": "A",
        "rig_serial": "R", "begin": "2026-01-01", "place": "customer",
    }))  # fmt: skip

    recorded = read_session(folder / "simulated")
    kept = keep_check(profile, saved, check_json(check(recorded, read_rig(profile / "rig.json"))), 20.0)
    drivers = folder / "drivers.json"
    drivers.write_text(
        json.dumps(
            {"format": "spherecal/drivers", "version": 1, "drivers": [{"file": "/opt/x.cti", "sha256": "0" * 64}]}
        )
    )

    def checks() -> object:
        found, problems = read_checks(profile)
        if problems:
            raise InputError(problems[0])
        return found, opened()

    def limited(_: Path, data: bytes) -> object:
        return parse_limit(data.decode("utf-8", "replace"))

    return [
        _json("profile.json", profile / "profile.json", opened),
        _json("entry.json", entry, opened),
        _json("cameras.json", cameras, lambda: read_profile(cameras)),
        _json("bars.json", registry, lambda: BAR_REGISTRY.read(registry)),
        _json("limits.json", limits, lambda: read_limits(limits)),
        _json("issuer", issuer, lambda: ISSUER.read(issuer)),
        _json("kept check", kept, checks),
        _json("drivers.json", drivers, lambda: TrustStore(drivers)),
        Reader("limit", limited, b"0.03 mm + L/20000"),
    ]


def _foreign_readers(folder: Path) -> list[Reader]:
    """Lenses of OpenCV, Kalibr and COLMAP; every export read back; images."""
    from PIL import Image

    from spherecal.targets.images import read_image
    from spherecal_documents.export.import_rig import read_cameras
    from spherecal_documents.export.write_export import FORMATS

    rig = make_rig(4, 3, 1)
    found = []
    for name, form in FORMATS.items():
        path = folder / (f"{name}.yaml" if name == "kalibr" else name)
        export_rig(rig, name, path, max_loss_px=1e9)
        known = (".yml", ".yaml", ".txt", ".cameramodel")
        files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.suffix in known)
        spoiled = next((p for p in files if p.name == "cameras.txt"), files[0])
        if name in ("opencv", "kalibr", "colmap"):
            found.append(_text(f"lenses of {name}", spoiled, lambda path=path: read_cameras(path)))
        found.append(_text(f"export {name}", spoiled, lambda path=path, form=form: form.read(path)))
    grey = np.random.default_rng(1).integers(0, 2**16 - 1, (80, 90), dtype=np.uint16)
    for ending in ("png", "tif", "jpg", "bmp"):
        image = folder / f"image.{ending}"
        pixels = grey if ending in ("png", "tif") else (grey >> 8).astype(np.uint8)
        Image.fromarray(pixels).save(image)
        found.append(_text(f"image {ending}", image, lambda image=image: read_image(image)))
    return found
