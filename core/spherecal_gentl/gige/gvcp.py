"""GigE Vision's control protocol as far as a doctor needs it: search, and single registers."""

import itertools
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

PORT = 3956
CONTROL_REGISTER = 0x0A00  # who has control: 1 exclusive, 2 control
_KEY, _ANSWER_WANTED, _BROADCAST_ANSWER = 0x42, 0x01, 0x10
_SEARCH, _FOUND, _READ, _READ_ANSWER, _WRITE, _WRITE_ANSWER = 0x02, 0x03, 0x80, 0x81, 0x82, 0x83
_FORCE_ADDRESS = 0x04
_HEADER = struct.Struct(">HHHH")
_SEARCH_DATA = 248  # bytes
_AGAIN_S = 0.15
_numbers = itertools.count(1)


@dataclass(frozen=True)
class NetworkCamera:
    """What a camera says of itself; `interface` is the network interface on which it answered."""

    mac: str
    ip_address: str
    mask: str  # of `ip_address`
    maker: str
    model: str
    serial: str
    user_name: str
    interface: str


class Gvcp:
    """Registers of one camera, through a socket of its own."""

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect((address, PORT))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def read(self, register: int, seconds: float) -> int | None:
        """The register's value; None where no answer comes in time."""
        answer = self._ask(_READ, struct.pack(">I", register), _READ_ANSWER, seconds)
        return None if answer is None or len(answer) < 4 else struct.unpack(">I", answer[:4])[0]

    def write(self, register: int, value: int, seconds: float) -> bool:
        """Whether the camera confirmed the new value in time."""
        return self._ask(_WRITE, struct.pack(">II", register, value), _WRITE_ANSWER, seconds) is not None

    def _ask(self, command: int, payload: bytes, wanted: int, seconds: float) -> bytes | None:
        number = next(_numbers) % 65535 + 1
        deadline = time.monotonic() + seconds
        try:
            self._socket.send(_message(command, _ANSWER_WANTED, number, payload))
            while (left := deadline - time.monotonic()) > 0:
                self._socket.settimeout(left)
                data = self._socket.recv(2048)
                if len(data) >= _HEADER.size:
                    status, kind, _, answered = _HEADER.unpack_from(data)
                    if kind == wanted and answered == number:
                        return data[_HEADER.size :] if status == 0 else None
        except OSError:  # no route, refused, or no answer
            time.sleep(max(0.0, min(0.05, deadline - time.monotonic())))
        return None


def search(interface: str, seconds: float = 0.7, address: str = "") -> list[NetworkCamera]:
    """Cameras of any subnet that answer to a broadcast on an interface, sorted by serial number and address."""
    found: dict[tuple[str, str], NetworkCamera] = {}
    with _broadcasting(interface, address) as asking:
        begun, asked = time.monotonic(), 0
        while (passed := time.monotonic() - begun) < seconds:
            if passed >= asked * _AGAIN_S and asked < 3:
                flags = _ANSWER_WANTED | _BROADCAST_ANSWER
                asking.sendto(_message(_SEARCH, flags, asked + 1, b""), ("255.255.255.255", PORT))
                asked += 1
            asking.settimeout(0.05)
            try:
                data = asking.recv(2048)
            except TimeoutError:
                continue
            if (camera := _understood(interface, data)) is not None:
                found[camera.mac, camera.ip_address] = camera
    return sorted(found.values(), key=lambda camera: (camera.serial, camera.ip_address))


def force_address(interface: str, mac: str, ip: str, mask: str, gateway: str, address: str) -> None:
    """Have the camera of a hardware address take an IP address until its next start (FORCEIP); nobody controls it."""
    words = (socket.inet_aton(one) for one in (ip, mask, gateway))
    payload = struct.pack(">2x6s12x4s12x4s12x4s", bytes.fromhex(mac.replace(":", "")), *words)
    message = _message(_FORCE_ADDRESS, _BROADCAST_ANSWER, next(_numbers) % 65535 + 1, payload)
    with _broadcasting(interface, address) as asking:
        asking.sendto(message, ("255.255.255.255", PORT))


@contextmanager
def _broadcasting(interface: str, address: str) -> Iterator[socket.socket]:
    """A socket that sends to everybody on one interface."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        asking.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        bind_to_device = getattr(socket, "SO_BINDTODEVICE", None)
        if bind_to_device is not None:
            asking.setsockopt(socket.SOL_SOCKET, bind_to_device, interface.encode())
        else:
            asking.bind((address, 0))
        yield asking


def _understood(interface: str, data: bytes) -> NetworkCamera | None:
    if len(data) < _HEADER.size + _SEARCH_DATA or _HEADER.unpack_from(data)[:2] != (0, _FOUND):
        return None
    body = data[_HEADER.size :]
    maker, model, serial, user = (_text(body, *at) for at in ((0x48, 32), (0x68, 32), (0xD8, 16), (0xE8, 16)))
    address, mask = (socket.inet_ntoa(body[at : at + 4]) for at in (0x24, 0x34))
    return NetworkCamera(body[10:16].hex(":"), address, mask, maker, model, serial, user, interface)


def _text(body: bytes, start: int, size: int) -> str:
    text = body[start : start + size].split(b"\0")[0].decode("utf-8", "replace")
    return "".join(c if c.isprintable() else "?" for c in text)


def _message(command: int, flags: int, number: int, payload: bytes) -> bytes:
    return struct.pack(">BBHHH", _KEY, flags, command, len(payload), number) + payload
