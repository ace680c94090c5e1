"""Limits of readers, locks, exit codes and messages: what comes from outside costs neither memory nor a traceback."""

import errno
import json
import os
import pickle
import re
import signal
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import cast
from xml.etree import ElementTree

import numpy as np
import pytest
from example_session import make_session
from export_rigs import make_rig

from spherecal.base.errors import InputError, OutputError
from spherecal.data.session import BarLength, Certificate, Mark
from spherecal.targets.images import read_image
from spherecal_app.cli.main import main
from spherecal_cameras.capture import SessionCamera, SessionFolder, session_ids
from spherecal_cameras.genicam import messages, wire
from spherecal_cameras.genicam.rings import Ring
from spherecal_cameras.plan import CapturePlan, PlannedSet
from spherecal_cameras.protocol import CameraSource, CameraState, Counters, SetupReport
from spherecal_documents.export.anipose import read_toml
from spherecal_documents.export.colmap import read_colmap
from spherecal_documents.export.opencv_yaml import read_yaml
from spherecal_documents.export.write_export import export_rig
from spherecal_files import filesystem as files
from spherecal_files.atomic import RESULT, write_folder_whole
from spherecal_files.bar_registry import RegisteredBar
from spherecal_files.cells import cell, from_cell
from spherecal_files.filesystem import PARTIAL, write_below, write_whole
from spherecal_files.json_file import read_json
from spherecal_files.lock import locked
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig, rig_bytes
from spherecal_rigs.bars_table import read_bars_table, write_bars_table
from spherecal_rigs.result_folder import read_csv

posix = pytest.mark.skipif(os.name == "nt", reason="POSIX")

# --- 5: writers ------------------------------------------------------------------------------------------------------


def test_a_lock_names_its_holder_and_goes_with_it(tmp_path: Path) -> None:
    with locked(tmp_path / "x"):
        with locked(tmp_path / "x"):  # the same thread may
            pass
        refused: list[OutputError] = []

        def other() -> None:
            try:
                with locked(tmp_path / "x", wait_s=0.05):
                    pass
            except OutputError as error:
                refused.append(error)

        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
        assert refused[0].code == "error-in-use"
        for language, word in (("en", "process"), ("de", "Prozess"), ("zh_CN", "进程")):
            assert f"{word} {os.getpid()}" in refused[0].words(language)[0]
    assert list(tmp_path.iterdir()) == []


