"""A verification that failed is never called missing: its rig is refused, or carries the name of who answers for it."""

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

import spherecal
from spherecal.base.errors import InputError
from spherecal.data.rig import RigScale
from spherecal_app.cli.exit_codes import BAD_INPUT, BOTH, CANNOT_TELL, DONE, LIMIT_EXCEEDED, NOT_VALID
from spherecal_app.cli.main import main
from spherecal_documents.report.write_report import certificate, report_bytes
from spherecal_files.rig_file import rig_bytes
from spherecal_files.write_result import write_table
from spherecal_files.write_verification import write_verification
from spherecal_rigs.save_entry import save_result
from spherecal_rigs.store import apply, create_profile, open_profile, restore
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions
from spherecal_verify.limit import parse_limit
from spherecal_verify.verify_bars import VerifySettings, verify
from tests.method.test_verify import true_rig

ISSUER = {
    "format": "spherecal/issuer", "version": 1, "rig_serial": "RIG-7", "person": "A. Person",
    "laboratory": {"name": "Room 3", "city": "Braunschweig", "country": "DE"},
    "customer": {"name": "Works", "city": "Ulm", "country": "DE"},
}  # fmt: skip
WHO = ["--by", "B. Responsible", "--reason", "only shapes matter here"]
TABLES = {
    "points.csv": "placement,target,point,x_mm,y_mm,z_mm,sigma_x_mm,sigma_y_mm,sigma_z_mm,views",
    "residuals.csv": "placement,camera,target,point,du,dv,used",
    "spheres.csv": "placement,x_mm,y_mm,z_mm,radius_mm,radial_sd_mm",
}


def verified(folder: Path, scale: float = 1.0, limit: str | None = None) -> Path:
    """A result folder with a rig whose scale is wrong by a factor, verified with two bars."""
    session, truth = simulate_session("rigA", 5, SimulationOptions(bar_poses=8, placements=1, targets=40))
    rig = true_rig(truth, scale=scale)
    folder.mkdir(parents=True)
    (folder / "rig.json").write_bytes(rig_bytes(rig))
    for name, columns in TABLES.items():
        write_table(folder / name, columns, ())
    done = verify(session, rig, None, VerifySettings(None if limit is None else parse_limit(limit)))
    write_verification(done, folder, folder / "rig.json")
    return folder


@pytest.fixture(scope="module")
def failed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return verified(tmp_path_factory.mktemp("failed") / "result", 1.01)


@pytest.mark.parametrize(("scale", "limit"), [(1.01, None), (1.01, "0.1"), (1.0, "0.001")])
def test_a_failed_rig_goes_nowhere(tmp_path: Path, scale: float, limit: str | None) -> None:
    folder = verified(tmp_path / "result", scale, limit)
    profile = create_profile(tmp_path / "profile", "Rig 7")
    number = save_result(profile, folder)  # the history takes it, and says that it failed
    assert open_profile(profile.folder).entry(number).contradicted
    for despite in (False, True):
        with pytest.raises(InputError) as refused:
            apply(open_profile(profile.folder), number, "because", despite_findings=despite)
        assert refused.value.code == "error-not-put-to-use-failed"
    assert main(["export", str(folder / "rig.json"), "--to", "csv", "-o", str(tmp_path / "rig.csv")]) == BAD_INPUT
    with pytest.raises(InputError):
        spherecal.export_rig(folder, "csv", tmp_path / "rig.csv")
    assert not (tmp_path / "rig.csv").exists()
    (tmp_path / "issuer.json").write_text(json.dumps(ISSUER))
    with pytest.raises(InputError) as refused:
        certificate(folder, tmp_path / "issuer.json")
    assert refused.value.code == "error-verification-failed"
    page = json.loads(report_bytes(".json", folder))
    assert page["verdicts"][0]["verdict"] == "VERIFICATION FAILED" and "VALID" not in page["verdicts"][0]["sentence"]


