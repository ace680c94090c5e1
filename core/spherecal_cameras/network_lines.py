"""GigE lines and USB buses: who shares one, what is wanted of it, and delays with which it is shared."""

import ctypes
import ipaddress
import os
import socket
import struct
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from spherecal.data.findings import Finding
from spherecal_cameras.protocol import CameraSettings, CameraSource, Discovery, FeatureReport, features_of
from spherecal_gentl.gige.gvcp import NetworkCamera, search

_DEVICES, _NODES = Path("/sys/bus/usb/devices"), Path("/dev/bus/usb")
_CLASS, _SUBCLASS = "ef", "05"  # of a USB3 Vision interface
_USB3_MBIT_S = 5000.0


@dataclass(frozen=True)
class UsbCamera:
    """A USB3 Vision camera as its plug names it; cameras of one `bus` share what it carries."""

    maker: str
    model: str
    serial: str
    mbit_s: float | None  # of its bus: below 5000 on a USB 2 port or cable; None: not known
    allowed: bool  # this user may open it, else a udev rule is missing
    bus: str = ""

    @property
    def slow(self) -> bool:
        """Whether it hangs on less than USB 3."""
        return self.mbit_s is not None and self.mbit_s < _USB3_MBIT_S


def usb_cameras(devices: Path = _DEVICES, nodes: Path = _NODES) -> tuple[UsbCamera, ...]:
    """Every USB3 Vision camera on the bus, sorted by maker, model and serial number."""
    vision = {
        interface.parent / interface.name.partition(":")[0]
        for interface in devices.glob("*:*")
        if (_said(interface, "bInterfaceClass"), _said(interface, "bInterfaceSubClass")) == (_CLASS, _SUBCLASS)
    }
    found = [_camera(device, nodes) for device in vision if device.is_dir()]
    return tuple(sorted(found, key=lambda one: (one.maker, one.model, one.serial)))


def _camera(device: Path, nodes: Path) -> UsbCamera:
    speed = None
    with suppress(ValueError):
        speed = float(_said(device, "speed"))
    node = nodes / _said(device, "busnum").zfill(3) / _said(device, "devnum").zfill(3)
    return UsbCamera(
        _said(device, "manufacturer"), _said(device, "product"), _said(device, "serial"), speed,
        os.access(node, os.R_OK | os.W_OK), _said(device, "busnum"),
    )  # fmt: skip


def _said(folder: Path, name: str) -> str:
    try:
        text = (folder / name).read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
    return "".join(c if c.isprintable() else "?" for c in text)


# Ethernet, IP, UDP and GVSP around the pixels of a packet, preamble and gap included; the packet size of a camera has
# IP, UDP and GVSP in it.
_IN_PACKET, _ON_WIRE = 36, 38
_USABLE = 0.9  # of a line: registers, resent packets and clocks that differ need the rest
_JUMBO, _PLAIN = 9000, 1500
# A frame in the receive buffer while this computer does something else: 10 ms of a full line of 1 Gbit/s is 1.25 MB.
_LEAST_BUFFER, _WANTED_BUFFER = 2_000_000, 33_554_432
_TICK_HZ = 1_000_000_000
_GET_ADDRESS, _GET_MASK, _GET_MTU, _ETHTOOL = 0x8915, 0x891B, 0x8921, 0x8946  # SIOCGIFADDR and so on
_LINK_SETTINGS = struct.pack("I40x", 1)  # of ethtool: ETHTOOL_GSET
_SETTINGS = Path("/proc/sys/net")


_SHARES = ("packet_delay", "frame_delay", "throughput_bytes_s")
# Of a USB 3 bus of 5 Gbit/s: makers of cameras name 350 to 380 MB/s for all cameras together.
_USB_BYTES_OF_BIT = 360e6 / 5e9


@dataclass(frozen=True)
class NetworkLine:
    """A network interface: Mbit/s (None: not said), reverse path filter (0 to 2), largest receive buffer, bytes."""

    interface: str
    address: str
    mask: str
    mtu: int
    mbit_s: float | None
    reverse_path_filter: int
    receive_buffer_bytes: int


@dataclass(frozen=True)
class CameraLoad:
    """What a camera is to send: image bytes, images/s, packet bytes, ticks/s; and features that can slow it."""

    image_bytes: int
    rate_hz: float
    packet_size: int = _PLAIN
    tick_hz: int = _TICK_HZ
    controls: frozenset[str] = frozenset({"packet delay", "frame delay"})


