"""GigE cameras without a driver: who answers on the wire, addresses given, packets tested, this computer cured."""

import ctypes
import ipaddress
import os
import shlex
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal_cameras.network_lines import CameraLoad, NetworkLine, assess, network_lines, network_of
from spherecal_cameras.protocol import CameraError
from spherecal_files.programs import find_program, own_program
from spherecal_gentl.gige import gvcp

# Bootstrap registers of GigE Vision; the stream's are those of its first channel.
_IP_CONFIGURATION, _PERSISTENT = 0x0014, 1
_PERSISTENT_IP, _PERSISTENT_MASK, _PERSISTENT_GATEWAY = 0x064C, 0x065C, 0x066C
_STREAM_PORT, _PACKET_SIZE, _STREAM_ADDRESS = 0x0D00, 0x0D04, 0x0D18
_FIRE, _WHOLE = 1 << 31, 1 << 30  # send a test packet; do not fragment
_CONTROL = 2  # as the standard calls it: others may read
_ASK_S = 0.3  # cameras answer within some ms, on a busy machine within 100 ms
_SETTLE_S = 10.0  # a camera with a new address starts its network again: 0.1 s (simulated) to some seconds
_LEAST_PACKET, _PACKET_STEP, _IN_UDP = 576, 4, 28  # bytes; the last: of IP and UDP around the data
# What a camera is taken to send before it can be asked: so the buffer is judged for 10 ms of a full line of 1 Gbit/s.
_NOMINAL = CameraLoad(2_000_000, 5.0)
_APPLY_S = 120.0  # somebody types a password


FactName = Literal["mtu", "receive-buffer", "firewall", "reverse-path-filter", "speed", "addresses"]


@dataclass(frozen=True)
class LocalAddress:
    """An address of this computer and the network interface that has it (empty where the system does not name it)."""

    interface: str
    address: str


@dataclass(frozen=True)
class WireCamera(gvcp.NetworkCamera):
    """A camera that answers a broadcast, as it names itself."""

    subnet_ok: bool  # this computer reaches its address on that interface
    controlled_by_other: bool | None  # a program holds it, None where it could not be asked


@dataclass(frozen=True)
class Address:
    """An address for a camera."""

    ip: str
    mask: str
    interface: str


@dataclass(frozen=True)
class PacketTest:
    """Largest packet (bytes) of a camera that arrived whole, None where none did; `tried` sizes, in order."""

    largest: int | None
    tried: tuple[int, ...]


@dataclass(frozen=True)
class InterfaceFact:
    """What a network interface is now, what is wrong (None: nothing), and the command that cures it, or empty."""

    name: FactName
    interface: str
    value: str
    finding: Finding | None = None
    cure: str = ""


# --- who is there ----------------------------------------------------------------------------------------------------


def local_addresses() -> tuple[LocalAddress, ...]:
    """The IPv4 addresses of the computer, without the loopback."""
    if sys.platform.startswith("linux"):
        return tuple(LocalAddress(line.interface, line.address) for line in network_lines())
    try:
        found = socket.gethostbyname_ex(socket.gethostname())[2]
    except OSError:
        return ()
    return tuple(LocalAddress("", one) for one in found if not ipaddress.ip_address(one).is_loopback)


def answering_cameras(local: Sequence[LocalAddress], seconds: float = 0.7) -> tuple[gvcp.NetworkCamera, ...]:
    """The GigE cameras that answer to a broadcast from these addresses, of whatever subnet; blocking."""
    places = list({one.interface: one for one in local}.values()) if os.name == "posix" else list(local)

    def answers(where: LocalAddress) -> list[gvcp.NetworkCamera]:
        try:
            return gvcp.search(where.interface, seconds, where.address)
        except OSError:  # down, or not allowed
            return []

    with ThreadPoolExecutor(max(len(places), 1)) as pool:
        found = list(pool.map(answers, places))
    each = {
        (camera.mac, camera.serial, camera.model, camera.ip_address): camera
        for cameras in reversed(found)
        for camera in cameras
    }
    return tuple(sorted(each.values(), key=lambda camera: (camera.serial, camera.mac)))


def reached(camera: gvcp.NetworkCamera, local: Iterable[LocalAddress]) -> bool:
    """Whether this computer has an address in the camera's network, on the interface where the camera answered."""
    if camera.mask == "0.0.0.0":  # it does not say: then the computer's own networks tell
        lines = [line for line in network_lines() if line.interface == camera.interface]
        return any(ipaddress.ip_address(camera.ip_address) in network_of(line) for line in lines)
    try:
        network = ipaddress.ip_interface(f"{camera.ip_address}/{camera.mask}").network
        return any(
            ipaddress.ip_address(one.address) in network for one in local if one.interface in ("", camera.interface)
        )
    except ValueError:  # the camera's own word, which may be anything
        return False


