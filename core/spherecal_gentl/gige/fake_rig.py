"""The GigE rig inside its namespaces: a switch, two computers, simulated cameras, by JSON lines of `control.py`.

First process of a process namespace: whatever it starts ends with it, and it with its standard input, even killed.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from spherecal_gentl.gige.gvcp import CONTROL_REGISTER, Gvcp
from spherecal_gentl.gige.namespaces import CommandError, NetworkNamespace

NET, OTHER_NET = "192.168.77", "192.168.78"
MASK = "255.255.255.0"
CLIENT, SECOND = f"{NET}.1", f"{NET}.2"
_FIRST_HOST = 11
_SEIZE_S = 20.0  # the camera lets go of a silent program after its heartbeat time, 3 s
_HEARTBEAT_S = 0.5
_RELEASES = 5
_BURST_BYTES, _QUEUE_MS = 32_000, 50


@dataclass
class Camera:
    """One simulated camera: its place in the network and its program, None while it has no power."""

    serial: str
    width: int
    height: int
    pictures: int
    number: int
    network: NetworkNamespace
    address: str = ""
    kept: str = ""
    program: subprocess.Popen | None = None

    @property
    def port(self) -> str:
        """Its port at the switch."""
        return f"cam{self.number}"

    @property
    def mac(self) -> str:
        """Its hardware address, a locally administered one."""
        return f"02:53:43:00:00:{self.number + 1:02x}"

    @property
    def own_address(self) -> str:
        """The address it starts with."""
        return self.kept or f"{NET}.{_FIRST_HOST + self.number}"


class CameraNetwork:
    """The switch in this process's own namespace; everything else in namespaces of its own."""

    def __init__(self, server: str, mtu: int, cameras: list[dict[str, Any]]) -> None:
        self._server, self._mtu = server, mtu
        self._switch = NetworkNamespace.own()
        self._switch.run("ip link set lo up")
        self._switch.run(f"ip link add switch mtu {mtu} type bridge")
        self._switch.run("ip link set switch up")
        self._switch.run("nft", "add table netdev faults")
        self.client = self._computer("client", CLIENT)
        self.second = self._computer("second", SECOND)
        self._held: dict[str, _Holder] = {}
        self.cameras: dict[str, Camera] = {}
        for number, about in enumerate(cameras):
            camera = Camera(**about, number=number, network=NetworkNamespace.new())
            self._cable(camera.network, camera.port, camera.mac)
            self._ask_nft(
                f"add chain netdev faults {camera.port} {{ type filter hook ingress device {camera.port} priority 0; }}"
            )
            self.cameras[camera.serial] = camera
            self._give_address(camera, camera.own_address)
        for camera in self.cameras.values():
            self._start(camera)

    def _computer(self, port: str, address: str) -> NetworkNamespace:
        network = NetworkNamespace.new()
        self._cable(network, port, None)
        network.run(f"ip address add {address}/24 broadcast + dev eth0")
        self._ask_nft(f"add chain netdev faults {port} {{ type filter hook ingress device {port} priority 0; }}")
        return network

    def _cable(self, network: NetworkNamespace, port: str, mac: str | None) -> None:
        # the first process of the process namespace is this one, whose namespace is the switch
        own = f"address {mac} mtu {self._mtu}" if mac else f"mtu {self._mtu}"
        network.run(f"ip link add eth0 {own} type veth peer name {port} mtu {self._mtu} netns 1")
        network.run("ip link set eth0 up")
        self._switch.run(f"ip link set {port} master switch up")

    def _give_address(self, camera: Camera, address: str) -> None:
        network = camera.network
        network.run("ip address flush dev eth0")
        network.run(f"ip address add {address}/24 broadcast + dev eth0")
        # as real cameras do, it answers whoever asks, also from another subnet
        network.run("ip route replace default dev eth0")
        camera.address = address

    def _start(self, camera: Camera) -> None:
        size = str(camera.width), str(camera.height)
        command = [self._server, "eth0", camera.serial, *size, camera.mac, MASK, str(camera.pictures)]
        program = subprocess.Popen(
            camera.network.inside(command), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, pass_fds=(camera.network.file, camera.pictures), env=os.environ | {"ARV_DEBUG": ""},
        )  # fmt: skip
        assert program.stdout is not None and program.stderr is not None
        if program.stdout.readline().strip() != "ready":
            raise CommandError(f"camera {camera.serial}: {program.stderr.read().strip() or 'did not start'}")
        threading.Thread(target=program.stderr.read, daemon=True).start()  # a full pipe would stop it
        camera.program = program
        threading.Thread(target=self._obey, args=(camera, program), daemon=True).start()

    def _obey(self, camera: Camera, program: subprocess.Popen) -> None:
        """What a camera asks for: another address now, or from its next start on."""
        assert program.stdout is not None
        for line in program.stdout:
            what, address = line.split()
            if what == "keep":
                camera.kept = "" if address == "0.0.0.0" else address
            elif address != camera.address:
                self._readdress(camera.serial, address)
                return

    def _stop(self, camera: Camera) -> None:
        if camera.program is not None:
            camera.program.kill()
            camera.program.wait()
            camera.program = None

    def _ask_nft(self, rule: str) -> None:
        self._switch.run("nft", rule)

    def _rules(self, port: str, *rules: str) -> None:
        self._ask_nft(f"flush chain netdev faults {port}")
        for rule in rules:
            self._ask_nft(f"add rule netdev faults {port} {rule}")

    def loss(self, serial: str, percent: float) -> None:
        """A share of the packets that the camera sends is lost at random, whatever they are."""
        parts = round(percent * 100)
        self._rules(self.cameras[serial].port, *([f"numgen random mod 10000 < {parts} drop"] if parts else []))

    def burst(self, serial: str, length: int, every: int) -> None:
        """Some of the packets that the camera sends are lost, one after another."""
        self._rules(self.cameras[serial].port, *([f"numgen inc mod {every} < {length} drop"] if length else []))

    def thin(self, where: str, mbit_s: float) -> None:
        """A cable carries less."""
        network, device = (self._switch, "client") if where == "line" else (self.cameras[where].network, "eth0")
        if not mbit_s:
            network.run(f"tc qdisc delete dev {device} root")
            return
        burst = max(_BURST_BYTES, 2 * self._mtu)
        network.run(f"tc qdisc replace dev {device} root tbf rate {mbit_s}mbit burst {burst} latency {_QUEUE_MS}ms")

    def latency(self, serial: str, ms: float, jitter_ms: float = 0.0) -> None:
        """Packets of the camera arrive later, in another order with jitter; needs the netem module."""
        network = self.cameras[serial].network
        if not ms:
            network.run("tc qdisc delete dev eth0 root")
            return
        network.run(f"tc qdisc replace dev eth0 root netem delay {ms}ms {jitter_ms}ms")

    def unplug(self, serial: str) -> None:
        """The camera's cable is pulled; it keeps its power."""
        self._switch.run(f"ip link set {self.cameras[serial].port} down")

    def plug(self, serial: str) -> None:
        """The cable is put in."""
        self._switch.run(f"ip link set {self.cameras[serial].port} up")

    def power_off(self, serial: str) -> None:
        """The camera loses its power and with it its settings."""
        self._stop(self.cameras[serial])
        self.unplug(serial)

    def power_on(self, serial: str) -> None:
        """The camera starts again."""
        self.plug(serial)
        camera = self.cameras[serial]
        if camera.program is None:
            if camera.kept:
                self._give_address(camera, camera.kept)
            self._start(camera)

    def seize(self, serial: str) -> None:
        """A program on the second computer gets control, as after a broken line; returns when it has it."""
        camera = self.cameras[serial]
        self.release(serial)  # one that the camera has forgotten, as after a loss of power, is of no use
        self._rules("client", f"ip daddr {camera.address} udp dport 3956 drop")
        try:
            with self.second.entered():
                control = Gvcp(camera.address)
            deadline = time.monotonic() + _SEIZE_S
            while not control.write(CONTROL_REGISTER, 2, 0.3):
                if time.monotonic() > deadline:
                    control.close()
                    raise CommandError(f"{serial} does not give control away")
        finally:
            self._rules("client")
        self._held[serial] = _Holder(control)

    def release(self, serial: str) -> None:
        """The second computer's program releases the camera."""
        if holder := self._held.pop(serial, None):
            holder.end()

    def conflict(self, serial: str, other: str) -> None:
        """The camera starts with the address of another one."""
        self._readdress(serial, self.cameras[other].address)

    def subnet(self, serial: str) -> None:
        """The camera starts with an address of another subnet."""
        camera = self.cameras[serial]
        self._readdress(serial, camera.own_address.replace(NET, OTHER_NET))

    def home(self, serial: str) -> None:
        """The camera starts with its own address."""
        self._readdress(serial, self.cameras[serial].own_address)

    def _readdress(self, serial: str, address: str) -> None:
        camera = self.cameras[serial]
        self._stop(camera)
        self._give_address(camera, address)
        self._start(camera)
        # what the others knew of this address is old
        self.client.run("ip neighbour flush dev eth0")