_CONTROLS = ("packet delay", "frame delay", "throughput limit")
_NO_LOAD = CameraLoad(0, 0.0, controls=frozenset())


@dataclass(frozen=True)
class Stagger:
    """How a camera shares a line: delays after packets and before a frame, in ticks, or bytes/s; None: not needed."""

    serial: str
    packet_delay: int | None = None
    frame_delay: int | None = None
    throughput_bytes_s: int | None = None

    def of(self, settings: CameraSettings) -> CameraSettings:
        """Settings with this share in them, and no other."""
        share = (self.packet_delay, self.frame_delay, self.throughput_bytes_s)
        return replace(settings, **dict(zip(_SHARES, share, strict=True)))


@dataclass(frozen=True)
class LineExamination:
    """One line with its cameras: bytes/s wanted and carried (None: not known), proposed delays, what is wrong."""

    line: NetworkLine
    cameras: tuple[NetworkCamera, ...]
    wanted_bytes_s: float
    carried_bytes_s: float | None
    staggers: tuple[Stagger, ...]
    findings: tuple[Finding, ...]


def load_of(features: Sequence[FeatureReport], rate_hz: float) -> CameraLoad | None:
    """What a camera is to send, from its features; None where they do not say its size."""
    reported = {feature.feature: feature.got for feature in features}
    try:
        pixels = int(reported["width"]) * int(reported["height"])
        packet, ticks = (int(float(reported.get(name) or 0)) for name in ("packet size", "time stamp rate"))
    except (KeyError, ValueError):
        return None
    pixel_format = reported.get("pixel format", "")
    deep = any(bits in pixel_format for bits in ("10", "12", "14", "16"))
    packed = pixel_format.endswith(("p", "Packed"))
    bytes_each = 1.0 if not deep else 1.5 if packed else 2.0
    controls = frozenset(one.feature for one in features if one.node is not None and one.feature in _CONTROLS)
    return CameraLoad(round(pixels * bytes_each), rate_hz, packet or _PLAIN, ticks or _TICK_HZ, controls)


def loads_of(source: CameraSource, discovery: Discovery, rate_hz: float, transports: str) -> dict[str, CameraLoad]:
    """What the open cameras of a transport are to send, by serial number; none of cameras that are not real."""
    if source.kind != "genicam":
        return {}
    serials = [info.serial for info in discovery.cameras if info.transport in transports.split()]
    loads = {serial: load_of(features_of(source, serial), rate_hz) for serial in serials}
    return {serial: load for serial, load in loads.items() if load is not None}


def examined(source: CameraSource, discovery: Discovery, rate_hz: float) -> tuple[LineExamination, ...]:
    """The lines of the GigE cameras that a source has open; none where there are no such cameras."""
    loads = loads_of(source, discovery, rate_hz, "GEV GigEVision")
    return examine_lines(loads) if loads else ()


def shares(source: CameraSource, discovery: Discovery, lines: Sequence[LineExamination]) -> tuple[Stagger, ...]:
    """How the open cameras of a source share their lines, GigE's and USB's; `Stagger.of` puts it into settings."""
    usb = loads_of(source, discovery, 1.0, "U3V USB3Vision")
    return (*(one for line in lines for one in line.staggers), *(bus_shares(usb, usb_cameras()) if usb else ()))


def bus_shares(loads: Mapping[str, CameraLoad], cameras: Sequence[UsbCamera]) -> tuple[Stagger, ...]:
    """Limits with which USB3 Vision cameras share a bus; of those that can be limited, and are on the bus by serial."""
    by_bus: dict[str, list[UsbCamera]] = {}
    for camera in cameras:
        by_bus.setdefault(camera.bus, []).append(camera)
    return tuple(
        Stagger(camera.serial, throughput_bytes_s=round(camera.mbit_s * 1e6 * _USB_BYTES_OF_BIT / len(together)))
        for together in by_bus.values()
        for camera in together
        if len(together) > 1 and camera.mbit_s and "throughput limit" in loads.get(camera.serial, _NO_LOAD).controls
    )


def examine_lines(loads: Mapping[str, CameraLoad]) -> tuple[LineExamination, ...]:
    """Every line on which a camera answers; `loads` by serial number. Empty where the system is not Linux."""
    return tuple(assess(line, cameras, loads) for line in network_lines() if (cameras := _answering(line.interface)))