def found_on_wire(seconds: float = 0.7) -> tuple[WireCamera, ...]:
    """Every GigE camera that answers on any interface within some seconds, of whatever subnet; no driver is needed."""
    local = local_addresses()
    return tuple(_on_wire(camera, reached(camera, local)) for camera in answering_cameras(local, seconds))


def _on_wire(camera: gvcp.NetworkCamera, in_reach: bool) -> WireCamera:
    held = None
    if in_reach:
        with _asking(camera.ip_address) as registers:
            privilege = registers.read(gvcp.CONTROL_REGISTER, _ASK_S)
        held = None if privilege is None else privilege != 0
    return WireCamera(**vars(camera), subnet_ok=in_reach, controlled_by_other=held)


@contextmanager
def _asking(address: str) -> Iterator[gvcp.Gvcp]:
    registers = gvcp.Gvcp(address)
    try:
        yield registers
    finally:
        registers.close()


# --- addresses -------------------------------------------------------------------------------------------------------


def proposed_address(camera: WireCamera, others: Iterable[WireCamera]) -> Address | None:
    """A free address of the network of the interface on which a camera answers; None where it has no network."""
    line = next((line for line in network_lines() if line.interface == camera.interface), None)
    if line is None:
        return None
    network = network_of(line)
    taken = {line.address, *(other.ip_address for other in others if other.mac != camera.mac)}
    hosts = [str(host) for _, host in zip(range(4096), network.hosts(), strict=False)]
    # from the middle, away from the computers and routers at the beginning and the end
    ordered = hosts[len(hosts) // 3 :] + hosts[: len(hosts) // 3]
    free = (host for host in ordered if host not in taken and not _somebody_at(host, line.interface))
    ip = next(free, None)
    return None if ip is None else Address(ip, str(network.netmask), line.interface)


def _somebody_at(address: str, interface: str) -> bool:
    """Whether a device answers for an address on the wire, whatever it is."""
    with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        any_socket.sendto(b"", (address, 9))  # so that the system asks who has it
    deadline = time.monotonic() + _ASK_S
    while time.monotonic() < deadline:
        with suppress(OSError):
            for row in Path("/proc/thread-self/net/arp").read_text(encoding="ascii").splitlines()[1:]:
                words = row.split()
                if words[0] == address and words[5] == interface and int(words[2], 16) & 2:
                    return True
        time.sleep(0.02)
    return False


def give_address(mac: str, ip: str, mask: str, gateway: str = "0.0.0.0", persistent: bool = True) -> WireCamera:
    """Give a camera an address (FORCEIP), also for its next starts if `persistent`; it as it then answers. Blocking."""
    local = local_addresses()
    there = answering_cameras(local)
    camera = next((one for one in there if one.mac == mac), None)
    if camera is None:
        raise CameraError(Phrase("error-address-nobody", {"mac": mac}))
    _check_address(camera, ip, mask, gateway, there)
    words = {"model": camera.model, "serial": camera.serial, "address": ip}
    where = next((one.address for one in local if one.interface == camera.interface), "")
    deadline = time.monotonic() + _SETTLE_S
    while time.monotonic() < deadline:
        gvcp.force_address(camera.interface, mac, ip, mask, gateway, where)
        now = next((one for one in gvcp.search(camera.interface, _ASK_S, where) if one.mac == mac), None)
        if now is not None and now.ip_address == ip:
            break
    else:
        raise CameraError(Phrase("error-address-refused", words))
    if persistent and not _keep_address(ip, mask, gateway):
        raise CameraError(Phrase("error-address-not-kept", words))
    return _on_wire(now, reached(now, local))


def _check_address(
    camera: gvcp.NetworkCamera, ip: str, mask: str, gateway: str, there: Iterable[gvcp.NetworkCamera]
) -> None:
    values = {"address": ip, "mask": mask}
    try:
        network, _ = ipaddress.IPv4Interface(f"{ip}/{mask}").network, ipaddress.IPv4Address(gateway)
        impossible = ipaddress.IPv4Address(ip) in (network.network_address, network.broadcast_address)
        impossible = impossible or not 1 <= network.prefixlen <= 30 or ipaddress.IPv4Address(ip).is_loopback
    except ValueError:
        impossible = True
    if impossible:
        raise CameraError(Phrase("error-address-impossible", values))
    line = next((line for line in network_lines() if line.interface == camera.interface), None)
    if line is not None and ipaddress.ip_address(ip) not in network_of(line):
        values |= {"interface": line.interface, "network": str(network_of(line))}
        raise CameraError(Phrase("error-address-elsewhere", values))
    taken = any(one.ip_address == ip and one.mac != camera.mac for one in there)
    if line is not None and ip != camera.ip_address:
        taken = taken or ip == line.address or _somebody_at(ip, line.interface)
    if taken:
        raise CameraError(Phrase("error-address-taken", values))


def _keep_address(ip: str, mask: str, gateway: str) -> bool:
    """Whether a camera took an address for its next starts."""
    with _asking(ip) as registers:
        if not registers.write(gvcp.CONTROL_REGISTER, _CONTROL, _ASK_S):
            return False
        try:
            wanted = ((_PERSISTENT_IP, ip), (_PERSISTENT_MASK, mask), (_PERSISTENT_GATEWAY, gateway))
            values = [(at, struct.unpack(">I", socket.inet_aton(text))[0]) for at, text in wanted]
            ways = registers.read(_IP_CONFIGURATION, _ASK_S)
            values.append((_IP_CONFIGURATION, (ways or 0) | _PERSISTENT))
            kept = all([registers.write(at, value, _ASK_S) for at, value in values])
            return kept and all(registers.read(at, _ASK_S) == value for at, value in values[:3])
        finally:
            registers.write(gvcp.CONTROL_REGISTER, 0, _ASK_S)


# --- packets ---------------------------------------------------------------------------------------------------------


def largest_packet(camera: str, mtu: int) -> PacketTest:
    """The largest packet (bytes, at most `mtu`) that arrives whole from a camera that nobody has open, by tests."""
    with _asking(camera) as registers, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.connect((camera, 9))  # so that it has the address of the interface that leads there
        here = ear.getsockname()[0]
        ear.close()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stream:
            stream.bind((here, 0))
            if not registers.write(gvcp.CONTROL_REGISTER, _CONTROL, _ASK_S):
                raise CameraError(Phrase("error-packets-held", {"address": camera}))
            before = registers.read(_PACKET_SIZE, _ASK_S)
            try:
                registers.write(_STREAM_ADDRESS, struct.unpack(">I", socket.inet_aton(here))[0], _ASK_S)
                registers.write(_STREAM_PORT, stream.getsockname()[1], _ASK_S)
                return _tried(registers, stream, mtu)
            finally:
                if before is not None:
                    registers.write(_PACKET_SIZE, before & ~_FIRE, _ASK_S)
                registers.write(_STREAM_PORT, 0, _ASK_S)
                registers.write(gvcp.CONTROL_REGISTER, 0, _ASK_S)


def cut_packets(wire: Iterable[WireCamera]) -> tuple[Finding, ...]:
    """Cameras that nobody has open whose packets a switch cuts, though the network card takes them. Blocking."""
    wire = tuple(wire)
    mtu = {line.interface: line.mtu for line in network_lines()}
    asked = [c for c in wire if c.subnet_ok and c.controlled_by_other is False and c.interface in mtu]
    with ThreadPoolExecutor(max(len(asked), 1)) as pool:
        found = list(pool.map(lambda camera: _cut(camera, mtu[camera.interface]), asked))
    return tuple(one for one in found if one is not None)


def _cut(camera: WireCamera, mtu: int) -> Finding | None:
    with _asking(camera.ip_address) as registers:
        wanted = (registers.read(_PACKET_SIZE, _ASK_S) or 0) & 0xFFFF
    try:
        arrives = largest_packet(camera.ip_address, mtu).largest
    except CameraError:  # somebody has opened it meanwhile
        return None
    if arrives is None or arrives >= min(wanted, mtu):
        return None
    values = {"largest": arrives, "wanted": wanted, "interface": camera.interface}
    return Finding("packets-cut", "warning", values, (camera.serial,))


def _tried(registers: gvcp.Gvcp, stream: socket.socket, mtu: int) -> PacketTest:
    """By halves; the least and the most first, which mostly say it all."""
    tried: list[int] = []

    def arrives(steps: int) -> bool:
        tried.append(steps * _PACKET_STEP)
        return any(_fired(registers, stream, tried[-1]) for _ in range(2))

    low, high = _LEAST_PACKET // _PACKET_STEP, mtu // _PACKET_STEP
    if arrives(high):
        return PacketTest(high * _PACKET_STEP, tuple(tried))
    if not arrives(low):
        return PacketTest(None, tuple(tried))
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if arrives(middle) else (low, middle)
    return PacketTest(low * _PACKET_STEP, tuple(tried))


def _fired(registers: gvcp.Gvcp, stream: socket.socket, size: int) -> bool:
    if not registers.write(_PACKET_SIZE, _FIRE | _WHOLE | size, _ASK_S):
        return False
    deadline = time.monotonic() + _ASK_S
    while (left := deadline - time.monotonic()) > 0:
        stream.settimeout(left)
        try:
            if len(stream.recv(65536)) + _IN_UDP == size:
                return True
        except OSError:
            return False
    return False


# --- the computer's part ---------------------------------------------------------------------------------------------

_FACT_OF: dict[str, FactName] = {
    "packets-too-large": "mtu", "small-packets": "mtu", "receive-buffer": "receive-buffer",
    "reverse-path-filter": "reverse-path-filter", "line-too-thin": "speed", "same-address": "addresses",
    "other-subnet": "addresses",
}  # fmt: skip


def interface_facts(
    wire: Iterable[WireCamera], loads: Mapping[str, CameraLoad] | None = None
) -> tuple[InterfaceFact, ...]:
    """What of this computer's network matters to these cameras; `loads`: what each sends, else as of 2 MP."""
    wire = tuple(wire)
    if sys.platform == "win32":
        return (_windows_firewall(),) if wire else ()
    facts: list[InterfaceFact] = []
    for line in network_lines():
        cameras = [camera for camera in wire if camera.interface == line.interface]
        facts += _facts_of(line, cameras, loads) if cameras else []
    return tuple(facts)


def _facts_of(
    line: NetworkLine, cameras: Sequence[gvcp.NetworkCamera], loads: Mapping[str, CameraLoad] | None
) -> list[InterfaceFact]:
    examined = assess(line, cameras, loads or {camera.serial: _NOMINAL for camera in cameras})
    values: dict[FactName, str] = {
        "speed": "" if line.mbit_s is None else f"{line.mbit_s:.0f} Mbit/s",
        "mtu": f"{line.mtu} bytes",
        "receive-buffer": f"{line.receive_buffer_bytes // 1000} kB",
        "reverse-path-filter": str(line.reverse_path_filter),
        "addresses": str(network_of(line)),
    }
    facts: list[InterfaceFact] = []
    for name, value in values.items():
        found = [finding for finding in examined.findings if _FACT_OF[finding.code] == name]
        facts += [InterfaceFact(name, line.interface, value, one, one.values.get("command", "")) for one in found]
        facts += [] if found else [InterfaceFact(name, line.interface, value)]
    return [*facts, _firewall(line.interface)]


def _firewall(interface: str) -> InterfaceFact:
    """The usual firewalls of Linux, where they are on: to them images are packets that nobody has asked for."""
    cures = {
        "ufw": f"sudo ufw allow in on {interface} proto udp from any to any",
        "firewalld": f"sudo firewall-cmd --permanent --zone=trusted --change-interface={interface}",
    }
    active = _active_firewall()
    if not active:
        return InterfaceFact("firewall", interface, "-")
    values = {"firewall": active, "interface": interface, "command": cures[active]}
    return InterfaceFact("firewall", interface, active, Finding("firewall-on", "info", values), cures[active])


def _active_firewall() -> str:
    with suppress(OSError):
        if "ENABLED=yes" in Path("/etc/ufw/ufw.conf").read_text(encoding="utf-8", errors="replace").split():
            return "ufw"
    return "firewalld" if Path("/run/firewalld").exists() or Path("/run/firewalld.pid").exists() else ""


def _windows_firewall() -> InterfaceFact:
    """Never run by us: the rule that lets this program hear cameras."""
    rule = (
        f'netsh advfirewall firewall add rule name="SphereCal" dir=in action=allow protocol=udp '
        f'program="{own_program("spherecal")[0]}" enable=yes profile=any'
    )
    values = {"firewall": "Windows", "interface": "-", "command": rule}
    return InterfaceFact("firewall", "", "Windows", Finding("firewall-on", "info", values), rule)


def can_apply(cure: str) -> bool:
    """Whether `apply_cure` can be tried here: else the line is for somebody to paste."""
    if not cure:
        return False
    if sys.platform == "win32":
        return True
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    return os.geteuid() == 0 or (find_program("pkexec") is not None and bool(display))


def apply_cure(cure: str) -> None:
    """Run a cure's command line with an administrator's rights, for which the system asks; blocking."""
    if sys.platform == "win32":
        # Windows: run it as its user account control allows. Never run by us.
        program, _, arguments = cure.partition(" ")
        shell = ctypes.windll.shell32  # type: ignore[attr-defined]
        result = shell.ShellExecuteW(None, "runas", program, arguments, None, 0)
        said = "" if result > 32 else f"Windows: {result}"
    else:
        words = shlex.split(cure.removeprefix("sudo "))
        path = find_program(words[0], path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin") or words[0]
        command = [path, *words[1:]] if os.geteuid() == 0 else ["pkexec", path, *words[1:]]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_APPLY_S, check=False)
            said = "" if done.returncode == 0 else done.stderr.strip() or str(done.returncode)
        except (OSError, subprocess.TimeoutExpired) as error:
            said = str(error)
    if said:
        raise CameraError(Phrase("error-cure-failed", {"command": cure, "said": said.splitlines()[-1]}))
