"""The support bundle: what is in it, that it gives the same bits, and what of foreign archives is refused."""

import io
import json
import os
import shutil
import stat
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from spherecal.base.errors import InputError
from spherecal_app.cli.main import main
from spherecal_documents.support.support_bundle import BundleContents, BundleOptions, unpacked_session, write_bundle
from spherecal_files.read_session import read_session
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions
from tests.example_session import VALID, changed, make_session


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session folder with observations and a few images that only serve for display."""
    folder = tmp_path_factory.mktemp("bundle") / "session"
    session, truth = simulate_session("rigA", 1, SimulationOptions(targets=40, placements=3, bar_poses=1))
    write_session(session, truth, folder)
    document = json.loads((folder / "session.json").read_text())
    Image.fromarray(np.zeros((8, 8), np.uint8)).save(folder / "P1.png")
    document["placements"][0]["images"] = {"C01": "P1.png"}
    (folder / "session.json").write_text(json.dumps(document))
    return folder


def test_calibrating_a_bundle_gives_the_same_bits(recording: Path, tmp_path: Path) -> None:
    assert main(["calibrate", str(recording), "-o", str(tmp_path / "a")]) == 0
    bundle = tmp_path / "support.zip"
    arguments = ["support-bundle", str(recording), "-o", str(bundle), "--result", str(tmp_path / "a"), "--names"]
    assert main(arguments) == 0
    assert main(["calibrate", str(bundle), "-o", str(tmp_path / "b")]) == 0
    for name in ("rig.json", "covariance.npy", "points.csv", "residuals.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    names = zipfile.ZipFile(bundle).namelist()
    assert "result/rig.json" in names and "versions.json" in names
    assert not any(name.endswith(".png") or "truth" in name for name in names)


def test_images_come_along_only_when_asked(recording: Path, tmp_path: Path) -> None:
    files = write_bundle(recording, tmp_path / "with.zip", BundleOptions(images=True))
    assert "session/P1.png" in files
    with unpacked_session(tmp_path / "with.zip") as folder:
        assert read_session(folder).input_sha256 == read_session(recording).input_sha256
    assert "session/P1.png" not in write_bundle(recording, tmp_path / "without.zip")


def test_a_bundle_that_was_changed_counts_as_itself(recording: Path, tmp_path: Path) -> None:
    write_bundle(recording, tmp_path / "b.zip")
    with unpacked_session(tmp_path / "b.zip") as folder:
        same = read_session(folder).input_sha256
        lines = (folder / "observations.csv").read_text().splitlines()
        (folder / "observations.csv").write_text("\n".join(lines[:-1]) + "\n")
        assert read_session(folder).input_sha256 != same == read_session(recording).input_sha256


def test_bars_of_the_registry_are_filled_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPHERECAL_BARS", str(tmp_path / "bars.json"))
    full, named = tmp_path / "full", tmp_path / "named"
    full.mkdir()
    named.mkdir()
    make_session(full)
    assert main(["bars", "add", "B-1", "--from-session", str(full), "--certificate", "K-1"]) == 0
    make_session(named, changed("bars", to=[{"id": "A", "role": "check", "serial": "B-1"}]))
    original = read_session(named)
    write_bundle(named, tmp_path / "b.zip", BundleOptions(names=True))
    assert main(["bars", "remove", "B-1"]) == 0
    with unpacked_session(tmp_path / "b.zip") as folder:
        session = read_session(folder)
    assert session.input_sha256 == original.input_sha256
    assert session.bars == original.bars and session.bars[0].lengths[0].length_mm == 412.345


def test_a_session_of_images_brings_its_observations(tmp_path: Path) -> None:
    """Images without a single target: the bundle holds a table of observations, though an empty one."""
    session = tmp_path / "session"
    session.mkdir()
    make_session(session, {**VALID, "bar_poses": [], "placements": [{"id": "P1", "images": {"C01": "a.png"}}]})
    (session / "observations.csv").unlink()
    Image.fromarray(np.zeros((1544, 2064), np.uint8)).save(session / "a.png")
    files = write_bundle(session, tmp_path / "b.zip")
    assert "session/observations.csv" in files and "session/a.png" not in files
    with unpacked_session(tmp_path / "b.zip") as folder:
        assert read_session(folder).input_sha256 == read_session(session).input_sha256


def test_logs_do_not_name_the_user(recording: Path, tmp_path: Path) -> None:
    log = tmp_path / "run log.txt"
    log.write_text(f"opened {Path.home()}/rigs/7\n")
    write_bundle(recording, tmp_path / "b.zip", BundleOptions(logs=(log,)))
    text = zipfile.ZipFile(tmp_path / "b.zip").read("logs/1-run_log.txt").decode()
    assert text == "opened ~/rigs/7\n"


NAMES = ("anna", "LAB-PC7", "server9", "50-0503343", "beata")


def test_names_of_people_computers_and_serials_are_replaced_the_same_everywhere(
    recording: Path, tmp_path: Path
) -> None:
    session = tmp_path / "session"
    shutil.copytree(recording, session)
    document = json.loads((session / "session.json").read_text())
    document["cameras"][0]["serial"] = "50-0503343"
    (session / "session.json").write_text(json.dumps(document))
    captured = {"format": "spherecal/capture", "version": 1, "source": {"label": "/home/anna/rig"}, "operator": "beata",
                "cameras": [{"id": "C01", "serial": "50-0503343"}], "sets": []}  # fmt: skip
    (session / "capture.json").write_text(json.dumps(captured))
    log = tmp_path / "a.log"
    log.write_text(
        "C:\\Users\\anna\\x on host LAB-PC7 host=LAB-PC7 \\\\server9\\share camera 50-0503343 lost, operator: beata\n"
    )
    told: list[BundleContents] = []
    out = tmp_path / "b.zip"
    write_bundle(session, out, BundleOptions(logs=(log,)), None, told.append)
    with zipfile.ZipFile(out) as bundle:
        packed = {name: bundle.read(name).decode(errors="replace") for name in bundle.namelist()}
    for name in NAMES:
        assert not [file for file, text in packed.items() if name in text]
    serial = json.loads(packed["session/session.json"])["cameras"][0]["serial"]
    assert serial.startswith("serial-") and json.loads(packed["session/capture.json"])["cameras"][0]["serial"] == serial
    assert serial in packed["logs/1-a.log"] and "host=host-" in packed["logs/1-a.log"]
    assert any("serial numbers" in one for one in told[0].redacted) and "session/session.json" in told[0].files
    with unpacked_session(out) as folder:
        assert read_session(folder).input_sha256 == read_session(session).input_sha256
    write_bundle(session, out, BundleOptions(names=True))
    with zipfile.ZipFile(out) as bundle:
        assert b"50-0503343" in bundle.read("session/session.json")


def test_what_is_in_it_is_told_before_it_is_written(recording: Path, tmp_path: Path) -> None:
    def no(contents: BundleContents) -> None:
        raise InputError("No, thank you.")

    with pytest.raises(InputError, match="thank you"):
        write_bundle(recording, tmp_path / "b.zip", None, None, no)
    assert not (tmp_path / "b.zip").exists()


@pytest.mark.skipif(os.name == "nt", reason="links need rights on Windows")
@pytest.mark.parametrize("name", ["session/capture.json", "result/points.csv", "session/P1.png"])
def test_what_a_link_leads_to_is_never_packed(recording: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.key").write_text("the secret")
    shutil.copytree(recording, tmp_path / "session")
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "rig.json").write_text("{}")
    (tmp_path / name).unlink(missing_ok=True)
    (tmp_path / name).symlink_to(tmp_path / "secret.key")
    with pytest.raises(InputError):
        write_bundle(tmp_path / "session", tmp_path / "b.zip", BundleOptions(tmp_path / "result", images=True))
    assert not (tmp_path / "b.zip").exists()


@pytest.mark.parametrize(
    "name", ["../evil.txt", "/etc/evil", "session/../../evil", "C:/evil", "session\\..\\evil", "a/../../b"]
)
def test_archives_that_leave_their_folder_are_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "b.zip"
    with zipfile.ZipFile(path, "w") as bundle:
        bundle.writestr(name, "x")
    with pytest.raises(InputError, match="outside itself"), unpacked_session(path):
        pass
    assert not (tmp_path.parent / "evil.txt").exists()


def test_links_bombs_and_broken_archives_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    link = tmp_path / "link.zip"
    with zipfile.ZipFile(link, "w") as bundle:
        info = zipfile.ZipInfo("session/session.json")
        info.external_attr = (stat.S_IFLNK | 0o777) << 16
        bundle.writestr(info, "/etc/passwd")
    with pytest.raises(InputError, match="outside itself"), unpacked_session(link):
        pass
    monkeypatch.setattr("spherecal_documents.support.support_bundle._MOST_UNPACKED", 1 << 20)
    bomb = tmp_path / "bomb.zip"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as bundle:
        bundle.writestr("session/session.json", b"\0" * (4 << 20))
    with pytest.raises(InputError, match="would unpack"), unpacked_session(bomb):
        pass
    for text in ("no archive", ""):
        (tmp_path / "b.zip").write_text(text)
        with pytest.raises(InputError) as raised, unpacked_session(tmp_path / "b.zip"):
            pass
        assert raised.value.code == "error-not-unpacked"
    other = io.BytesIO()
    with zipfile.ZipFile(other, "w") as bundle:
        bundle.writestr("readme", "x")
    (tmp_path / "b.zip").write_bytes(other.getvalue())
    with pytest.raises(InputError, match=r"contains no session/session\.json"), unpacked_session(tmp_path / "b.zip"):
        pass
    with zipfile.ZipFile(tmp_path / "b.zip", "w", zipfile.ZIP_DEFLATED) as bundle:
        bundle.writestr("session/session.json", bytes(range(256)) * 100)
    packed = bytearray((tmp_path / "b.zip").read_bytes())
    packed[60:100] = b"\xff" * 40  # no longer what deflate writes
    (tmp_path / "b.zip").write_bytes(packed)
    with pytest.raises(InputError, match="is not a bundle"), unpacked_session(tmp_path / "b.zip"):
        pass
    (tmp_path / "cut.zip").write_bytes(bomb.read_bytes()[:100])
    with pytest.raises(InputError, match="is not a bundle"), unpacked_session(tmp_path / "cut.zip"):
        pass
    with pytest.raises(InputError, match="no such file"), unpacked_session(tmp_path / "none.zip"):
        pass


@pytest.mark.parametrize("compression", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_archives_packed_otherwise_are_refused(tmp_path: Path, compression: int) -> None:
    """Damaged ones of LZMA raised an error of their own, which nobody caught."""
    with zipfile.ZipFile(tmp_path / "b.zip", "w", compression) as bundle:
        bundle.writestr("session/session.json", bytes(range(256)) * 100)
    packed = bytearray((tmp_path / "b.zip").read_bytes())
    packed[70:90] = b"\xff" * 20
    (tmp_path / "b.zip").write_bytes(packed)
    with pytest.raises(InputError, match="is not a bundle"), unpacked_session(tmp_path / "b.zip"):
        pass


def test_what_is_no_result_is_refused(recording: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a result folder"):
        write_bundle(recording, tmp_path / "b.zip", BundleOptions(result=tmp_path))
    assert not (tmp_path / "b.zip").exists()


@pytest.mark.parametrize(
    "document", ["{}", '{"format": "spherecal/bundle", "version": 9}', "[",
                 '{"format": "spherecal/bundle", "version": 1,'
                 ' "input_sha256": "x", "files_sha256": {}}', '{"format": "spherecal/bundle", "version": 1, '
                 '"input_sha256": "x", "files_sha256": []}']
)  # fmt: skip
def test_a_broken_bundle_file_is_named(tmp_path: Path, document: str) -> None:
    folder = make_session(tmp_path)
    (folder / "bundle.json").write_text(document)
    with pytest.raises(InputError, match=r"bundle\.json"):
        read_session(folder)