def _answering(interface: str) -> tuple[NetworkCamera, ...]:
    try:
        return tuple(search(interface))
    except OSError:  # down, or without an address
        return ()


def network_lines() -> tuple[NetworkLine, ...]:
    """The network interfaces with an IPv4 address, without the loopback."""
    if not sys.platform.startswith("linux"):
        return ()
    found = []
    for _, name in socket.if_nameindex():
        raw_address, raw_mask, mtu = (_asked(name, what) for what in (_GET_ADDRESS, _GET_MASK, _GET_MTU))
        if raw_address is None or raw_mask is None or mtu is None:  # no IPv4 address
            continue
        address, mask = (socket.inet_ntoa(raw[20:24]) for raw in (raw_address, raw_mask))
        if ipaddress.ip_address(address).is_loopback:
            continue
        filters = [_number(_SETTINGS / "ipv4/conf" / where / "rp_filter") or 0 for where in ("all", name)]
        found.append(
            NetworkLine(
                name,
                address,
                mask,
                struct.unpack_from("i", mtu, 16)[0],
                _speed_mbit_s(name),
                max(filters),
                _number(_SETTINGS / "core/rmem_max") or 0,
            )
        )
    return tuple(found)


def network_of(line: NetworkLine) -> ipaddress.IPv4Network:
    """The network that an interface is in."""
    return ipaddress.IPv4Interface(f"{line.address}/{line.mask}").network


def _asked(name: str, request: int, data: bytes = b"") -> bytes | None:
    """The system's answer about an interface; None where it has none."""
    import fcntl

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        try:
            return fcntl.ioctl(any_socket.fileno(), request, struct.pack("16s240s", name.encode()[:15], data))
        except OSError:
            return None


def _speed_mbit_s(name: str) -> float | None:
    settings = ctypes.create_string_buffer(_LINK_SETTINGS, len(_LINK_SETTINGS))
    if _asked(name, _ETHTOOL, struct.pack("P", ctypes.addressof(settings))) is None:
        return None
    low, high = (struct.unpack_from("H", settings.raw, at)[0] for at in (12, 28))
    speed = high << 16 | low
    return None if speed in (0, 0xFFFF, 0xFFFFFFFF) else float(speed)  # without a cable it is unknown


