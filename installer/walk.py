"""Walks through a whole calibration in the window of an installed SphereCal, by mouse clicks on a virtual screen.

python3 installer/walk.py FOLDER [--root FOLDER] [--keys] [--by-itself] [-- PROGRAM ...]: trains on the simulated rig
from the start page to the report, with everything in an empty FOLDER; `--root` runs the program in a chroot, FOLDER
then is below that root; `--keys` never touches the mouse; `--by-itself` has the window capture by itself.
Needs Xvfb and xdotool; with ImageMagick it leaves a picture of every step.
"""

import argparse
import contextlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

PATIENCE_S = 600.0
SIZE = "1280x800x24"
SEEN_S = 1.1  # a page must have been in sight for a second before the space bar acts on it
GOES_ON_S = 5.0  # a second after a step was done well the window goes on by itself, where it is not there to be read
MOST_TABS = 80
FOCUS = ("search", "--onlyvisible", "--limit", "1", "--name", "SphereCal", "windowfocus")  # there is no window manager
# What the large button says while the step's work runs: pressing it then would end the work.
NOT_TO_PRESS = ("Cancel", "Stop", "Stopping")


@contextlib.contextmanager
def virtual_screen(shown: Path | None = None) -> Iterator[str]:
    """The display's name while it is there; what it shows is in the file Xvfb_screen0 of the folder `shown`."""
    read, write = os.pipe()
    options = ["-fbdir", str(shown)] if shown is not None else []
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", SIZE, "-noreset", "-nolisten", "tcp", *options],
        pass_fds=(write,),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    try:
        with os.fdopen(read) as answers:
            yield f":{answers.readline().strip()}"
    finally:
        server.terminate()
        server.wait(10)


