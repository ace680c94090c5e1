"""What the program writes fits the published schemas, and has no field that they do not describe."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT

from spherecal_app.cli.main import main
from spherecal_cameras.camera_settings import CameraDescription, CameraProfile, write_profile
from spherecal_cameras.genicam.trust import Driver, TrustStore
from spherecal_cameras.protocol import CameraSettings, Region
from spherecal_documents.export.write_export import export_rig
from spherecal_files.bar_registry import BAR_REGISTRY, REGISTERED_BAR
from spherecal_files.bundle_file import bundle_bytes
from spherecal_files.json_file import JsonValue
from spherecal_files.rig_file import read_rig
from spherecal_files.write_verification import write_verification
from spherecal_gui.in_use import keep_verification
from spherecal_gui.project import Artefacts, Computation, Flaw, Project
from spherecal_gui.project_folder import save_project
from spherecal_measuring.measurer import Measurer
from spherecal_measuring.pose import read_body, write_body
from spherecal_measuring.series_file import run, set_json, sets_of_session
from spherecal_rigs.check_rig import check, check_json, keep, read_known_ball
from spherecal_rigs.limits_file import Limits, write_limits
from spherecal_sim.simulate_session import write_session
from spherecal_verify.limit import parse_limit
from spherecal_verify.verify_bars import VerifySettings, verify
from tests.example_session import VALID
from tests.method.test_schemas import PUBLISHED, assert_fits, closed
from tests.networks import calibrated
from tests.schema_samples import SAMPLES, TIME


def assert_described(document: Mapping[str, Any], format_name: str | None = None) -> None:
    """A document of ours: as its schema says, without a field that is not described."""
    name = document["format"].removeprefix("spherecal/")
    assert format_name in (None, name)
    assert_fits(document, closed(PUBLISHED[name]))


def _load(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session, its verified result with report, frame and ball, a profile with a check, a series, an export."""
    folder = tmp_path_factory.mktemp("written")
    session, truth = calibrated("demo", 1, bar_poses=1)[1:]
    write_session(session, truth, folder / "session")
    result = folder / "result"
    assert main(["calibrate", str(folder / "session"), "-o", str(result), "-q"]) == 0
    rig = read_rig(result / "rig.json")
    write_verification(
        verify(session, rig, None, VerifySettings(parse_limit("0.3+L/5000"))), result, result / "rig.json"
    )
    for command in (
        ["report", str(result), "-o", str(result / "report.json")],
        ["frame", str(result), "-o", str(result / "frame.json"), "--turn", "z90"],
        ["ball", "export", str(result), "-o", str(folder / "ball.json")],
        ["profile", "save", str(result), "--to", str(folder / "profile"), "--session", str(folder / "session")],
        ["profile", "apply", str(folder / "profile"), "0001"],
    ):
        assert main(command) == 0, command
    found = check_json(check(session, rig, read_known_ball(result / "points.csv")))
    (folder / "check.json").write_text(json.dumps(found, allow_nan=False))
    assert keep(folder / "profile", found, 20.0)
    keep_verification(folder / "profile", "0001", "consistent")
    export_rig(rig, "mrcal", folder / "export")
    documents = []
    measurer = Measurer(rig)
    run(
        sets_of_session(session, rig),
        measurer,
        lambda one: documents.append(set_json(one, measurer.health)),
        folder / "series",
    )
    (folder / "sets.json").write_text(json.dumps(documents))
    return folder


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("session", 1), ("targets", 2), ("truth", 1), ("rig", 3), ("verification", 2), ("findings", 1), ("report", 1),
        ("frame", 1), ("ball", 2), ("check", 1), ("profile", 1), ("profile-entry", 1), ("profile-check", 1),
        ("last-verification", 1), ("export", 1), ("series", 1),
    ],
)  # fmt: skip
def test_what_is_written_is_described(folder: Path, name: str, count: int) -> None:
    documents = [_load(path) for path in sorted(folder.rglob("*.json")) if path.name != "sets.json"]
    ours = [document for document in documents if document["format"] == f"spherecal/{name}"]
    assert len(ours) == count
    for document in ours:
        assert_described(document)


