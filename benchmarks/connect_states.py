"""Connect in every state in which a fresh user may meet it: `python -m benchmarks.connect_states FOLDER` (Linux, root).

Six GigE cameras, each in a network namespace of its own behind a switch: the program `arv-fake-gv-camera-0.8` of
libaravis as it is (`stock`), and libaravis' camera with images of a ball put into it, in which dots are found. The
window is a new process on a virtual screen, with an empty home, and is clicked by a real mouse. FOLDER gets a picture
of each state and `connect.md`: clicks, and seconds from the first click on. Needs Xvfb, xdotool and ImageMagick.

A state that does not come about in time is MISSED, and the exit code 1. Names after FOLDER choose some states;
`--tlsimu FILE` adds the simulator of genicam 1.5 (TLSimu.cti, whose libraries must be found).
"""

import argparse
import ctypes.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

from installer.walk import Walk, virtual_screen
from spherecal.base.context import Context
from spherecal_app.cli.producer_command import show_gige
from spherecal_gentl.gige import gige_control
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
from spherecal_gentl.gige.gvcp import CONTROL_REGISTER, Gvcp
from spherecal_gentl.producer.build_producer import DISCOVERY_VARIABLE, build_producer
from spherecal_gentl.producer.producer_control import (
    ACCESS_DENIED,
    ProducerControl,
    RigFeed,
    SessionScenes,
    SimulatedCamera,
)
from spherecal_sim.render_session import demo_session

ROOT = Path(__file__).resolve().parents[1]
STOCK = "arv-fake-gv-camera-0.8"
# As the rig starts its cameras: INTERFACE SERIAL ...; what follows a point in the serial number is ours alone.
_AS_STOCK = f'#!/bin/sh\necho ready\nexec {STOCK} -i "$1" -s "${{2%%.*}}" >&2\n'
# Without libaravis: nothing of it can be loaded, and the loader's list does not have it.
_HIDING = """
for file in /usr/lib/*/libaravis* /usr/lib/*/pkgconfig/aravis*; do mount --bind /dev/null "$file"; done
ldconfig -X -C "$HOME/ld.so.cache" 2>/dev/null && mount --bind "$HOME/ld.so.cache" /etc/ld.so.cache
exec "$@"
"""
_USER_NAME = 0xE8
_IN_TIME_S = 90.0
COUNT = 6


def viky() -> dict[str, str]:
    """The producer that genicam brings."""
    import genicam

    return {DISCOVERY_VARIABLE: str(Path(str(genicam.__file__)).parent)}


class Missed(Exception):
    """A state that did not come about."""