class Walk:
    """The program in its window, and the mouse or the keyboard. `folder` is the program's home, as seen from here.

    `pressed`: clicks, or keys, so far; `seconds`: what the whole walk took, once it has come to its end.
    """

    def __init__(
        self,
        command: list[str],
        folder: Path,
        display: str,
        root: Path | None,
        *,
        keys: bool = False,
        by_itself: bool = False,
    ) -> None:
        self.folder, self.display, self.began = folder, display, time.monotonic()
        self.keys, self.by_itself = keys, by_itself
        self.pressed, self.seconds = 0, 0.0
        own = "/" / folder.relative_to(root) if root is not None else folder
        self.map = folder / "map.json"
        kernels = os.environ.get("SPHERECAL_KERNELS", "strict")  # what was not compiled is an error, not only slow
        environment = {
            "PATH": "/usr/sbin:/usr/bin:/sbin:/bin",
            "HOME": str(own),
            "DISPLAY": display,
            "QT_QPA_PLATFORM": "xcb",
            "SPHERECAL_MAP": str(own / "map.json"),
            "LANG": "C.UTF-8",
            "SPHERECAL_KERNELS": kernels,
        }
        chroot = [shutil.which("chroot") or "/usr/sbin/chroot", str(root)] if root is not None else []
        with (folder / "out.txt").open("wb") as out:
            self.process = subprocess.Popen(
                [*chroot, *command, "--projects", str(own / "projects"), "--language", "en"],
                env=environment,
                stdout=out,
                stderr=subprocess.STDOUT,
            )

    def buttons(self) -> dict[str, list]:
        """Where each button is and whether it can be pressed, as the program tells."""
        try:
            return json.loads(self.map.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}

    def project(self) -> dict:
        """What the program has kept of the walk."""
        for file in (self.folder / "projects").glob("*/wizard.json"):
            with contextlib.suppress(OSError, ValueError):
                return json.loads(file.read_text(encoding="utf-8"))
        return {}

    def enabled(self, name: str) -> bool:
        """Whether a button is there and can be pressed."""
        return bool((self.buttons().get(name) or (0, 0, False))[2])

    def offer(self) -> str:
        """What the large button says; empty where it cannot be pressed, or would end what runs."""
        enabled, text = (self.buttons().get("action") or (0, 0, False, ""))[2:4]
        return text if enabled and not text.startswith(NOT_TO_PRESS) else ""

    def wait(self, done: Callable[[], object], what: str) -> None:
        """Until something has happened; SystemExit where the program ends before, or nothing happens."""
        until = time.monotonic() + PATIENCE_S
        while not done():
            if self.process.poll() is not None:
                said = (self.folder / "out.txt").read_text()[-3000:]
                sys.exit(f"the program ended while waiting for: {what}\n{said}")
            if time.monotonic() > until:
                self.picture("stuck")
                sys.exit(f"in vain: {what}; step {self.project().get('step')}, buttons {self.buttons()}")
            time.sleep(0.1)

    def click(self, name: str) -> None:
        """Press a button: by mouse, by the space bar where it is the page's own, else by Tab and Enter."""
        if not self.keys:
            self.settle()  # a page that is new may still move its buttons
            x, y = self.buttons()[name][:2]
            self.send("mousemove", str(x), str(y), "sleep", "0.1", "click", "1")
        elif name in ("action", "next"):
            time.sleep(SEEN_S)
            self.send(*FOCUS, "key", "space")
        else:
            for _ in range(MOST_TABS):
                if self.has_focus(name):
                    break
                self.send(*FOCUS, "key", "Tab")
                self.settle()
            else:
                sys.exit(f"{name} is not reached by the Tab key: {self.buttons()}")
            self.send(*FOCUS, "key", "Return")
        self.settle()

    def send(self, *words: str) -> None:
        """A click or a key to the screen."""
        self.pressed += 1
        command = ["xdotool", *words]
        subprocess.run(command, env=os.environ | {"DISPLAY": self.display}, check=True, timeout=PATIENCE_S)

    def has_focus(self, name: str) -> bool:
        """Whether the next Enter presses this button."""
        return bool((self.buttons().get(name) or [False])[-1])

    def settle(self) -> None:
        """Until the window has dealt with a click, however busy it is: its clock has ticked twice since."""
        for _ in range(2):
            ticks = self.ticks()
            self.wait(lambda ticks=ticks: self.ticks() != ticks, "the window answers")

    def ticks(self) -> int:
        """How often the program has looked where its buttons are."""
        return int(self.buttons().get("", [0])[0])

    def press(self, name: str) -> None:
        """Click a button as soon as it can be pressed."""
        self.wait(lambda: self.enabled(name), f"{name} can be pressed")
        self.click(name)

    def picture(self, name: str) -> None:
        """Of the whole screen, where ImageMagick is."""
        if shutil.which("import"):
            file = str(self.folder / f"{name.replace(':', '-')}.png")
            with contextlib.suppress(subprocess.TimeoutExpired):  # on a machine that is busier than the walk is patient
                subprocess.run(["import", "-display", self.display, "-window", "root", file], check=False, timeout=30)

    def say(self, what: str) -> None:
        """A line with the seconds since the start."""
        print(f"    {time.monotonic() - self.began:6.1f} s  {what}", flush=True)

    def taken(self) -> set[str]:
        """The placements and poses whose images are there."""
        found: set[str] = set()
        for file in (*self.folder.glob("projects/*/capture.json"), *self.folder.glob("projects/*/*/capture.json")):
            with contextlib.suppress(OSError, ValueError):
                found |= {one["id"] for one in json.loads(file.read_text(encoding="utf-8"))["sets"]}
        return found

    def is_done(self, step: str) -> bool:
        """Whether the program has kept what a step is for."""
        project = self.project()
        if step.startswith("placement:"):
            return step.partition(":")[2] in self.taken()
        if step == "scale":
            return set(project["scale_poses"]) <= self.taken()
        kept = {"connect": "artefacts", "look": "looked", "calibrate": "calibrated", "results": "accepted",
                "verify": "verified"}  # fmt: skip
        return bool(project.get(kept[step]))

    def step(self) -> None:
        """Press the large button until what the step is for is there, then go on."""
        now = self.project()["step"]
        if (self.by_itself and now.startswith("placement:")) or (now == "verify" and not self.keys):
            self.let_it_capture(now)
        else:
            while not self.is_done(now):
                self.wait(lambda: self.offer() or self.is_done(now), f"anything to do in {now}")
                if not self.is_done(now):
                    self.click("action")
        self.settle()
        self.picture(now)
        until = time.monotonic() + GOES_ON_S
        while self.project()["step"] == now and time.monotonic() < until:
            time.sleep(0.1)
        if self.project()["step"] == now:
            self.press("next")
        self.wait(lambda: self.project().get("step") != now, f"a step after {now}")
        self.say(now)

    def let_it_capture(self, now: str) -> None:
        """Have the window capture this step by itself; two poses of the bar are enough."""
        if now == self.placements()[0]:
            self.press("automatic")
        if now == "verify":
            self.press("automatic-bar")
            self.wait(lambda: len(self.taken() & set(self.project()["check_poses"])) >= 2, "two poses of the bar")
            self.press("measure-now")
        self.wait(lambda: self.is_done(now), f"{now} by itself")

    def placements(self) -> list[str]:
        """The steps of the placements."""
        return [f"placement:{name}" for name in self.project()["placements"]]

    def written(self) -> bool:
        """Whether the report is there, whole."""
        reports = list((self.folder / "projects").glob("*/report.pdf"))
        return bool(reports) and reports[0].read_bytes().rstrip().endswith(b"%%EOF")

    def go(self) -> None:
        """From the start page to the report and back."""
        self.press("new-simulated")
        self.wait(lambda: self.project().get("step"), "the first step")
        self.say("start page")
        while self.project()["step"] != "save":
            self.step()
        project = self.project()
        for key, wanted in (("calibrated", "valid"), ("verified", "consistent")):
            if (project.get(key) or {}).get("verdict") != wanted:
                sys.exit(f"{key}: {project.get(key)}")
        self.wait(lambda: self.offer() == "Save and put to use", "it can be saved")
        self.click("action")
        self.wait((self.folder / "projects" / "training-profile" / "rig.json").is_file, "the profile")
        self.wait(lambda: self.offer() == "Write the report", "it is saved")
        self.click("action")
        self.wait(lambda: self.written() and self.enabled("action"), "the report")
        self.picture("save")
        self.say("profile and report written")
        self.wait(lambda: self.offer() == "Finish", "the end")
        self.click("action")
        self.wait(lambda: self.enabled("check"), "the start page offers to check the rig")
        self.picture("start")
        self.say("start page; the rig can be checked")
        if "Traceback" in (self.folder / "out.txt").read_text():
            sys.exit((self.folder / "out.txt").read_text()[-3000:])