@posix
def test_a_lock_of_a_killed_process_is_free(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from spherecal_files.lock import locked\n"
        "with locked(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "x")], stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None and holder.stdout.readline() == "held\n"
    with pytest.raises(OutputError, match=f"process {holder.pid}"), locked(tmp_path / "x", wait_s=0.05):
        pass
    holder.kill()
    holder.wait()
    assert list(tmp_path.iterdir())  # its file is left
    with locked(tmp_path / "x", wait_s=5):
        pass
    assert list(tmp_path.iterdir()) == []


@posix
def test_a_drive_without_locks_is_written_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import fcntl

    def refuses(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refuses)
    with locked(tmp_path / "x"):
        files.write_whole(tmp_path / "x", b"new")
    assert (tmp_path / "x").read_bytes() == b"new"


@posix
@pytest.mark.parametrize("kind", ["output", "profile", "project"])
def test_writers_side_by_side(tmp_path: Path, kind: str) -> None:
    """Few rounds here, more in benchmarks/studies/hostile.md."""
    from benchmarks.studies.hostile_tries import writers

    found = writers(4, tmp_path / kind, kind, 2)
    assert found.problems == [] and found.successes == 8


@posix
def test_planted_partial_names_are_not_written_through(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / ".out.csv.spherecal-partial").symlink_to(tmp_path / "mine")
    files.write_whole(tmp_path / "out.csv", b"x")
    assert (tmp_path / "mine").read_text() == "mine"


@posix
def test_modes_are_kept(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("old")
    (tmp_path / "a.json").chmod(0o600)
    files.write_whole(tmp_path / "a.json", b"new")
    assert (tmp_path / "a.json").stat().st_mode & 0o777 == 0o600

    def build(folder: Path) -> None:
        files.create(folder / "rig.json", b'{"format": "spherecal/rig"}')

    write_folder_whole(tmp_path / "out", build, RESULT)
    (tmp_path / "out" / "rig.json").chmod(0o600)
    write_folder_whole(tmp_path / "out", build, RESULT)
    assert (tmp_path / "out" / "rig.json").stat().st_mode & 0o777 == 0o600


# --- 7: names of cameras ---------------------------------------------------------------------------------------------


def test_a_cameras_own_name_becomes_an_id() -> None:
    found = session_ids({"S1": "../../../pwned", "S2": "", "S3": "front", "S4": "front", "../x": ".."})
    assert found == {"S1": "pwned", "S2": "S2", "S3": "S3", "S4": "S4", "../x": "x"} or all(
        files.id_problem(one) is None for one in found.values()
    )
    assert found["S1"] not in ("", "../../../pwned") and len(set(found.values())) == 5


def test_a_session_takes_no_camera_whose_id_is_a_path(tmp_path: Path) -> None:
    source = cast(CameraSource, SimpleNamespace(kind="replay", label=""))
    plan = CapturePlan((PlannedSet("P1"),), None, {})
    with pytest.raises(InputError, match="id"):
        SessionFolder(tmp_path, plan, (SessionCamera("S1", {"id": "../../../pwned"}),), source)


# --- 9: memory and time ----------------------------------------------------------------------------------------------


@posix
def test_images_are_looked_at_before_they_are_read(tmp_path: Path) -> None:
    for name, start in (("a.png", b"\x89PNG\r\n\x1a\n"), ("b.png", b""), ("c.tif", b"II*\x00")):
        with (tmp_path / name).open("wb") as file:
            file.write(start)
            file.truncate(12 << 30)
        with pytest.raises(InputError):
            read_image(tmp_path / name)
    os.mkfifo(tmp_path / "pipe.png")
    for path in (tmp_path / "pipe.png", Path("/dev/zero"), tmp_path):
        with pytest.raises(InputError):
            read_image(path)


def test_an_image_far_longer_than_its_pixels_is_refused(tmp_path: Path) -> None:
    from PIL import Image

    Image.fromarray(np.zeros((80, 90), np.uint8)).save(tmp_path / "a.png")
    with (tmp_path / "a.png").open("ab") as file:
        file.truncate(40 << 20)
    with pytest.raises(InputError, match="far more than"):
        read_image(tmp_path / "a.png")


def test_one_long_line_is_refused(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(b"a,b\n1," + b"x" * 3_000_000 + b"\n")
    with pytest.raises(InputError, match="line 2 is longer"):
        read_csv(tmp_path / "t.csv", "a,b")
    folder = make_session(tmp_path)
    with (folder / "observations.csv").open("ab") as file:
        file.write(b"x" * 100_000)
    with pytest.raises(InputError, match="is longer"):
        read_session(folder)


def test_json_of_too_many_values_or_levels_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    for text, said in (("[" + "0," * 2_100_000 + "0]", "values"), ("[" * 300 + "]" * 300, "nested")):
        path.write_text(text)
        with pytest.raises(InputError, match=said):
            read_json(path, "spherecal/x", 1)


def test_unknown_fields_cost_no_time(tmp_path: Path) -> None:
    """A million keys took 36 s; only some are compared with the known ones."""
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"format": "spherecal/x", "version": 1, **{f"k{i}": 0 for i in range(200_000)}}))
    document = read_json(path, "spherecal/x", 1)
    calls = 0

    def count(*_: object) -> list[str]:
        nonlocal calls
        calls += 1
        return []

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("difflib.get_close_matches", count)
        document.fields((), ("mask", "mark"))
    assert calls <= 50


def test_a_rig_of_20000_cameras_is_refused(tmp_path: Path) -> None:
    document = json.loads(rig_bytes(make_rig(5, 1, 3)))
    document["cameras"] = document["cameras"] * 20_000
    (tmp_path / "rig.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="1000"):
        read_rig(tmp_path / "rig.json")


# --- 11 --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words",
    ["calibrate {x} -o {o}", "verify {x} --rig {x} -o {o}", "report {x} -o {o}", "export {x} --to csv -o {o}",
     "profile show {x}", "detect {x} --targets {x} --csv {o}", "bars list --registry {x}", "support-bundle {x} -o {o}",
     "targets export -o {o}/" + "y" * 300],
)  # fmt: skip
def test_names_that_are_too_long_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str) -> None:
    line = words.format(x=tmp_path / ("x" * 300), o=tmp_path / "o").split()
    assert main(line) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("spherecal: ")