def test_who_answers_for_it_is_named_everywhere(failed: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    folder = tmp_path / "result"
    folder.mkdir()
    for path in failed.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    for by in (" ", "A\x01B", "A" * 2000):  # the verification stays as it was
        assert main(["override", str(folder), "--by", by, "--reason", "x"]) == BAD_INPUT
    assert main(["override", str(folder), *WHO]) == DONE
    assert json.loads((folder / "verification.json").read_text())["override"]["by"] == "B. Responsible"
    said = "B. Responsible: only shapes matter here"
    assert main(["export", str(folder / "rig.json"), "--to", "csv", "-o", str(tmp_path / "rig.csv")]) == BAD_INPUT
    assert main(["export", str(folder / "rig.json"), "--to", "metashape", "-o", str(tmp_path / "rig.xml")]) == DONE
    assert f"VERIFICATION FAILED, used all the same by {said}" in (tmp_path / "rig.xml").read_text()
    (tmp_path / "issuer.json").write_text(json.dumps(ISSUER))
    texts = [e.text or "" for e in ElementTree.fromstring(certificate(folder, tmp_path / "issuer.json")).iter()]
    assert not any("VALID" in text for text in texts)
    assert sum("B. Responsible" in text and "only shapes matter here" in text for text in texts) == 2
    page = json.loads(report_bytes(".json", folder))
    assert all("B. Responsible" in v["sentence"] for v in page["verdicts"])
    capsys.readouterr()
    profile = create_profile(tmp_path / "profile", "Rig 7")
    used = apply(open_profile(profile.folder), save_result(profile, folder), "as agreed")
    assert any(said in reason for reason in used.validity().reasons)
    assert main(["profile", "show", str(profile.folder)]) == DONE
    assert said in " ".join(capsys.readouterr().out.split())
    rig = profile.folder / "rig.json"  # of the profile: the calibration in use is what was verified
    assert main(["export", str(rig), "--to", "metashape", "-o", str(tmp_path / "again.xml")]) == DONE
    assert said in (tmp_path / "again.xml").read_text()


def test_a_failure_written_elsewhere_is_known_beside_the_rig(tmp_path: Path) -> None:
    session, truth = simulate_session("rigA", 5, SimulationOptions(bar_poses=8, placements=1, targets=40))
    write_session(session, truth, tmp_path / "session")
    for name, scale, code in (("wrong", 1.01, NOT_VALID), ("right", 1.0, DONE)):
        folder, elsewhere = tmp_path / name, tmp_path / f"{name}-verified"
        folder.mkdir()
        (folder / "rig.json").write_bytes(rig_bytes(true_rig(truth, scale=scale)))
        for table, columns in TABLES.items():
            write_table(folder / table, columns, ())
        assert main(["verify", str(tmp_path / "session"), "--rig", str(folder), "-o", str(elsewhere)]) == code
        assert (folder / "verification.json").exists() == (name == "wrong")
        exported = main(["export", str(folder), "--to", "csv", "-o", str(tmp_path / f"{name}.csv")])
        assert exported == (BAD_INPUT if name == "wrong" else DONE)


def test_only_a_failed_verification_is_overridden(tmp_path: Path) -> None:
    folder = verified(tmp_path / "result")
    assert main(["override", str(folder), *WHO]) == BAD_INPUT
    assert main(["export", str(folder / "rig.json"), "--to", "csv", "-o", str(tmp_path / "rig.csv")]) == DONE


def test_restore_passes_over_a_failed_one(failed: Path, tmp_path: Path) -> None:
    profile = create_profile(tmp_path / "profile", "Rig 7")
    good = save_result(profile, verified(tmp_path / "good"))
    bad = save_result(profile, failed)
    used = apply(open_profile(profile.folder), good)
    with pytest.raises(InputError):
        restore(used, bad)
    assert open_profile(profile.folder).active_id == good


def test_exit_codes_say_which_question_was_answered(tmp_path: Path) -> None:
    session, truth = simulate_session("rigA", 5, SimulationOptions(bar_poses=8, placements=1, targets=40))
    folder = tmp_path / "session"
    write_session(session, truth, folder)

    def code(scale: float, relative: float, *limit: str) -> int:
        rig = replace(true_rig(truth, scale=scale), scale=RigScale("bar", relative))
        (tmp_path / "rig.json").write_bytes(rig_bytes(rig))
        words = ["verify", str(folder), "--rig", str(tmp_path / "rig.json"), "-o", str(tmp_path / "out"), *limit]
        return main(words)

    assert code(1.0, 0.0) == DONE
    assert code(1.0, 0.0, "--limit", "0.5") == DONE
    assert code(1.005, 0.0) == NOT_VALID
    assert code(1.005, 0.0, "--limit", "9") == NOT_VALID  # within a wide limit, and not what it states
    assert code(1.005, 0.005, "--limit", "0.05+L/20000") == LIMIT_EXCEEDED
    assert code(1.005, 0.0, "--limit", "0.05+L/20000") == BOTH
    assert code(1.0, 0.0, "--limit", "0.03") == CANNOT_TELL
