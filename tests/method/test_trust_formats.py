"""What comes from outside in every format of ours: a plain refusal, no traceback, no wait, nothing else touched."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest

from spherecal.base.errors import InputError, OutputError
from spherecal_app.cli.main import main
from spherecal_cameras.genicam.messages import Live
from spherecal_cameras.genicam.wire import WireError, pack, unpack
from spherecal_documents.support.redact import Redactor
from spherecal_documents.support.support_bundle import BundleOptions, unpacked_session, write_bundle
from spherecal_files.atomic import RESULT, write_folder_whole
from spherecal_files.filesystem import create, write_whole
from spherecal_files.lock import LOCK, locked, short_name
from spherecal_files.read_session import read_session
from spherecal_gui.project_folder import load_project, recent_projects
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions
from spherecal_study.batch_of_sessions import fingerprint_of

_PROJECT = {
    "format": "spherecal/wizard", "version": 1, "source": "replay:x", "step": "place", "cameras": ["S1"],
    "looked": ["S1"], "placements": ["P1"], "scale_poses": [], "check_poses": [],
}  # fmt: skip


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    session, truth = simulate_session("demo", 1, SimulationOptions(targets=12, placements=2, bar_poses=1))
    folder = tmp_path_factory.mktemp("recording") / "session"
    write_session(session, truth, folder)
    return folder


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("calibrated", {}), ("calibrated", {"inputs": 5, "verdict": "valid"}), ("saved", 7), ("checked", "x"),
        ("verified", {"inputs": [["a"]], "verdict": "valid"}), ("saved", {"inputs": [["a", [1]]], "verdict": "valid"}),
        ("calibrated", {"inputs": [], "verdict": {"x": 1}}), ("artefacts", {"check_bars": 5}), ("artefacts", [1]),
        ("repairs", [["a"]]), ("repairs", 1), ("pose_bars", [[]]), ("failures", {"a": []}), ("bench", []),
        ("masks", [{"camera": "C"}]), ("bar_celsius", 10**400),
    ],
)  # fmt: skip
def test_a_project_of_wrong_values_is_refused(tmp_path: Path, key: str, value: object) -> None:
    (tmp_path / "wizard.json").write_text(json.dumps({**_PROJECT, key: value}))
    with pytest.raises(InputError, match=r"wizard\.json"):
        load_project(tmp_path)


def test_one_damaged_project_hides_no_other(tmp_path: Path) -> None:
    for name in ("good", "linked"):
        (tmp_path / name).mkdir()
    (tmp_path / "good" / "wizard.json").write_text(json.dumps(_PROJECT))
    (tmp_path / "linked" / "wizard.json").symlink_to(tmp_path / "nowhere")
    assert recent_projects(tmp_path) == [tmp_path / "good"]


def test_a_number_too_long_for_a_float_is_no_message() -> None:
    message = json.loads(pack(Live(5.0)))
    with pytest.raises(WireError):
        unpack(json.dumps([message[0], {"rate_hz": 10**400}]).encode(), (Live,))


def test_cameras_called_by_their_serial_numbers_stay_the_same_in_a_bundle(recording: Path, tmp_path: Path) -> None:
    folder, serial = tmp_path / "session", "40012345"
    shutil.copytree(recording, folder)
    (folder / "truth.json").unlink()
    for name in ("session.json", "observations.csv"):
        text = (folder / name).read_text()
        (folder / name).write_text(text.replace('"C01"', f'"{serial}"').replace(",C01,", f",{serial},"))
    captured = {"format": "spherecal/capture", "version": 1, "cameras": [{"id": serial, "serial": serial}], "sets": []}
    (folder / "capture.json").write_text(json.dumps(captured))
    write_bundle(folder, tmp_path / "b.zip", BundleOptions())
    with unpacked_session(tmp_path / "b.zip") as opened:
        ids = {camera.id for camera in read_session(opened).cameras}  # reads the observations too
        assert serial not in ids
        assert len(ids) == len(read_session(folder).cameras)
        assert serial not in "".join(path.read_text() for path in opened.iterdir())


def test_numbers_in_tables_are_never_taken_for_serial_numbers() -> None:
    redactor = Redactor({"x.json": b'{"id": "1234", "serial": "1234"}'})
    table = b"placement,camera,target,point,u,v\nP1,1234,1,A,1234,1234.5\n"
    assert redactor.file("x.csv", table) == b"placement,camera,target,point,u,v\nP1,serial-1,1,A,1234,1234.5\n"


def test_tables_are_redacted_in_every_form_that_is_read() -> None:
    """With quotation marks, a byte order mark and carriage returns, as spreadsheets write them."""
    redactor = Redactor({"x.json": b'{"id": "1234", "serial": "1234"}'})
    table = '\ufeff"placement","point","camera"\r\n"P1","A","1234"\r\nP1,A,1234\r\n'.encode()
    assert redactor.file("x.csv", table) == b'"placement","point","camera"\r\n"P1","A","serial-1"\r\nP1,A,serial-1\r\n'


def test_a_nest_is_redacted_as_text() -> None:
    nest = b'{"a":' * 900 + b'"Otto: operator=otto9"' + b"}" * 900
    assert b"otto9" not in Redactor({"x.json": nest}).file("x.json", nest)


def test_a_second_name_of_the_users_file_is_no_lock(tmp_path: Path) -> None:
    (tmp_path / "own").write_text("the user's")
    os.link(tmp_path / "own", tmp_path / f".{short_name(tmp_path / 'out')}{LOCK}")
    with pytest.raises(OutputError, match="not a lock file"), locked(tmp_path / "out"):
        pass
    assert (tmp_path / "own").read_text() == "the user's"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with a name are of Unix")
def test_a_log_into_a_pipe_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / "pipe")
    reader = threading.Timer(5.0, lambda: os.close(os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)))
    reader.start()  # ends the wait of a program that opens it
    try:
        assert main(["--log", str(tmp_path / "pipe"), "profile", "list", str(tmp_path)]) == 2
    finally:
        reader.cancel()
    assert "is not a file that the log can be written to" in capsys.readouterr().err


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with a name are of Unix")
def test_one_hostile_session_of_a_batch_stops_nobody(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "session.json")
    (tmp_path / "image.png").symlink_to(tmp_path / "nowhere")
    assert len(fingerprint_of(tmp_path)) == 64


def _program(*words: str, **streams: object) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "spherecal_app.cli.main", *words]
    return subprocess.run(command, text=True, timeout=120, check=False, **streams)  # type: ignore[call-overload]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a file that is always full")
@pytest.mark.parametrize("end", ["full", "closed pipe"])
def test_progress_that_nobody_takes_stops_no_work(recording: Path, tmp_path: Path, end: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    error = os.open("/dev/full", os.O_WRONLY) if end == "full" else writer
    words = ("calibrate", str(recording), "-o", str(tmp_path / "o"), "--method", "free")
    done = _program(*words, stdout=subprocess.DEVNULL, stderr=error)
    assert done.returncode == 3  # the small recording gives a result that is not valid
    assert (tmp_path / "o" / "rig.json").is_file()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a file that is always full")
def test_a_log_on_a_full_disk_is_no_traceback(tmp_path: Path) -> None:
    done = _program("--log", "/dev/full", "profile", "list", str(tmp_path), capture_output=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not os.path.isdir("/dev/shm"), reason="needs a folder of the user's below /dev")
def test_a_link_below_dev_is_not_written_through() -> None:
    with tempfile.TemporaryDirectory(dir="/dev/shm") as name:
        own, link = Path(name) / "own", Path(name) / "link"
        own.write_text("the user's")
        link.symlink_to(own)
        with pytest.raises(InputError, match="is a link"):
            write_whole(link, b"x")
        assert own.read_text() == "the user's"


def test_a_result_that_cannot_be_written_stays_and_leaves_nothing(tmp_path: Path) -> None:
    old = tmp_path / "o"
    old.mkdir()
    (old / "rig.json").write_text('{"format": "spherecal/rig"}')
    old.chmod(0o500)
    if os.access(old, os.W_OK):
        pytest.skip("the administrator may write everywhere")
    with pytest.raises(OutputError, match="permission denied"):
        write_folder_whole(old, lambda new: create(new / "rig.json", b"{}"), RESULT)
    old.chmod(0o700)
    assert [path.name for path in tmp_path.iterdir()] == ["o"]
    assert (old / "rig.json").read_text() == '{"format": "spherecal/rig"}'


def test_an_image_without_end_is_refused_before_it_is_read(tmp_path: Path) -> None:
    images = {}
    for camera in ("C01", "C02", "C03"):
        images[camera] = f"{camera}.png"
        (tmp_path / images[camera]).write_bytes(b"x")
    with (tmp_path / "C02.png").open("r+b") as file:
        file.truncate(2 << 30)  # takes no room on the disk
    cameras = [{"id": one, "image_size": [9, 9], "pixel_pitch_um": 3.0, "focal_length_mm": 8.0} for one in images]
    document = {"format": "spherecal/session", "version": 1, "cameras": cameras, "target_set": "targets.json"}
    document["placements"] = [{"id": "P1", "images": images}]
    assert main(["targets", "export", "-o", str(tmp_path / "targets.json"), "--count", "9"]) == 0
    (tmp_path / "session.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"C02\.png: is larger than"):
        read_session(tmp_path)


def test_a_batch_writes_into_no_folder_of_the_users(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "batch.csv").write_text("an earlier one")
    (tmp_path / "out" / "thesis.tex").write_text("the user's")
    words = ["batch", str(recording.parent), "-o", str(tmp_path / "out"), "--workers", "0", "--method", "free"]
    assert main(words) == 2
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["batch.csv", "thesis.tex"]
    assert (tmp_path / "out" / "batch.csv").read_text() == "an earlier one"


@pytest.mark.skipif(os.name == "nt", reason="signals as POSIX has them")
def test_ctrl_c_within_a_destructor_is_noted_without_a_traceback() -> None:
    code = (
        "import signal\nfrom spherecal.base import interrupts\ninterrupts.begin()\n"
        "class One:\n    def __del__(self): signal.raise_signal(signal.SIGINT)\n"
        "One()\nprint(interrupts.came())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "True\n", "")