class _Holder:
    """Keeps control of a camera until it is ended."""

    def __init__(self, control: Gvcp) -> None:
        self._control, self._ended = control, threading.Event()
        self._thread = threading.Thread(target=self._hold, daemon=True)
        self._thread.start()

    def _hold(self) -> None:
        while not self._ended.wait(_HEARTBEAT_S):
            self._control.read(CONTROL_REGISTER, 0.3)

    def end(self) -> None:
        """Give control back."""
        self._ended.set()
        self._thread.join()
        for _ in range(_RELEASES):  # an answer may be late where the machine is busy
            if self._control.write(CONTROL_REGISTER, 0, 0.3):
                break
        self._control.close()


def main() -> None:
    """Build the rig that the first line describes, then obey until there are no more lines."""
    say: Callable[[dict[str, Any]], None] = lambda answer: print(json.dumps(answer), flush=True)  # noqa: E731
    if os.getpid() != 1:  # it would build its bridge in the computer's own network
        say({"error": "the simulated rig runs in namespaces of its own only: spherecal cameras simulate-gige"})
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who asked: a command may still need its cameras
    try:
        rig = CameraNetwork(**json.loads(sys.stdin.readline()))
    except CommandError as error:
        say({"error": str(error)})
        return
    # numbers as the machine's own /proc has them: this process numbers its own from 1
    say(
        {
            "pid": int(os.readlink("/proc/self")),
            "client": rig.client.file,
            "second": rig.second.file,
            "addresses": {serial: camera.address for serial, camera in rig.cameras.items()},
        }
    )
    for line in sys.stdin:
        name, *words = json.loads(line)
        try:
            getattr(rig, name)(*words)
            say({})
        except (CommandError, OSError, subprocess.SubprocessError) as error:
            say({"error": str(error)})
        except (KeyError, ValueError, OverflowError, TypeError) as error:
            say({"error": f"{type(error).__name__}: {error}"})


if __name__ == "__main__":
    main()