def test_the_stream_is_described(folder: Path) -> None:
    schema = PUBLISHED["measurements"]
    assert_described({"format": "spherecal/measurements", "version": 1, "cameras": ["C01"]})
    documents = json.loads((folder / "sets.json").read_text())
    assert len(documents) > 3
    for document in documents:
        assert_fits(document, closed(schema["$defs"]["set"]))


def test_a_captured_session_is_described(tmp_path: Path) -> None:
    arguments = [
        "cameras",
        "capture",
        "--source",
        "simulated",
        "--placements",
        "1",
        "--profile",
        str(tmp_path / "p.json"),
    ]
    assert main([*arguments, "-o", str(tmp_path / "session")]) == 0
    for name in ("session", "capture", "targets"):
        assert_described(_load(tmp_path / "session" / f"{name}.json"), name)


def test_the_wizards_project_is_described(tmp_path: Path) -> None:
    project = Project(tmp_path / "project", "replay:x", cameras=("S1",), looked=("S1",), placements=("P1",))
    save_project(project)
    assert_described(_load(tmp_path / "project" / "wizard.json"))
    done = Computation((("a", "b"),), "valid")
    save_project(
        replace(
            project,
            artefacts=Artefacts("t", "b", "s", "B", ("A",), "c"),
            calibrated=done,
            checked=done,
            failures={"solve": "x"},
            repairs=(("--leave-out", "C01"),),
            masks=(("C01", (0.0, 0.0, 1.0, 1.0)),),
            bar_celsius=20.0,
            pose_bars=(("A1", "A"),),
            flaws=(Flaw("P1", TIME, "taken moving", ("C01",)),),
        )
    )
    assert_described(_load(tmp_path / "project" / "wizard.json"))


def _written(path: Path, document: Mapping[str, Any]) -> Path:
    path.write_text(json.dumps(document))
    return path


def test_settings_are_described(tmp_path: Path) -> None:
    write_limits(Limits(needed_dots=50, verification_limit="0.1"), tmp_path / "limits.json")
    assert_described(_load(tmp_path / "limits.json"), "limits")
    settings = CameraSettings(exposure_us=8000.0, region=Region(0, 0, 640, 480))
    write_profile(
        tmp_path / "cameras.json", CameraProfile({"S1": CameraDescription("S1", "left", settings, 8.0)}, ("/x.cti",))
    )
    assert_described(_load(tmp_path / "cameras.json"), "cameras")
    own = VALID["bars"][0]
    bar = REGISTERED_BAR.read(JsonValue({**own, "serial": "B-7", "certificate": "K-1"}, tmp_path / "bars.json"))
    BAR_REGISTRY.write({"B-7": bar}, tmp_path / "bars.json")
    assert_described(_load(tmp_path / "bars.json"), "bars")
    store = TrustStore(tmp_path / "drivers.json")
    store.allow(Driver("/opt/x.cti", "ab" * 32, "new"))
    assert_described(_load(tmp_path / "drivers.json"), "drivers")
    write_body(read_body(_written(tmp_path / "body.json", SAMPLES["body"].short)), tmp_path / "body.json")
    assert_described(_load(tmp_path / "body.json"), "body")
    assert_described(json.loads(bundle_bytes("ab" * 32, {"session.json": "ab" * 32}, {"images": "none"})), "bundle")


@pytest.mark.parametrize(
    "path", sorted((ROOT / "tests" / "data").rglob("*.json")), ids=lambda path: "/".join(path.parts[-3:])
)
def test_files_of_released_versions_fit(path: Path) -> None:
    document = _load(path)
    if not str(document.get("format", "")).startswith("spherecal/"):
        pytest.skip("not a file of ours")
    name = document["format"].removeprefix("spherecal/")
    assert_fits(document, PUBLISHED[name])


def test_recorded_sessions_fit(shared_data: Path) -> None:
    found = sorted(path for path in shared_data.rglob("*.json") if b'"spherecal/' in path.read_bytes()[:200])
    if not found:
        pytest.skip("the shared recordings hold no file of ours")
    for path in found:
        document = _load(path)
        assert_fits(document, PUBLISHED[document["format"].removeprefix("spherecal/")])


def test_samples_cover_every_format_that_is_read() -> None:
    from docs.make_formats import FORMATS

    assert {form.short for form in FORMATS if form.is_read} == set(SAMPLES)