def walk(
    command: list[str], folder: Path, root: Path | None = None, *, keys: bool = False, by_itself: bool = False
) -> Walk:
    """The whole walk, with `seconds` and `pressed`. SystemExit with the reason where it does not come to its end."""
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o777)
    with virtual_screen() as display:
        made = Walk(command, folder, display, root, keys=keys, by_itself=by_itself)
        try:
            made.go()
            made.seconds = time.monotonic() - made.began
        finally:
            made.process.terminate()
            made.process.wait(PATIENCE_S)
    return made


def main() -> int:
    """Walk, and say how long each step took."""
    arguments = sys.argv[1:]
    program = ["spherecal-gui"]
    if "--" in arguments:
        at = arguments.index("--")
        arguments, program = arguments[:at], arguments[at + 1 :]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--root", type=Path)
    parser.add_argument("--keys", action="store_true", help="by the keyboard alone")
    parser.add_argument("--by-itself", action="store_true", help="the window captures placements and poses by itself")
    options = parser.parse_args(arguments)
    root = options.root.resolve() if options.root is not None else None
    done = walk(program, options.folder.resolve(), root, keys=options.keys, by_itself=options.by_itself)
    print(f"ok  whole walk: {done.seconds:.0f} s, {done.pressed} {'keys' if options.keys else 'clicks'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
