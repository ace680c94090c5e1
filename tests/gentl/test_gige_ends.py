"""How a simulated GigE rig ends: by its command, by Ctrl-C, by SIGKILL, and a client that is sent malformed packets."""

import json
import os
import re
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchmarks.gige_fuzz import PAYLOAD, TRAILER, Wire
from spherecal_app.cli.exit_codes import BAD_INPUT, CANCELLED
from spherecal_app.cli.main import main
from spherecal_gentl.gige.namespaces import why_not
from tests.gige_rig import aravis_producer, wired

SPHERECAL = [sys.executable, "-m", "spherecal_app.cli.main"]
LIMIT_S = 60.0


@pytest.fixture(name="session", scope="module")
def session_of_a_rig(drawn_session: Path) -> Path:
    """A rig's session with images; skips where no GigE rig can be."""
    aravis_producer()
    if (reason := why_not()) is not None:
        pytest.skip(f"no network namespaces: {reason}")
    return drawn_session


@contextmanager
def rig_with(session: Path, command: str) -> Iterator[subprocess.Popen[str]]:
    """A rig that runs a command; a test that fails ends it."""
    words = [*SPHERECAL, "cameras", "simulate-gige", str(session), "--cameras", "1", "--run", command]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, start_new_session=True) as program:
        try:
            yield program
        finally:
            program.kill()


def first_line(program: subprocess.Popen[str]) -> str:
    assert program.stdout is not None
    return program.stdout.readline().strip()


def of_network(number: str) -> list[int]:
    """The processes in a network namespace."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if os.readlink(process / "ns/net") == number:
                found.append(int(process.name))
        except OSError:  # it has ended
            continue
    return found


def gone(number: str) -> bool:
    until = time.monotonic() + 10.0
    while time.monotonic() < until:
        if not of_network(number):
            return True
        time.sleep(0.02)
    return False


@pytest.mark.parametrize("count", ["0", "-1", "13"])
def test_impossible_numbers_of_cameras_are_refused(count: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cameras", "simulate-gige", "demo", "--cameras", count, "--run", "true"]) == BAD_INPUT
    assert re.search(rf"--cameras {count}: 1 to 12 cameras", capsys.readouterr().err)


def test_the_exit_code_is_the_commands(session: Path) -> None:
    with rig_with(session, "exit 7") as program:
        assert program.wait(LIMIT_S) == 7


def test_as_json_it_tells_where_the_cameras_are(session: Path) -> None:
    words = [*SPHERECAL, "cameras", "simulate-gige", str(session), "--cameras", "1", "--json"]
    done = subprocess.run(words, input="quit\n", capture_output=True, text=True, check=True, timeout=LIMIT_S)
    document = json.loads(done.stdout)
    assert set(document) == {"cameras", "scene", "scenes", "producers"}
    assert len(document["cameras"]) == 1 and document["scene"] == document["scenes"][0]


def test_after_ctrl_c_the_command_ends_in_its_own_way(session: Path) -> None:
    with rig_with(session, "trap 'exit 5' INT; readlink /proc/self/ns/net; while :; do sleep 0.1; done") as program:
        network = first_line(program)
        os.killpg(program.pid, signal.SIGINT)  # as a terminal does
        assert program.wait(LIMIT_S) == 5
    assert gone(network)


def test_after_ctrl_c_a_command_that_does_not_end_is_ended(session: Path) -> None:
    with rig_with(session, "trap '' INT; readlink /proc/self/ns/net; sleep 300") as program:
        network = first_line(program)
        program.send_signal(signal.SIGINT)
        assert program.wait(LIMIT_S) == CANCELLED
    assert gone(network)


def test_killed_outright_it_leaves_no_command_and_no_namespace(session: Path) -> None:
    """Also what the command has started and forgotten."""
    command = "(trap '' INT HUP TERM; setsid sleep 300) & readlink /proc/self/ns/net; sleep 300"
    with rig_with(session, command) as program:
        network = first_line(program)
        assert of_network(network)
        program.kill()
        program.wait()
        assert gone(network)


CLIENT = """
import os, sys, time
from spherecal_cameras.genicam.genicam_source import GenicamSource
from spherecal_cameras.protocol import CameraSettings
from tests.gige_rig import wired
with wired(1) as rig, GenicamSource() as source:
    serials = source.discover().serials
    source.open(serials, dict.fromkeys(serials, CameraSettings(exposure_us=1000.0)))
    source.start_live(5.0)
    source.capture_set()
    print(os.readlink("/proc/thread-self/ns/net"), flush=True)
    time.sleep(300)
"""


def test_a_client_that_is_killed_while_images_come_leaves_nothing() -> None:
    producer = aravis_producer()
    if os.geteuid() != 0 or why_not() is not None:
        pytest.skip("only root enters another network namespace from a running program")
    environment = os.environ | {"GENICAM_GENTL64_PATH": str(producer.parent)}
    with subprocess.Popen([sys.executable, "-c", CLIENT], stdout=subprocess.PIPE, text=True, env=environment) as client:
        network = first_line(client)
        assert len(of_network(network)) >= 1
        client.kill()
        client.wait()
        assert gone(network)


def test_control_seized_twice_is_released_at_once() -> None:
    with wired(1) as rig:

        def held() -> list[int]:
            return [len(os.listdir(f"/proc/{rig.pid}/{kind}")) for kind in ("task", "fd")]

        before = held()
        for _ in range(2):
            rig.fault("seize", "GE01")
        rig.fault("release", "GE01")
        until = time.monotonic() + 10.0
        while held() != before and time.monotonic() < until:  # a thread that was joined is listed a little longer
            time.sleep(0.02)
        assert held() == before


def test_packets_beyond_the_buffer_do_not_reach_libaravis() -> None:
    """A frame that begins with a far trailer, then a pixel packet near it: a copy of a negative size in libaravis."""
    producer = aravis_producer()
    with wired(1) as rig:
        words = [sys.executable, "-m", "benchmarks.gige_client", str(producer), "3", "25"]
        client = subprocess.Popen(rig.inside(words), stdout=subprocess.PIPE, text=True)
        wire, sent = Wire(rig), 0
        try:
            while client.poll() is None:
                if (heard := wire.heard(0.2)) is None or heard[2][4] != PAYLOAD:
                    continue
                addresses, ports, data = heard
                (frame,) = struct.unpack_from(">H", data, 2)
                for kind, number, size in ((TRAILER, 0xFFF0, 8), (PAYLOAD, 0x8000, 1000)):
                    head = struct.pack(">HHBBH", 0, (frame + 1) % 65536, kind, 0, number)
                    wire.say(addresses, ports, head + bytes(size))
                    sent += 1
        finally:
            wire.close()
            client.kill()
        assert client.returncode == 0
        assert client.stdout is not None
        found = json.loads(client.stdout.read())
        client.stdout.close()
    assert sent > 20
    assert found["frames"][0] > 5
