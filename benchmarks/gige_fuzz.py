"""Malformed GigE Vision packets to a client: `python -m benchmarks.gige_fuzz [MINUTES [SEED]]`.

What the simulated cameras send is listened to on the client's computer, changed, and sent once more from a second
computer under the camera's address: answers to questions (GVCP) and images (GVSP). The client is gentl_walk, the Aravis
producer under address and undefined sanitizers; between the bursts the wire is clean, and whole images must come again.
"""

import random
import select
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.gige_sanitized import built
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
from spherecal_gentl.gige.gvcp import search

MINUTES, SEED = 10.0, 24
BURST_S, LIMIT_S = 15.0, 60.0
_CAMERAS, _SIZE = 3, (320, 240)
_CONTROL, _ETHERNET, _IP, _UDP = 3956, 14, 20, 8
_HEAD = struct.Struct(">HHBBH")  # of GVSP: status, frame, kind, high and low part of the packet's number
LEADER, TRAILER, PAYLOAD = 1, 2, 3
_EDGES = (0, 1, 2, 7, 8, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
_LARGEST = 1472  # bytes that one packet on this network carries
_PER_S = 3000


@dataclass
class Fuzzed:
    """Packets sent by kind, walks, whole frames while and after bursts, clean spells without one, crashes."""

    minutes: float = 0.0
    sent: Counter[str] = field(default_factory=Counter)
    searches: int = 0
    frames_fuzzed: int = 0
    next_s: list[float] = field(default_factory=list)  # from the end of a burst to the next whole image
    spells: int = 0
    spells_without: int = 0
    crashes: list[str] = field(default_factory=list)


class Malformed:
    """Packets like those that were heard, changed; (kind, payload)."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)

    def from_control(self, data: bytes) -> Iterator[tuple[str, bytes]]:
        """From an answer to a question."""
        pick = self._random
        status, kind, _, number = struct.unpack_from(">HHHH", data)
        body = data[8:]
        yield "control: truncated", data[: pick.randrange(len(data))]
        yield "control: wrong id", struct.pack(">HHHH", status, kind, len(body), pick.choice(_EDGES) & 0xFFFF) + body
        yield (
            "control: answer before the question",
            struct.pack(">HHHH", 0, kind, len(body), (number + 1) % 65536) + body,
        )
        yield (
            "control: wrong size",
            struct.pack(">HHHH", 0, kind, pick.choice(_EDGES) & 0xFFFF, number + 1 & 0xFFFF) + body,
        )
        cut = body[: pick.randrange(len(body) + 1)]
        yield "control: body shorter than its size", struct.pack(">HHHH", 0, kind, len(body), number + 1 & 0xFFFF) + cut
        yield (
            "control: body longer",
            struct.pack(">HHHH", 0, kind, len(body), number + 1 & 0xFFFF) + pick.randbytes(1400),
        )
        yield "control: pending", struct.pack(">HHHHHH", 0, 0x89, 4, number + 1 & 0xFFFF, 0, pick.randrange(200))
        yield "control: error", struct.pack(">HHHH", 0x8000 | pick.randrange(32), kind, 0, number + 1 & 0xFFFF)
        yield "control: to nobody", struct.pack(">HHHH", 0, pick.randrange(65536), 0, pick.randrange(65536))
        yield "control: random", pick.randbytes(pick.randrange(_LARGEST))

    def from_stream(self, data: bytes) -> Iterator[tuple[str, bytes]]:
        """From a packet of an image."""
        pick = self._random
        _, frame, kind, high, low = _HEAD.unpack_from(data)
        body = data[_HEAD.size :]

        def packet(kind: int, number: int, body: bytes, frame: int = frame, status: int = 0) -> bytes:
            return _HEAD.pack(status, frame & 0xFFFF, kind & 0xFF, number >> 16 & 0xFF, number & 0xFFFF) + body

        ahead = frame + pick.randrange(1, 3)
        yield "stream: truncated", data[: pick.randrange(len(data))]
        yield "stream: number beyond the frame", packet(PAYLOAD, pick.choice(_EDGES) & 0xFFFFFF, body)
        yield "stream: wrong frame", packet(kind, high << 16 | low, body, frame=pick.choice(_EDGES))
        yield "stream: payload too short", packet(PAYLOAD, low, body[: pick.randrange(len(body) + 1)])
        yield "stream: payload too long", packet(PAYLOAD, low, pick.randbytes(_LARGEST - 8))
        yield "stream: frame ahead", packet(PAYLOAD, pick.randrange(1, 60), body, frame=ahead)
        yield "stream: trailer ahead", packet(TRAILER, pick.choice(_EDGES) & 0xFFFFFF, pick.randbytes(8), frame=ahead)
        yield "stream: error status", packet(kind, low, b"", status=0x8000 | pick.randrange(32))
        yield "stream: unknown kind", packet(pick.randrange(4, 128), low, body)
        yield "stream: long ids", struct.pack(">HHIQII", 0, 0, 0x80000000 | kind << 24, ahead, 0, low) + body
        yield "stream: random", pick.randbytes(pick.randrange(_LARGEST))
        # leaders: payload type, time stamp, pixel format, width, height, offsets, paddings
        edge = [pick.choice(_EDGES) for _ in range(4)]
        image = struct.pack(">IIIIII", pick.choice(_EDGES), edge[0], edge[1], edge[2], edge[3], 0)
        yield "stream: oversized leader", packet(LEADER, 0, struct.pack(">HHQ", 0, 1, 0) + image, frame=ahead)
        kind = pick.choice(_EDGES) & 0xFFFF
        yield "stream: wrong payload type", packet(LEADER, 0, struct.pack(">HHQ", 0, kind, 0) + image, frame=ahead)
        yield (
            "stream: parts",
            packet(LEADER, 0, struct.pack(">HHQ", 0, 0x0A, 0) + pick.randbytes(pick.randrange(200)), frame=ahead),
        )
        yield (
            "stream: payload of a part",
            packet(5, pick.randrange(60), pick.randbytes(pick.randrange(60)), frame=ahead),
        )


class Wire:
    """What the cameras send to the client is heard; packets are sent under their addresses."""

    def __init__(self, rig: GigeRig) -> None:
        with rig.entered():
            self._ear = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x0800))
            self._ear.bind(("eth0", 0))
        with rig.entered("second"):
            self._mouth = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW)
        self._cameras = {socket.inet_aton(address) for address in rig.addresses.values()}

    def close(self) -> None:
        """Give the sockets back."""
        self._ear.close()
        self._mouth.close()

    def heard(self, seconds: float) -> tuple[bytes, bytes, bytes] | None:
        """Addresses, ports and payload of a camera's packet; None where none comes in this time."""
        if not select.select([self._ear], [], [], seconds)[0]:
            return None
        data = self._ear.recv(65535)
        at = _ETHERNET + _IP
        if len(data) < at + _UDP + 8 or data[_ETHERNET + 9] != socket.IPPROTO_UDP:
            return None
        if data[_ETHERNET + 12 : _ETHERNET + 16] not in self._cameras:
            return None
        (size,) = struct.unpack_from(">H", data, at + 4)
        return data[_ETHERNET + 12 : at], data[at : at + 4], data[at + _UDP : at + size]

    def say(self, addresses: bytes, ports: bytes, payload: bytes) -> None:
        """A packet from a camera's address and port to the client's."""
        head = struct.pack(">BBHHHBBH", 0x45, 0, _IP + _UDP + len(payload), 0, 0, 64, socket.IPPROTO_UDP, 0) + addresses
        packet = head + ports + struct.pack(">HH", _UDP + len(payload), 0) + payload
        with suppress(OSError):  # its queue is full
            self._mouth.sendto(packet, (socket.inet_ntoa(addresses[4:]), 0))


def burst(wire: Wire, malformed: Malformed, seconds: float, sent: Counter[str]) -> None:
    """Every packet heard is followed by one of each kind, as long as there is time."""
    until, begun, count = time.monotonic() + seconds, time.monotonic(), 0
    while time.monotonic() < until:
        if (got := wire.heard(0.2)) is None:
            continue
        addresses, ports, data = got
        control = ports[:2] == struct.pack(">H", _CONTROL)
        kinds = malformed.from_control(data) if control else malformed.from_stream(data)
        for kind, payload in kinds:
            wire.say(addresses, ports, payload)
            sent[kind] += 1
            count += 1
        time.sleep(max(0.0, count / _PER_S - (time.monotonic() - begun)))


def fuzzed(minutes: float = MINUTES, seed: int = SEED, sanitizers: str = "address,undefined") -> Fuzzed:
    """Bursts and clean spells in turn for so many minutes; the client starts again where it has ended."""
    found = Fuzzed()
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="spherecal-")))
        program, environment = built(sanitizers, scratch)
        rig = stack.enter_context(GigeRig([GigeCamera(f"GE{i + 1:02d}", *_SIZE) for i in range(_CAMERAS)]))
        wire, malformed = Wire(rig), Malformed(seed)
        stack.callback(wire.close)
        said, complaints = scratch / "said", scratch / "complaints"
        walk: subprocess.Popen | None = None
        begun = time.monotonic()
        while time.monotonic() - begun < minutes * 60:
            if walk is None or walk.poll() is not None:
                _judge(walk, complaints, found)
                with said.open("w") as out, complaints.open("w") as err:
                    words = rig.inside([str(program), "100000", "40"])
                    walk = subprocess.Popen(words, env=environment, stdout=out, stderr=err)
                time.sleep(2.0)
            before = _whole(said)
            burst(wire, malformed, BURST_S, found.sent)
            middle = _whole(said)
            with rig.entered():
                search("eth0", 0.2)  # the doctor's own, just after a burst
            found.searches += 1
            cleaned = time.monotonic()
            after = middle
            while after == middle and time.monotonic() - cleaned < LIMIT_S and walk.poll() is None:
                time.sleep(0.1)
                after = _whole(said)
            found.next_s.append(time.monotonic() - cleaned)
            found.spells += 1
            found.frames_fuzzed += middle - before
            found.spells_without += after == middle and walk.poll() is None
        if walk is not None:
            _judge(walk, complaints, found)
        found.minutes = (time.monotonic() - begun) / 60
    return found