def _number(file: Path) -> int | None:
    try:
        return int(file.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def assess(line: NetworkLine, cameras: Sequence[NetworkCamera], loads: Mapping[str, CameraLoad]) -> LineExamination:
    """One line with the cameras that answered on it: its load, proposed delays and what is wrong."""
    sending = {camera.serial: loads[camera.serial] for camera in cameras if camera.serial in loads}
    wanted = sum(wire_bytes(load) * load.rate_hz for load in sending.values())
    carried = None if line.mbit_s is None else line.mbit_s * 1e6 / 8
    findings = (*_addresses(line, cameras), *_packets(line, sending), *_buffer(line, sending))
    if carried is not None and wanted > _USABLE * carried:
        values = {
            "interface": line.interface,
            "wanted_mbit": wanted * 8e-6,
            "line_mbit": line.mbit_s,
            "rate_hz": _USABLE * carried / sum(wire_bytes(load) for load in sending.values()),
        }
        findings = (*findings, Finding("line-too-thin", "warning", values, tuple(sending)))
    delays = stagger(sending, line.mbit_s) if line.mbit_s is not None and len(sending) > 1 else ()
    return LineExamination(line, tuple(cameras), wanted, carried, delays, findings)


def wire_bytes(load: CameraLoad) -> int:
    """Bytes on the wire for one image: pixels and everything around them; leader and trailer are two more packets."""
    pixels = load.packet_size - _IN_PACKET
    return load.image_bytes + (-(-load.image_bytes // pixels) + 2) * (_IN_PACKET + _ON_WIRE)


def stagger(loads: Mapping[str, CameraLoad], mbit_s: float) -> tuple[Stagger, ...]:
    """Delays (GevSCPD, GevSCFTD) or limits with which these cameras, triggered together, share a line.

    Each leaves room for one packet of every other after its own, so that no switch keeps more than one of each; a tenth
    of the line stays free. Who has no packet delay is limited to its part; who has neither is left out.
    """
    packet_s = max((load.packet_size + _ON_WIRE) * 8 / (mbit_s * 1e6 * _USABLE) for load in loads.values())
    share = round(mbit_s * 1e6 / 8 * _USABLE / len(loads))
    found = []
    for place, (serial, load) in enumerate(loads.items()):
        if "packet delay" in load.controls:
            before = round(place * packet_s * load.tick_hz) if "frame delay" in load.controls else None
            found.append(Stagger(serial, round((len(loads) - 1) * packet_s * load.tick_hz), before))
        elif "throughput limit" in load.controls:
            found.append(Stagger(serial, throughput_bytes_s=share))
    return tuple(found)


def _addresses(line: NetworkLine, cameras: Sequence[NetworkCamera]) -> list[Finding]:
    network = network_of(line)
    found = []
    held = Counter(camera.ip_address for camera in cameras)
    for address in [*[a for a, times in held.items() if times > 1], *({line.address} & set(held))]:
        who = tuple(camera.serial for camera in cameras if camera.ip_address == address)
        found.append(Finding("same-address", "error", {"address": address}, who))
    for camera in cameras:
        if ipaddress.ip_address(camera.ip_address) in network:
            continue
        beside = free_beside(camera)
        values = {
            "address": camera.ip_address,
            "interface": line.interface,
            "network": str(network),
            "command": f"sudo ip address add {beside} dev {line.interface}",
        }
        found.append(Finding("other-subnet", "error", values, (camera.serial,)))
        if line.reverse_path_filter == 1:
            command = f"sudo sysctl net.ipv4.conf.all.rp_filter=2 net.ipv4.conf.{line.interface}.rp_filter=2"
            values = {"interface": line.interface, "command": command}
            found.append(Finding("reverse-path-filter", "warning", values, (camera.serial,)))
    return found


# A camera's network that leaves room for this computer, and is one.
_WIDEST, _NARROWEST = 8, 29


def free_beside(camera: NetworkCamera) -> str:
    """An address for this computer in the camera's network, with its prefix length, such as 192.168.7.254/24."""
    try:
        network = ipaddress.ip_interface(f"{camera.ip_address}/{camera.mask}").network
    except ValueError:  # the camera's own word, which may be anything
        network = ipaddress.ip_interface(f"{camera.ip_address}/24").network
    if not _WIDEST <= network.prefixlen <= _NARROWEST:
        network = ipaddress.ip_interface(f"{camera.ip_address}/24").network
    hosts = [host for host in (network[1], network[-2]) if str(host) != camera.ip_address]
    return f"{hosts[-1]}/{network.prefixlen}"


def _packets(line: NetworkLine, loads: Mapping[str, CameraLoad]) -> list[Finding]:
    too_large = tuple(serial for serial, load in loads.items() if load.packet_size > line.mtu)
    found = []
    if too_large:
        values = {
            "interface": line.interface,
            "mtu": line.mtu,
            "command": f"sudo ip link set {line.interface} mtu {max(load.packet_size for load in loads.values())}",
        }
        found.append(Finding("packets-too-large", "error", values, too_large))
    total = sum(wire_bytes(load) * load.rate_hz for load in loads.values())
    jumbo = sum(wire_bytes(replace(load, packet_size=_JUMBO)) * load.rate_hz for load in loads.values())
    if line.mtu <= _PLAIN and line.mbit_s is not None and total > 0.5 * line.mbit_s * 1e6 / 8:
        values = {
            "interface": line.interface, "saved": 1 - jumbo / total, "mtu": line.mtu,
            "command": f"sudo ip link set {line.interface} mtu {_JUMBO}",
        }  # fmt: skip
        found.append(Finding("small-packets", "info", values, tuple(loads)))
    return found


def _buffer(line: NetworkLine, loads: Mapping[str, CameraLoad]) -> list[Finding]:
    largest = max([load.image_bytes for load in loads.values()], default=0)
    needed = max(_LEAST_BUFFER, largest)
    if not loads or line.receive_buffer_bytes >= needed:
        return []
    values = {
        "kilobytes": line.receive_buffer_bytes // 1000,
        "needed_kilobytes": needed // 1000,
        "command": f"sudo sysctl net.core.rmem_max={max(_WANTED_BUFFER, needed)}",
    }
    return [Finding("receive-buffer", "warning", values, tuple(loads))]
