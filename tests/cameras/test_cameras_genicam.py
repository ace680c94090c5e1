"""GenICam cameras over real drivers: viky.cti of the genicam package, our simulated producer, and broken ones."""

import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.camera_rig import FAULTS, injected, rig
from spherecal_app.cli.main import main
from spherecal_cameras.genicam.discovery import discover, producer_files, together
from spherecal_cameras.genicam.features import NAMES, NodeFeatures
from spherecal_cameras.genicam.genicam_source import GenicamSource
from spherecal_cameras.genicam.rings import Ring, remove_orphans, shared_memory_name
from spherecal_cameras.genicam.setup import set_up
from spherecal_cameras.protocol import (
    CameraError,
    CameraInfo,
    CameraSettings,
    CameraSource,
    CameraState,
    CaptureRequest,
    EventKind,
    ProducerVerdict,
    Region,
)
from spherecal_gentl.producer.producer_control import SimulatedCamera, simulated_cameras
from tests.built_producer import built_producer

pytest.importorskip("harvesters", reason="harvesters is not installed: pip install spherecal[cameras]")
pytest.importorskip("genicam.gentl", reason="genicam is not installed: pip install spherecal[cameras]")

FREE = CameraSettings(trigger="free")
SMALL = (320, 240)
POSIX = pytest.mark.skipif(os.name == "nt", reason="kills processes by signals")


@pytest.fixture(scope="module")
def viky() -> str:
    found = importlib.util.find_spec("genicam")
    assert found is not None
    assert found.origin is not None
    file = Path(found.origin).with_name("viky.cti")
    if not file.exists():
        pytest.skip("this genicam package has no viky.cti (macOS, or before 1.6)")
    return str(file)


@pytest.fixture(scope="module")
def cti() -> Path:
    return built_producer()


@pytest.fixture(autouse=True)
def _nothing_left_behind():
    """Every test ends without our processes or shared memory."""
    yield
    assert _ours() == []


def _ours(pid: int | None = None) -> list[str]:
    folder = Path("/dev/shm")
    return [f.name for f in folder.glob(f"spherecal-*-{pid or os.getpid()}-*")] if folder.is_dir() else []