class FreshUser(Walk):
    """The window as a new user starts it, and what is shown in it."""

    def __init__(self, folder: Path, display: str, name: str, inside: Sequence[str], variables: dict[str, str]) -> None:
        self.name, self.pictures = name, folder
        home = Path(tempfile.mkdtemp(prefix="fresh-", dir=folder))
        words = {
            "PYTHONPATH": f"{ROOT / 'core'}:{ROOT}",
            "SPHERECAL_KERNELS": "",
            "XDG_RUNTIME_DIR": str(home),
        }
        changed = [f"{key}={value}" for key, value in (words | variables).items()]
        command = [*inside, "/usr/bin/env", *changed, sys.executable, "-m", "benchmarks.timed_window"]
        super().__init__(command, home, display, None)
        self.rows: list[tuple[str, str, str, str]] = []
        self.first_s: float | None = None

    def times(self) -> dict:
        """What the window counts."""
        try:
            return json.loads((self.folder / "times.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}

    def begin(self, driver_asked: bool = True) -> None:
        """From the start page to Connect; the driver is allowed where it is asked about."""
        self.press("new-live")
        self.first_s = time.monotonic()
        if driver_asked:
            self.press("driver-yes")

    def shown(self, what: str, images: int, dots: int | None = None, also: Callable[[], bool] | None = None) -> None:
        """Until so many live pictures are there, with dots in so many; a picture of it, and a row of the table."""
        until = time.monotonic() + _IN_TIME_S
        right, seen = False, self.times()
        while not right and time.monotonic() < until and self.process.poll() is None:
            seen = self.times()
            right = seen.get("live pictures") == images and (dots is None or seen.get("with dots", 0) >= dots)
            right = right and (also is None or also())
            time.sleep(0.05)
        seconds = time.monotonic() - (self.first_s or self.began)
        time.sleep(1.5)  # what is drawn last
        file = f"{self.name}-{what}".replace(" ", "-")
        pictures, self.folder = self.folder, self.pictures
        self.picture(file)
        self.folder = pictures
        found = f"{seen.get('live pictures')} pictures, {seen.get('with dots')} with dots"
        self.rows.append(
            (f"{self.name}: {what}", f"{self.pressed}", f"{seconds:.1f}", found if right else f"MISSED: {found}")
        )
        print(" | ".join(self.rows[-1]), flush=True)
        if not right:
            raise Missed(what)


@contextmanager
def rig(stock: bool, folder: Path, serials: Sequence[str] = ()) -> Iterator[GigeRig]:
    """Six cameras on a switch: the stock program, or with the demo's images."""
    session = demo_session(Context())
    scenes = SessionScenes(session)
    cameras = [GigeCamera(serial[:15], *camera.image_size) for serial, camera in scenes.cameras.items()][:COUNT]
    if stock:
        cameras = [GigeCamera(serial, 512, 512) for serial in serials or [f"GV{n + 1:02d}" for n in range(COUNT)]]
        program = folder / "stock-camera"
        program.write_text(_AS_STOCK)
        program.chmod(0o755)
        with patch.object(gige_control, "build_fake_camera", lambda: program), GigeRig(cameras) as made:
            yield made
        return
    with GigeRig(cameras) as made:
        show_gige(made, scenes, scenes.names[0])
        yield made


def named(made: GigeRig, serials: Sequence[str], name: str) -> None:
    """Give cameras a name of their own, as their maker's program does."""
    text = name.encode().ljust(16, b"\0")
    with made.entered():
        for serial in serials:
            registers = Gvcp(made.addresses[serial])
            registers.write(CONTROL_REGISTER, 2, 1.0)
            for at in range(0, 16, 4):
                registers.write(_USER_NAME + at, int.from_bytes(text[at : at + 4], "big"), 1.0)
            registers.write(CONTROL_REGISTER, 0, 1.0)
            registers.close()


class States:
    """Each state by its name; `driver` is the Aravis producer as an installer leaves it."""

    def __init__(self, folder: Path, display: str, tlsimu: Path | None) -> None:
        self.folder, self.display, self.tlsimu = folder, display, tlsimu
        (folder / "driver").mkdir(exist_ok=True)
        self.driver = {DISCOVERY_VARIABLE: str(build_producer(folder / "driver", aravis=True).parent)}
        self.users: list[FreshUser] = []

    @contextmanager
    def user(
        self, name: str, inside: Sequence[str] = (), variables: dict[str, str] | None = None
    ) -> Iterator[FreshUser]:
        """A new user's window, ended after the state was seen."""
        made = FreshUser(self.folder, self.display, name, inside, self.driver if variables is None else variables)
        self.users.append(made)
        try:
            yield made
        except Missed:
            pass
        finally:
            made.process.terminate()
            made.process.wait(60)
            said = (made.folder / "out.txt").read_text(errors="replace")
            if "uncaught" in said or "Segmentation" in said:
                print(said[-3000:])
                made.rows.append((f"{name}: uncaught", "", "", "MISSED"))
            shutil.rmtree(made.folder, ignore_errors=True)

    # --- what a fresh user meets -------------------------------------------------------------------------------------

    def six(self, stock: bool, name: str) -> None:
        """Nothing is wrong; then one is unplugged, and plugged in again."""
        with rig(stock, self.folder) as made, self.user(name, made.inside()) as user:
            dots = 0 if stock else COUNT
            user.begin()
            user.shown("six live", COUNT, dots)
            third = made.serials[2]
            made.fault("unplug", third)
            user.shown("one unplugged", COUNT - 1)
            made.fault("plug", third)
            user.shown("plugged in again", COUNT, dots)

    def subnet(self, stock: bool, name: str) -> None:
        """One has an address of another network, and is given one of this."""
        with rig(stock, self.folder) as made, self.user(name, made.inside()) as user:
            made.fault("subnet", made.serials[1])
            user.begin()
            user.shown("one in another subnet", COUNT - 1, 0 if stock else COUNT - 1)
            if not stock:  # libaravis' own program does not know FORCEIP
                user.press(next(key for key in user.buttons() if key.startswith("cure-")))
                user.shown("after its address", COUNT, COUNT)

    def held(self, stock: bool, name: str) -> None:
        """Another program has control of one, and lets it go."""
        with rig(stock, self.folder) as made, self.user(name, made.inside()) as user:
            made.fault("seize", made.serials[4])
            user.begin()
            user.shown("one held by another program", COUNT - 1, 0 if stock else COUNT - 1)
            made.fault("release", made.serials[4])
            user.shown("let go", COUNT)

    def equal(self, stock: bool, name: str) -> None:
        """Two have one name; of the stock ones two also have one serial number."""
        serials = ["GV01.a", "GV01.b", *(f"GV{n:02d}" for n in range(3, COUNT + 1))]
        with rig(stock, self.folder, serials) as made, self.user(name, made.inside()) as user:
            named(made, made.serials[:2] if not stock else made.serials[2:4], "Center")
            user.begin()
            user.shown("two of one name", COUNT, 0 if stock else COUNT)

    def no_driver(self, stock: bool, name: str) -> None:
        """Neither a maker's driver nor libaravis."""
        with rig(stock, self.folder) as made:
            hidden = [*made.inside(), "unshare", "--mount", "sh", "-c", _HIDING, "sh"]
            with self.user(name, hidden, {DISCOVERY_VARIABLE: ""}) as user:
                user.begin(driver_asked=False)
                user.shown("no driver at all", 0, also=lambda: "makers" in user.buttons())

    def no_producer(self, stock: bool, name: str) -> None:
        """Libaravis is there, the driver made of it is not; one click makes it."""
        with rig(stock, self.folder) as made, self.user(name, made.inside(), {DISCOVERY_VARIABLE: ""}) as user:
            user.begin(driver_asked=False)
            user.shown("libaravis without a driver", 0, also=lambda: "builtin-driver" in user.buttons())
            user.press("builtin-driver")
            user.shown("after one click", COUNT, 0 if stock else COUNT)

    def wrong_driver(self, stock: bool, name: str) -> None:
        """A driver is there that sees no camera; one click makes the one that reaches these."""
        (self.folder / "other").mkdir(exist_ok=True)
        other = {DISCOVERY_VARIABLE: str(build_producer(self.folder / "other").parent)}
        with rig(stock, self.folder) as made, ProducerControl([SimulatedCamera("S1", 320, 240)]) as nobody:
            nobody.unplug("S1")
            with self.user(name, made.inside(), {**nobody.environment, **other}) as user:
                user.begin()
                user.shown("a driver of other cameras", 0, also=lambda: "builtin-driver" in user.buttons())
                user.press("builtin-driver")
                user.shown("after one click", COUNT, 0 if stock else COUNT)

    def other_driver(self, stock: bool, name: str) -> None:
        """A driver has cameras of its own, and six more answer that it does not reach."""
        with rig(stock, self.folder) as made, self.user(name, made.inside(), viky()) as user:
            user.begin(driver_asked=False)
            cures = lambda: [key for key in user.buttons() if key.startswith("cure-")]  # noqa: E731
            user.shown("three and six without a driver", 3, also=lambda: len(cures()) == COUNT)
            user.press(cures()[0])
            user.shown("after one click", COUNT + 3, 0 if stock else COUNT)

    def small_packets(self, stock: bool, name: str) -> None:
        """The computer's network card takes smaller packets than the cameras send; one click mends it."""
        with rig(stock, self.folder) as made:
            subprocess.run(made.inside(["ip", "link", "set", "eth0", "mtu", "1200"]), check=True)
            with self.user(name, made.inside()) as user:
                user.begin()
                user.shown("a network card of small packets", 0, also=lambda: "apply-cure" in user.buttons())
                user.press("apply-cure")
                user.shown("after one click", COUNT, 0 if stock else COUNT, lambda: "apply-cure" not in user.buttons())

    def texts(self) -> None:
        """A producer whose texts are not UTF-8, and one of its cameras is held."""
        with RigFeed(demo_session(Context())) as feed:
            feed.control.set(feed.control.serials[3], open_error=ACCESS_DENIED)
            (self.folder / "texts").mkdir(exist_ok=True)
            odd = {DISCOVERY_VARIABLE: str(build_producer(self.folder / "texts").parent)}
            odd |= {**feed.control.environment, **odd, "SPHERECAL_GENTL_ODD": "texts=c4e3bad3"}
            with self.user("texts", (), odd) as user:
                user.begin()
                user.shown("texts that are not UTF-8 and one held", COUNT - 1, COUNT - 1)

    def viky(self) -> None:
        """The producer that genicam brings."""
        with self.user("viky", (), viky()) as user:
            user.begin(driver_asked=False)
            user.shown("three live", 3)

    def tl_simu(self) -> None:
        """The standard's own simulator."""
        assert self.tlsimu is not None
        with self.user("tlsimu", (), {DISCOVERY_VARIABLE: str(self.tlsimu.parent)}) as user:
            user.begin()
            user.shown("four live", 4)

    def all(self) -> dict[str, Callable[[], None]]:
        """Every state that can be made here."""
        found: dict[str, Callable[[], None]] = {}
        names = "six subnet held equal no_driver no_producer wrong_driver other_driver small_packets"
        for state in names.split():
            for kind in ("stock", "ball"):
                name, make = f"{state.replace('_', '-')}-{kind}", getattr(self, state)
                found[name] = lambda make=make, name=name, kind=kind: make(kind == "stock", name)
        found |= {"texts": self.texts, "viky": self.viky}
        return found | ({"tlsimu": self.tl_simu} if self.tlsimu is not None else {})


def main() -> int:
    """Make each state, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("states", nargs="*", help="some only: six-stock, held-ball, ...")
    parser.add_argument("--tlsimu", type=Path)
    options = parser.parse_args()
    if ctypes.util.find_library("aravis-0.8") is None or shutil.which(STOCK) is None:
        sys.exit("needs libaravis-dev and aravis-tools-cli")
    folder = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    with virtual_screen() as display:
        states = States(folder, display, options.tlsimu)
        for name, make in states.all().items():
            if not options.states or name in options.states:
                make()
    rows = [row for user in states.users for row in user.rows]
    lines = [
        "| state | clicks | seconds | shown |",
        "|---|---|---|---|",
        *("| " + " | ".join(row) + " |" for row in rows),
    ]
    (folder / "connect.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    missed = [row[0] for row in rows if row[3].startswith("MISSED")]
    print(f"load {os.getloadavg()[0]:.1f}; missed: {', '.join(missed) or 'none'}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