def _whole(said: Path) -> int:
    lines = said.read_text().split("\n")[:-1]
    if not lines:
        return 0
    words = lines[-1].split()
    return int(words[1]) - int(words[3])


def _judge(walk: subprocess.Popen | None, complaints: Path, found: Fuzzed) -> None:
    if walk is None:
        return
    text = complaints.read_text(errors="replace")
    if walk.poll() is None:
        walk.kill()
        walk.wait()
        if not text.strip():
            return
    Path(tempfile.gettempdir(), f"gige_fuzz_{len(found.crashes)}.txt").write_text(text)
    lines = [
        line for line in text.splitlines() if "ERROR" in line or "runtime error" in line or line.startswith("    #")
    ]
    found.crashes.append(f"exit code {walk.returncode}: " + " / ".join(line.strip() for line in lines[:6]))


def main() -> int:
    """Fuzz, and say what came of it; 1 where something crashed or no image came afterwards."""
    words = sys.argv[1:]
    found = fuzzed(float(words[0]) if words else MINUTES, int(words[1]) if len(words) > 1 else SEED)
    for kind, count in sorted(found.sent.items()):
        print(f"{count:8d}  {kind}")
    packets = sum(found.sent.values())
    print(f"{found.minutes:.1f} minutes, {packets} packets; whole images: {found.frames_fuzzed} during bursts,")
    print(f"the next at most {max(found.next_s):.1f} s after; {found.spells_without} of {found.spells} times none;")
    print(f"crashes: {len(found.crashes)}")
    for crash in found.crashes:
        print(crash)
    return int(bool(found.crashes or found.spells_without))


if __name__ == "__main__":
    sys.exit(main())