def _wait(condition, seconds: float = 10.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return False


# --- names of features -----------------------------------------------------------------------------------------------

EXPOSURE_ABS = {"AVT_GT3300", "AVT_Manta_G125B", "AVT_Manta_G235B", "AVT_Manta_G507B", "AVT_Manta_G895B",
                "Basler-acA2440-20gm"}  # fmt: skip
NO_TEMPERATURE = {"AVT_Manta_G125B"}


def test_features_of_real_cameras_are_found_by_their_right_names(shared_data):
    from genicam import genapi

    files = sorted((shared_data / "genicam_xml").glob("*.xml"))
    assert len(files) >= 10
    for file in files:
        text = file.read_text(encoding="utf-8", errors="replace")
        node_map = genapi.NodeMap()
        start = text.find("<?xml") if "<?xml" in text else text.index("<RegisterDescription")
        node_map.load_xml_from_string(text[start:])
        features = NodeFeatures(node_map, offline=True)
        old = file.stem in EXPOSURE_ABS
        assert features.name("exposure") == ("ExposureTimeAbs" if old else "ExposureTime"), file.stem
        assert features.name("gain") in ("Gain", "GainRaw"), file.stem
        assert features.name("trigger mode") == "TriggerMode"
        assert features.name("software trigger") == "TriggerSoftware"
        assert features.name("pixel format") == "PixelFormat"
        temperature = features.name("temperature")
        expected = "TemperatureAbs" if file.stem == "Basler-acA2440-20gm" else "DeviceTemperature"
        assert temperature == (None if file.stem in NO_TEMPERATURE else expected), file.stem
        # every one of them can leave room for others on a line, by its own name
        assert features.name("packet delay") or features.name("throughput limit"), file.stem
        assert features.name("common clock") or ("Ptp" not in text and "IEEE1588" not in text), file.stem
        for feature in NAMES:  # every name that is found is one that the description has
            name = features.name(feature)
            assert name is None or f'Name="{name}"' in text
        # without a camera nothing can be written: reported feature by feature, and nothing raised
        report = set_up(file.stem, NodeFeatures(node_map), CameraSettings())
        assert report.serial == file.stem
        assert all(f.problem or f.node is None or not f.wanted for f in report.features if f.feature == "exposure")


# --- discovery -------------------------------------------------------------------------------------------------------


def test_every_producer_file_gets_a_verdict_and_harms_no_other(viky, tmp_path):
    garbage, empty = tmp_path / "garbage.cti", tmp_path / "empty.cti"
    garbage.write_bytes(b"no library" * 100)
    empty.touch()
    files = [str(garbage), str(empty), str(tmp_path / "gone.cti"), viky]
    if crashing := _crashing_cti(tmp_path):
        files.insert(0, str(crashing))
    found = discover(files)
    assert found.serials == ("0", "1", "2")
    verdicts = {Path(v.file).name: v for v in found.producers}
    assert verdicts["viky.cti"].usable
    for name in ("garbage.cti", "empty.cti", "gone.cti"):
        assert not verdicts[name].usable
        assert verdicts[name].message.endswith(".")
        assert verdicts[name].hint
    if crashing:
        assert "crashed" in verdicts["crashing.cti"].message
        assert "SIG" in verdicts["crashing.cti"].message


def _crashing_cti(folder: Path) -> Path | None:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or os.name == "nt":
        return None
    code = folder / "crash.c"
    code.write_text("__attribute__((constructor)) static void f(void) { *(volatile int *)8 = 1; }\n")
    subprocess.run([compiler, "-shared", "-fPIC", str(code), "-o", str(folder / "crashing.cti")], check=True)
    return folder / "crashing.cti"


def test_doubles_are_dropped_by_serial():
    def verdict(file: str, *serials: str) -> ProducerVerdict:
        return ProducerVerdict(file, True, "", "", tuple(CameraInfo(s, "m", "v", file) for s in serials))

    found = together([verdict("one.cti", "7", "3"), verdict("two.cti", "3", "9")])
    assert found.serials == ("3", "7", "9")
    assert [camera.producer for camera in found.cameras] == ["one.cti", "one.cti", "two.cti"]
    assert [(double.serial, double.producer) for double in found.doubles] == [("3", "two.cti")]


def test_files_come_from_the_users_list_and_the_environment_once_each(tmp_path, monkeypatch):
    for name in ("a/x.cti", "b/y.cti", "b/notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.setenv("GENICAM_GENTL64_PATH", os.pathsep.join([str(tmp_path / "b"), str(tmp_path / "a"), "/nowhere"]))
    own = [str(tmp_path / "a"), str(tmp_path / "gone.cti")]
    found = producer_files(own)
    assert found[:3] == tuple(str(tmp_path / n) for n in ("a/x.cti", "gone.cti", "b/y.cti"))
    assert len(set(found)) == len(found)  # those of the environment come after, a/x.cti not again


# --- a producer that is not ours -------------------------------------------------------------------------------------


def test_viky_streams_from_three_devices_and_reports_what_it_lacks(viky):
    with GenicamSource([viky]) as source:
        assert isinstance(source, CameraSource)
        assert source.label == ""
        serials = source.discover().serials
        assert serials == ("0", "1", "2")
        reports = source.open(serials, dict.fromkeys(serials, FREE))
        assert {report.image_size for report in reports} == {(800, 800)}
        assert {"exposure", "gain", "trigger mode", "temperature"} <= set(reports[0].missing)
        assert all(not report.problems for report in reports)
        source.start_live()
        assert _wait(lambda: all(source.latest(s) is not None for s in serials))
        first = source.latest("1")
        assert first is not None
        assert first.image.shape == (800, 800)
        assert not first.image.flags.writeable
        last = source.latest("1")
        assert last is not None and last.frame_id is not None and first.frame_id is not None
        assert last is first or last.frame_id > first.frame_id
        taken = source.capture_set()
        assert taken.complete
        assert taken.spread_s is not None
        assert taken.spread_s < 0.2
        assert all(s.state is CameraState.STREAMING for s in source.statuses().values())
        assert _wait(lambda: source.statuses()["0"].counters.delivered > 5)
        assert not source.indicate("0", False), "viky has no light"


def test_viky_starts_and_stops_a_hundred_times_with_flat_memory(viky):
    with GenicamSource([viky]) as source:
        source.open(source.discover().serials, dict.fromkeys("012", replace(FREE, region=Region(0, 0, 128, 128))))
        sizes = []
        for number in range(100):
            source.start_live()
            source.stop_live()
            if number % 10 == 9:
                source.describe("0")  # waits until all is done
                sizes.append(_resident_mb(source.service_pid))
        source.start_live()
        assert _wait(lambda: all(source.latest(s) is not None for s in "012"))
        assert source.take_events() is not None
    # measured: 0.1 MB a cycle at first (allocator), flat after thirty, on a busy machine after sixty; samples with
    # images still in their buffers are 40 to 130 MB larger, from any cycle on or every other one (3 of 20 runs). A leak
    # sets samples apart, like from like: they were 0.01 to 0.02 MB apart, ten cycles each.
    assert np.median(np.diff(sorted(sizes[3:]))) < 1.0, sizes


def _resident_mb(pid: int | None) -> float:
    if not Path("/proc/self/statm").exists():
        return 0.0
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@POSIX
@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGKILL])
def test_a_crash_is_seen_at_once_and_all_cameras_come_back(viky, number):
    with GenicamSource([viky]) as source:
        source.open(source.discover().serials, dict.fromkeys("012", FREE))
        source.start_live()
        assert _wait(lambda: all(source.latest(s) is not None for s in "012"))
        kept = source.capture_set()
        pixels = kept.frames["0"].image.copy()
        source.take_events()
        pid = source.service_pid
        assert pid is not None
        began = time.perf_counter()
        os.kill(pid, number)
        events = []
        assert _wait(
            lambda: events.extend(source.take_events()) or any(e.kind is EventKind.SERVICE_BACK for e in events)
        )
        lost = next(e for e in events if e.kind is EventKind.SERVICE_LOST)
        back = next(e for e in events if e.kind is EventKind.SERVICE_BACK)
        assert lost.at_s - began < 0.5
        assert number.name in lost.message
        assert back.at_s - began < 3.0 * _patience()
        assert source.service_pid != pid
        assert source.capture_set().complete
        assert np.array_equal(kept.frames["0"].image, pixels)