def test_lack_of_memory_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def lack(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("spherecal_app.cli.doctor_command.doctor", lack)
    assert main(["doctor"]) == 2
    assert "not enough memory" in capsys.readouterr().err


def program(*words: str, **options: object) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "spherecal_app.cli.main", *words], stderr=subprocess.PIPE, **options)  # type: ignore[call-overload]


@posix
def test_output_that_is_full_or_closed() -> None:
    with open("/dev/full", "w") as full:
        process = program("licences", stdout=full)
        said = process.communicate()[1]
    assert process.returncode == 2 and b"no space left" in said and b"Traceback" not in said
    process = program("licences", stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    said = process.communicate()[1]
    assert process.returncode == 0 and said == b""


@posix
def test_a_result_is_there_though_its_words_are_lost(tmp_path: Path) -> None:
    """The exit code is that of the work; only where the words are all that was asked for, their loss is a failure."""
    targets, full = tmp_path / "targets.json", "standard output cannot be written (no space left on device)"
    for words, code in (((), 0), (("--json",), 2)):
        targets.unlink(missing_ok=True)
        with open("/dev/full", "w") as disk:
            process = program("targets", "export", "-o", str(targets), "--count", "9", *words, stdout=disk)
            said = process.communicate()[1].decode()
        assert process.returncode == code
        assert full in said.lower() and "in place" in said
        assert targets.is_file()


@posix
@pytest.mark.parametrize("when", ["before", "while"])
def test_blas_finds_its_buffers_or_ends(when: str) -> None:
    """OpenBLAS asks for its buffers without end: the process spun, deaf to signals."""
    code = (
        "import resource, numpy as np, scipy.linalg\n"
        "from spherecal.base.threads import one_blas_thread\n"
        "def limit():\n"
        "    used = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize()\n"
        "    resource.setrlimit(resource.RLIMIT_AS, (used + (8 << 20),) * 2)\n"
        f"if {when == 'before'}: limit()\n"
        "with one_blas_thread():\n"
        "    limit()\n"
        "    scipy.linalg.cho_factor(np.eye(300))\n"
        "    np.dot(np.eye(300), np.eye(300))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    if when == "while":
        assert done.returncode == 0, done.stderr
    else:
        assert done.stderr.splitlines()[-1] == "MemoryError"


@posix
def test_too_few_addresses_are_refused_before_libraries_crash(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "spherecal_app.cli.main", "simulate", "demo", "--observations-only", "-o", "s"]
    script = ["sh", "-c", 'ulimit -v 700000; exec "$@"', "sh", *command]
    done = subprocess.run(script, capture_output=True, text=True, timeout=120, check=False, cwd=tmp_path)
    assert done.returncode == 2 and "ulimit -v" in done.stderr and len(done.stderr.splitlines()) == 1


def test_a_toml_key_of_many_parts_is_refused(tmp_path: Path) -> None:
    """The parser's memory grows with the square of their number: 2.4 GB for 100,000."""
    file = tmp_path / "calibration.toml"
    for separator in (".", " . ", '."x y".'):
        file.write_text(separator.join(["a"] * 100_000) + " = 1\n")
        with pytest.raises(InputError, match="50 parts"):
            read_toml(file)
    # with a table for each of its lines, and numbers in rows
    file.write_text("[a.b.c]\n" + "x = [" + "1.5, " * 200_000 + "2]\n" + f"y = '{'a' * 1_000_000}'\n")
    document = cast(dict[str, dict], read_toml(file).value)
    assert len(document["a"]["b"]["c"]["x"]) == 200_001


def test_colmaps_cameras_are_counted_while_they_are_read(tmp_path: Path) -> None:
    cameras = "".join(f"{n} PINHOLE 100 90 80 80 50 45\n" for n in range(1, 200_001))
    (tmp_path / "cameras.txt").write_text(cameras)
    began = time.process_time()
    with pytest.raises(InputError, match="more than 1000 cameras"):
        read_colmap(tmp_path)
    assert time.process_time() - began < 5.0


@posix
def test_what_killed_writers_left_is_removed(tmp_path: Path) -> None:
    """By the next writer in the folder: at once under a lock, else what nobody has written to for an hour."""
    left = [tmp_path / f".{n:012x}{PARTIAL}" for n in range(2)]
    strange = tmp_path / f".other{PARTIAL}"
    for path in (*left, strange):
        path.write_text("half")
    os.utime(left[0], (0, 0))
    write_whole(tmp_path / "a", b"x")
    assert [path.exists() for path in left] == [False, True]
    write_below(tmp_path, "a", b"y", alone=True)
    assert not left[1].exists() and strange.exists()


@posix
def test_ctrl_c_while_the_program_loads_is_130() -> None:
    code = "import sys, os, signal; sys.argv[0] = 'spherecal'; import spherecal; os.kill(os.getpid(), signal.SIGINT)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (130, b"spherecal: Cancelled.\n")
    other = code.replace("'spherecal'", "'other'")
    assert (
        b"KeyboardInterrupt" in subprocess.run([sys.executable, "-c", other], capture_output=True, check=False).stderr
    )


def test_ctrl_c_is_held_back_in_short_work() -> None:
    from spherecal.base.interrupts import uninterrupted

    done = []
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        with uninterrupted():
            signal.raise_signal(signal.SIGINT)
            done.append(1)
        done.append(2)
    assert done == [1]


@pytest.mark.parametrize("damage", ["cut", "header", "objects", "huge"])
def test_a_damaged_covariance_is_refused(tmp_path: Path, damage: str) -> None:
    import hashlib
    import io

    from spherecal.data.rig import CameraCovariance

    rig = make_rig(5, 2, 3)
    matrix = np.eye(12)
    rig = type(rig)(**{**vars(rig), "covariance": CameraCovariance(matrix, np.empty(0, np.int64))})
    whole = io.BytesIO()
    np.save(whole, matrix)
    data = whole.getvalue()
    data = {
        "cut": data[:100],
        "header": data.replace(b"'shape'", b"'sh\xffpe'"),
        "objects": b"\x93NUMPY\x01\x00\x46\x00{'descr': '|O', 'fortran_order': False, 'shape': (1,), }" + b" " * 14,
        "huge": data.replace(b"(12, 12)", b"(9**9,1)"),
    }[damage]
    document = json.loads(rig_bytes(rig))
    document["covariance"]["sha256"] = hashlib.sha256(data).hexdigest()
    (tmp_path / "rig.json").write_text(json.dumps(document))
    (tmp_path / "covariance.npy").write_bytes(data)
    with pytest.raises(InputError, match=r"covariance\.npy"):
        read_rig(tmp_path / "rig.json")


def test_a_yaml_number_of_60000_digits_is_refused(tmp_path: Path) -> None:
    (tmp_path / "c.yml").write_text("image_width: 0" + "7" * 60_000 + "\n")
    with pytest.raises(InputError, match=r"c\.yml"):
        read_yaml(tmp_path / "c.yml").fields(("image_width",))["image_width"].integer()


def test_formulas_are_marked_as_text(tmp_path: Path) -> None:
    for text in ("=cmd|' /C calc'!A0", "+1", "-1", "@x", "plain", "'quoted"):
        assert from_cell(cell(text)) == text
    assert cell("=1+1") == "'=1+1"


@pytest.mark.parametrize("separator", list(",;|\t\r\n"))
def test_formulas_are_marked_behind_every_separator(separator: str) -> None:
    """A German spreadsheet begins a new cell at each `;`, whatever the file's own separator is."""
    for sign in "=+-@":
        text = f"A1{separator}{sign}1+1{separator}'{sign}2"
        assert not [part for part in cell(text).split(separator) if part[:1] == sign]
        assert from_cell(cell(text)) == text


def test_texts_of_bars_in_a_table_are_no_formulas(tmp_path: Path) -> None:
    marks = {"A": Mark(1, "centre"), "B": Mark(2, "centre")}
    lengths = (BarLength("A", "B", 412.345, 0.004),)
    bar = RegisteredBar("S;@4", marks, lengths, 1e-5, description="x;=3|b", certificate=Certificate("=1", "a;=2"))
    write_bars_table([bar], tmp_path / "bars.csv")
    parts = re.split(r'[,;|\t\r\n"]', (tmp_path / "bars.csv").read_text("utf-8-sig"))
    assert not [part for part in parts if part[:1] in set("=@")]
    (read,) = read_bars_table(tmp_path / "bars.csv").bars
    assert (read.serial, read.description, read.certificate) == (bar.serial, bar.description, bar.certificate)


def test_a_comment_of_metashape_cannot_be_closed(tmp_path: Path) -> None:
    rig = make_rig(5, 2, 3)
    rig = type(rig)(**{**vars(rig), "input_sha256": "--><evil/><!--"})
    export_rig(rig, "metashape", tmp_path / "a.xml", max_loss_px=9.0)
    assert ElementTree.parse(tmp_path / "a.xml").find(".//evil") is None
    document = json.loads(rig_bytes(rig))
    (tmp_path / "rig.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="hexadecimal"):
        read_rig(tmp_path / "rig.json")


# --- 6: messages of the camera process -------------------------------------------------------------------------------

META = messages.FrameMeta(
    "S1", "ring", 1, 5, 80, 90, False, 8, "Mono8", 1.0, 0.1, 1.2, 3, None, None, None, float("nan"), None
)


@pytest.mark.parametrize(
    "message",
    [
        messages.Hello(2, 17),
        messages.Alive({"S": Counters(rate_hz=2.5)}, {"S": None}),
        messages.Slow("S", 0.5),
        messages.StateIs("S", CameraState.LOST, "gone", "wait"),
        messages.Answer(3, (SetupReport("S", (), (80, 90)),)),
        messages.Triggered(3, {"S": "no"}),
    ],
)
def test_messages_return_as_they_were(message: object) -> None:
    assert wire.unpack(wire.pack(message), messages.REPORTS) == message


def test_what_is_unknown_in_an_image_is_none() -> None:
    assert wire.unpack(wire.pack(META), messages.REPORTS).gain_db is None


@pytest.mark.parametrize(
    "data",
    [
        pickle.dumps(print),
        b"",
        b"[]",
        b'["Quit", {}]',
        b'["Hello", {"version": 2}]',
        b'["Hello", {"version": "2", "pid": 1}]',
        b'["Hello", {"version": 1e999, "pid": 1}]',
        b'["Hello", {"version": true, "pid": 1}]',
        b"[" * 100_000,
        b'["Slow", {"serial": "' + b"x" * 30_000 + b'", "seconds": 1.0}]',
        b'["Slow", {"serial": "S", "seconds": NaN}]',
        b'["StateIs", {"serial": "S", "state": "hacked", "cause": "", "remedy": ""}]',
    ],
)
def test_what_is_no_message_is_refused(data: bytes) -> None:
    with pytest.raises(wire.WireError):
        wire.unpack(data, messages.REPORTS)


@posix
def test_a_message_that_is_cut_short_keeps_nobody_waiting() -> None:
    from multiprocessing import Pipe

    ours, theirs = Pipe()
    inbox = wire.Inbox(ours, messages.REPORTS)
    whole = wire.pack(messages.Hello(2, 17))
    os.write(theirs.fileno(), struct.pack("!i", len(whole)) + whole[:5])
    assert list(inbox.messages()) == []
    os.write(theirs.fileno(), whole[5:])
    assert list(inbox.messages()) == [messages.Hello(2, 17)]
    os.write(theirs.fileno(), struct.pack("!i", 1 << 30))
    with pytest.raises(wire.WireError, match="bytes"):
        list(inbox.messages())
    ours.close()
    theirs.close()


def test_a_ring_reads_no_slot_that_it_does_not_have() -> None:
    ring = Ring("spherecal-test-ring", 2, 100, create=True)
    try:
        slot, sequence = ring.write(np.zeros((10, 10), np.uint8))
        assert ring.read(slot, sequence, 10, 10, False) is not None
        for wrong in (
            (7, sequence, 10, 10),
            (-1, sequence, 10, 10),
            (slot, sequence, 1000, 1000),
            (slot, sequence, 0, 1),
        ):
            assert ring.read(*wrong, False) is None
    finally:
        ring.unlink()