def _patience() -> float:
    """Times are for an idle machine: more where other work waits for the processors."""
    load = os.getloadavg()[0] / (os.cpu_count() or 1) if hasattr(os, "getloadavg") else 1.0
    return max(1.0, load)


PARENT = """
import os, sys, time
from spherecal_cameras.genicam.genicam_source import GenicamSource
from spherecal_cameras.protocol import CameraSettings

if __name__ == "__main__":
    source = GenicamSource([sys.argv[1]])
    source.open(source.discover().serials, dict.fromkeys("012", CameraSettings(trigger="free")))
    source.start_live()
    while source.latest("2") is None:
        time.sleep(0.01)
    print(source.service_pid, flush=True)
    if sys.argv[2] == "wait":
        time.sleep(60)
"""


def _parent(tmp_path: Path, viky: str, mode: str) -> tuple[subprocess.Popen[str], int]:
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    process = subprocess.Popen(
        [sys.executable, str(script), viky, mode], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert process.stdout is not None
    return process, int(process.stdout.readline())


def _gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except OSError:
        return True


@POSIX
def test_a_killed_program_leaves_no_process_and_no_shared_memory(viky, tmp_path):
    process, child = _parent(tmp_path, viky, "wait")
    assert len(_ours(process.pid)) == 4
    assert not _gone(child)
    process.kill()
    process.wait()
    assert _wait(lambda: _gone(child), 3.0)
    assert _wait(lambda: _ours(process.pid) == [], 3.0)
    assert process.stdout is not None
    process.stdout.close()


@POSIX
def test_a_program_that_forgets_to_close_ends_cleanly(viky, tmp_path):
    process, child = _parent(tmp_path, viky, "leave")
    assert process.wait(10) == 0
    assert _wait(lambda: _gone(child), 3.0)
    assert _ours(process.pid) == []
    assert process.stdout is not None
    process.stdout.close()


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="no /dev/shm")
def test_what_a_killed_cleaner_left_is_removed_by_the_next_program():
    namespace = Path("/proc/self/ns/pid").stat().st_ino
    orphan = Path(f"/dev/shm/spherecal-{namespace}-{2**22 + 1}-dead")  # above the kernel's largest process id
    orphan.write_bytes(b"x")
    ring = Ring(shared_memory_name(), 2, 16, create=True)
    assert remove_orphans() == [orphan.name]
    assert not orphan.exists()
    ring.unlink()


def test_an_overwritten_image_is_never_handed_out():
    ring = Ring(shared_memory_name(), 2, 16, create=True)
    reader = Ring(ring.name, 2, 16, create=False)
    image = np.arange(8, dtype=np.uint16).reshape(2, 4)
    slot, sequence = ring.write(image)
    read = reader.read(slot, sequence, 2, 4, True)
    assert read is not None
    assert np.array_equal(read, image)
    ring.write(image + 1)
    ring.write(image + 2)
    assert reader.read(slot, sequence, 2, 4, True) is None
    reader.close()
    ring.unlink()


def test_no_room_for_images_is_a_plain_error(monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.posix_fallocate", full, raising=False)
    if not hasattr(os, "posix_fallocate") or os.name == "nt":
        pytest.skip("shared memory is not reserved here")
    with pytest.raises(CameraError, match="--shm-size"):
        Ring(shared_memory_name(), 2, 16, create=True)


# --- the simulated producer ------------------------------------------------------------------------------------------


@pytest.fixture
def four(cti):
    with rig([SimulatedCamera(f"SIM{i}", *SMALL) for i in range(4)]) as made:
        assert made.source.capture_set(CaptureRequest(timeout_s=3.0)).complete
        yield made


FAST_FAULTS = [f for f in FAULTS if f.name not in ("power cycle of 1 s", "camera process hangs: SIGSTOP")]


def test_every_fault_is_seen_named_and_recovered_from(four):
    kept = four.source.capture_set()
    pixels = {serial: frame.image.copy() for serial, frame in kept.frames.items()}
    faults = FAST_FAULTS if os.name != "nt" else [f for f in FAST_FAULTS if "SIG" not in f.name]
    for fault in faults:
        outcome = injected(four, fault, "SIM2")
        assert outcome.seen_s is not None, fault.name
        assert outcome.named, fault.name
        assert outcome.recovered_s is not None, fault.name
        four.control.clear_faults()
    assert all(np.array_equal(kept.frames[serial].image, image) for serial, image in pixels.items())
    assert all(s.state.usable for s in four.source.statuses().values())


def test_a_camera_held_elsewhere_is_busy_and_an_address_conflict_is_explained(four):
    for fault, state, word in (
        ("held by another program", CameraState.BUSY, "program"),
        ("address conflict", CameraState.LOST, ""),
    ):
        chosen = next(f for f in FAULTS if f.name == fault)
        chosen.inject(four, "SIM1")
        assert _wait(lambda state=state: four.source.statuses()["SIM1"].state is state)
        assert _wait(lambda word=word: word in four.source.statuses()["SIM1"].cause)
        assert four.source.statuses()["SIM1"].remedy
        others = four.source.capture_set(CaptureRequest(cameras=("SIM0", "SIM2", "SIM3")))
        assert others.complete
        chosen.heal(four, "SIM1")
        assert _wait(lambda: four.source.statuses()["SIM1"].state.usable)
        assert four.source.statuses()["SIM1"].counters.reopened >= 1


@POSIX
def test_a_camera_that_crashes_its_driver_again_and_again_is_left_out(four):
    for _ in range(3):
        four.source.take_events()
        four.control.set("SIM1", crash_count=1)
        events = []
        assert _wait(
            lambda seen=events: (
                seen.extend(four.source.take_events()) or any(e.kind is EventKind.SERVICE_LOST for e in seen)
            )
        )
        lost = next(e for e in events if e.kind is EventKind.SERVICE_LOST)
        assert lost.camera == "SIM1"
        assert "SIGSEGV" in lost.message
        assert _wait(lambda: four.source.statuses()["SIM2"].state.usable)
    assert _wait(lambda: four.source.statuses()["SIM1"].state is CameraState.ERROR)
    assert "left out" in four.source.statuses()["SIM1"].cause
    taken = four.source.capture_set(CaptureRequest(retries=0))
    assert set(taken.frames) == {"SIM0", "SIM2", "SIM3"}
    assert taken.missing[0].camera == "SIM1"
    four.source.open(four.control.serials, dict.fromkeys(four.control.serials, CameraSettings()))
    assert four.source.capture_set().complete


def test_a_cameras_light_is_switched_while_it_streams(four):
    assert four.source.indicate("SIM2", False)
    assert four.control.settings("SIM2")["indicator"] == 1
    assert four.control.settings("SIM1")["indicator"] == 0
    assert four.source.indicate("SIM2", True)
    assert four.control.settings("SIM2")["indicator"] == 0


def test_settings_are_written_anew_after_a_power_cycle(four):
    four.source.apply({"SIM3": CameraSettings(exposure_us=4321.0, gain_db=6.0, pixel_format="Mono12")})
    four.control.power_cycle("SIM3", 0.2)
    assert _wait(lambda: not four.source.statuses()["SIM3"].state.usable)
    assert _wait(lambda: four.source.statuses()["SIM3"].state.usable)
    registers = four.control.settings("SIM3")
    assert registers["exposure_us"] == pytest.approx(4321.0)
    assert registers["gain_db"] == pytest.approx(6.0)
    frame = four.source.capture_set().frames["SIM3"]
    assert (frame.bits, frame.image.dtype) == (12, np.uint16)
    assert frame.exposure_us == pytest.approx(4321.0)


@pytest.mark.parametrize("pixel_format", ["Mono8", "Mono12p", "Mono12Packed", "Mono10p", "BayerRG8"])
def test_images_arrive_pixel_by_pixel_in_every_format_padded_or_not(four, pixel_format):
    rng = np.random.default_rng(5)
    image = rng.integers(0, 256, (SMALL[1], SMALL[0])).astype(np.uint8)
    four.source.stop_live()
    if pixel_format in ("Mono8", "BayerRG8"):
        four.control.set("SIM0", padding_bytes=16)
    four.control.set_image("SIM0", image)
    four.source.apply({"SIM0": CameraSettings(exposure_us=1000.0, pixel_format=pixel_format)})
    frame = four.source.capture_set(CaptureRequest(cameras=("SIM0",))).frames["SIM0"]
    wide = image.astype(np.uint16) << (frame.bits - 8)
    assert frame.pixel_format == pixel_format
    assert np.array_equal(frame.image, wide.astype(frame.image.dtype))
    assert frame.temperature_c == pytest.approx(41.5)


def test_hardware_triggered_sets_are_matched_and_silence_is_named(four):
    serials = four.control.serials
    settings = CameraSettings(exposure_us=1000.0, trigger="hardware")
    four.source.apply(dict.fromkeys(serials, settings))
    four.source.start_live()
    stop = threading.Event()

    def pulses():
        while not stop.wait(0.15):
            four.control.pulse()

    thread = threading.Thread(target=pulses)
    thread.start()
    try:
        taken = four.source.capture_set(CaptureRequest(timeout_s=2.0))
        assert taken.complete
        assert taken.spread_s is not None
        assert taken.spread_s < 0.02
        four.control.set("SIM1", lost_frame_count=1)
        assert four.source.capture_set(CaptureRequest(timeout_s=2.0)).complete  # by the next pulse
    finally:
        stop.set()
        thread.join()
    assert _wait(lambda: all(s.state is CameraState.NO_TRIGGER for s in four.source.statuses().values()))
    status = four.source.statuses()["SIM0"]
    assert "trigger" in status.cause
    assert status.remedy


def test_twelve_cameras_of_five_megapixels_make_a_set(cti):
    with rig(list(simulated_cameras(12))) as big:
        taken = big.source.capture_set(CaptureRequest(timeout_s=5.0))
        assert taken.complete
        assert len(taken.frames) == 12
        assert {frame.image.shape for frame in taken.frames.values()} == {(2048, 2448)}
        again = [big.source.capture_set() for _ in range(3)]
        assert all(one.complete for one in again)
        # every image belongs to its round: ids go up by one with each set
        ids = [[one.frames[s].frame_id for one in (taken, *again)] for s in taken.frames]
        assert all(np.diff(np.array(one, float)).tolist() == [a.attempts for a in again] for one in ids)


# --- commands --------------------------------------------------------------------------------------------------------


def test_list_and_set_on_real_drivers(viky, tmp_path, capsys):
    common = ["--producer", viky, "--profile", str(tmp_path / "p.json")]
    assert main(["cameras", "list", *common]) == 0
    assert "Viky" in capsys.readouterr().out
    assert main(["cameras", "set", "1", *common, "--exposure-us", "500", "--trigger", "free"]) == 0
    said = capsys.readouterr().out
    assert "800 x 800" in said
    assert "not on this camera: exposure" in said
    assert main(["cameras", "show", "5", *common]) == 2
    assert "no camera '5'" in capsys.readouterr().err


def test_end_to_end_over_the_simulated_producer(cti, drawn_session, tmp_path, capsys, monkeypatch):
    """Simulated cameras, capture, calibrate, verify; each set is put on stage by the command line."""
    scene, profile = drawn_session, ["--profile", str(tmp_path / "p.json")]
    log_file = tmp_path / "producer.log"
    # a name of its own keeps it from meeting another simulated rig on this machine
    monkeypatch.setenv("SPHERECAL_GENTL_REGION", f"spherecal-test-{os.getpid()}")
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(cti.parent))
    with log_file.open("w") as log:
        stage = subprocess.Popen(
            [sys.executable, "-m", "spherecal_app.cli.main", "cameras", "simulate-producer", str(scene)],
            stdin=subprocess.PIPE,
            stdout=log,
            stderr=log,
            text=True,
        )
        try:
            assert _wait(lambda: "They see P1" in log_file.read_text(), 60.0), log_file.read_text()
            spherecal = f"{sys.executable} -m spherecal_app.cli.main"
            show = f"{spherecal} cameras simulate-producer {scene} --running --show $SPHERECAL_SET"
            session = tmp_path / "session"
            capsys.readouterr()
            line = [
                "cameras",
                "capture",
                "-o",
                str(session),
                "--plan",
                str(scene / "two.json"),
                "--before-each",
                show,
                *profile,
            ]
            code, said = main(line), capsys.readouterr()
            assert code == 0, said.out + said.err
            assert "SIMULATED" in said.err
        finally:
            assert stage.stdin is not None
            stage.stdin.write("quit\n")
            stage.stdin.close()
            stage.wait(20)
    result = tmp_path / "result"
    assert main(["calibrate", str(session), "-o", str(result)]) == 0
    assert main(["verify", str(session), "--rig", str(result / "rig.json"), "-o", str(result)]) == 0
    assert "CONSISTENT" in capsys.readouterr().out
