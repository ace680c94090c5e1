"""Finding cameras: every producer file is tried in a process of its own, so that a broken one harms no other."""

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

from spherecal.base.context import Context
from spherecal.base.messages.values import Phrase
from spherecal_cameras.genicam.messages import Probed
from spherecal_cameras.genicam.trust import Admitted, Ask, TrustStore, admit, hash_of, hold
from spherecal_cameras.genicam.wire import Inbox, WireError, pack
from spherecal_cameras.makers import driver_patterns, own_folder
from spherecal_cameras.protocol import CameraInfo, CamerasNotInstalled, Discovery, ProducerVerdict

ENVIRONMENT = "GENICAM_GENTL64_PATH"
_PATIENCE_S = 20.0  # drivers of network cameras search for some seconds
_AT_ONCE = 3
_LOOK_S = 0.05


def producer_files(own: Iterable[str] = ()) -> tuple[str, ...]:
    """All producer files (.cti) once: the user's own (also absent ones), the environment's and makers' folders."""
    files: list[Path] = []
    for path in (Path(entry).expanduser() for entry in own if entry):
        files += (sorted(path.glob("*.cti")) if path.is_dir() else []) or [path]
    for folder in filter(None, os.environ.get(ENVIRONMENT, "").split(os.pathsep)):
        files += sorted(Path(folder).glob("*.cti"))
    for pattern in driver_patterns("linux" if sys.platform.startswith("linux") else sys.platform):
        anchor = Path(Path(pattern).anchor)
        with suppress(OSError, ValueError):  # a variable may hold anything
            files += sorted(anchor.glob(str(Path(pattern).relative_to(anchor))))
    files += sorted(own_folder().glob("*.cti"))
    found: dict[str, str] = {}
    for file in files:
        found.setdefault(os.path.realpath(file), str(file))
    return tuple(found.values())


def discover(
    files: Sequence[str], context: Context | None = None, trust: TrustStore | None = None, ask: Ask | None = None
) -> Discovery:
    """Every camera that the producer files reach, each tried in its own process; `trust` None: all are loaded."""
    check_packages()
    context = context or Context()
    verdicts: dict[str, ProducerVerdict] = {}
    waiting: list[Admitted] = []
    running: list[_Probe] = []
    for file in files:
        admitted = _admitted(file, trust, ask)
        if isinstance(admitted, ProducerVerdict):
            verdicts[file] = admitted
        else:
            waiting.append(admitted)
    try:
        while waiting or running:
            while waiting and len(running) < _AT_ONCE:
                running.append(_Probe(waiting.pop(0)))
            for probe in list(running):
                verdict = probe.verdict()
                if verdict is not None:
                    verdicts[probe.file] = verdict
                    running.remove(probe)
            context.report("looking for cameras", len(verdicts) / max(len(files), 1), "")
            time.sleep(_LOOK_S / 5 if running else 0)
    finally:
        for probe in running:
            probe.end()
    return together([verdicts[file] for file in files])


def _admitted(file: str, trust: TrustStore | None, ask: Ask | None) -> Admitted | ProducerVerdict:
    """What to load for a file, or a verdict that says why nothing is."""
    if (early := _check_file(file)) is not None:
        return early
    if trust is None:
        return Admitted(file, os.path.realpath(file), "")
    found = admit(trust, file, ask)
    return (
        found
        if isinstance(found, Admitted)
        else ProducerVerdict(file, False, found.message, found.hint, refused=found.allowable)
    )


def together(verdicts: Sequence[ProducerVerdict]) -> Discovery:
    """Every camera once, by the first producer; of two makers with one serial number model or address is added."""
    cameras: dict[str, CameraInfo] = {}
    doubles: list[CameraInfo] = []
    for verdict in verdicts:
        for camera in verdict.cameras:
            held = cameras.setdefault(camera.serial, camera)
            if held is camera:
                continue
            elsewhere = bool(held.address and camera.address) and held.address != camera.address
            if elsewhere or _other_maker(held, camera):
                longer = replace(camera, serial=f"{camera.serial} ({camera.address if elsewhere else camera.model})")
                if cameras.setdefault(longer.serial, longer) is not longer:
                    doubles.append(longer)
            elif held.access == "unreachable" and camera.access in ("free", "unknown"):
                cameras[camera.serial] = camera
                doubles.append(held)
            else:
                doubles.append(camera)
    return Discovery(tuple(cameras[s] for s in sorted(cameras)), tuple(verdicts), tuple(doubles))


def _other_maker(one: CameraInfo, other: CameraInfo) -> bool:
    """Whether maker and model differ, and not only in how a driver writes them (`Basler`, `Basler AG`)."""

    def differ(a: str, b: str) -> bool:
        first, second = ("".join(filter(str.isalnum, text)).lower() for text in (a, b))
        return bool(first and second) and first not in second and second not in first

    return differ(one.vendor, other.vendor) and differ(one.model, other.model)


def check_packages() -> None:
    """Check that harvesters and genicam can be loaded."""
    try:
        import genicam.gentl  # noqa: F401
        import harvesters.core  # noqa: F401
    except ImportError as error:
        hint = Phrase("error-install-cameras")
        if "libpython" in str(error):
            version = f"{sys.version_info.major}.{sys.version_info.minor}"
            hint = Phrase("error-install-libpython", {"version": version})
        raise CamerasNotInstalled(Phrase("error-genicam-packages", {"why": str(error)}), hint) from error


class _Probe:
    """A process that loads one file and lists its cameras."""

    def __init__(self, driver: Admitted) -> None:
        self.file = driver.file
        self._began = time.perf_counter()
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe(duplex=False)
        self._inbox = Inbox(self._ours, (Probed,))
        known = (driver.file, driver.load, driver.sha256)
        self._process = context.Process(target=probe, args=(known, theirs), daemon=True, name="spherecal-probe")
        self._process.start()
        theirs.close()

    def verdict(self) -> ProducerVerdict | None:
        """What came out; None while the process is at work."""
        seconds = time.perf_counter() - self._began
        answer: ProducerVerdict | None = None
        try:
            if self._ours.poll(0):
                found = next(self._inbox.messages(), None)
                answer = found.verdict if found is not None else None
            elif seconds > _PATIENCE_S:
                answer = ProducerVerdict(
                    self.file,
                    False,
                    f"The driver gave no answer within {_PATIENCE_S:.0f} s.",
                    "Unplug cameras that do not answer, or install the driver again.",
                )
        except (WireError, OSError) as error:
            answer = ProducerVerdict(self.file, False, f"The driver does not work ({error}).", "Install it again.")
        except EOFError:
            self._process.join(_PATIENCE_S)
            ended = end_word(self._process.exitcode)
            said = f"The driver crashed while it was loaded or searched for cameras ({ended})."
            answer = ProducerVerdict(self.file, False, said, "Update or remove it; other drivers are not affected.")
        if answer is None:
            return None
        self.end()
        return replace(answer, seconds=seconds)

    def end(self) -> None:
        """End the process, if it has not ended."""
        self._ours.close()
        self._process.join(0.5)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()


def _check_file(file: str) -> ProducerVerdict | None:
    path = Path(file)
    if path.is_dir():
        return ProducerVerdict(file, False, "The folder holds no .cti file.", "Name the driver's folder or file.")
    if not path.is_file():
        return ProducerVerdict(file, False, "There is no such file.", "Take it off the list, or install the driver.")
    if path.stat().st_size == 0:
        return ProducerVerdict(file, False, "The file is empty.", "Install the driver again.")
    return None


def end_word(code: int | None) -> str:
    """How a process ended, in words."""
    if code is None:
        return "no exit code"
    if code < 0:
        with suppress(ValueError):
            return signal.Signals(-code).name
    return f"exit code {code}"


def probe(driver: tuple[str, str, str], connection: Connection) -> None:
    """Load a driver in the probe process, send a verdict (`Probed`), and end the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    connection.send_bytes(pack(Probed(_load(driver))))
    connection.close()
    os._exit(0)  # drivers have crashed while being unloaded (harvesters issue 487); nothing is left to save


def _load(driver: tuple[str, str, str]) -> ProducerVerdict:
    import ctypes

    from spherecal_cameras.genicam.hub import Producer

    file, load, sha256 = driver
    try:
        hold(load)
        if sha256 and hash_of(load) != sha256:
            return ProducerVerdict(file, False, "This is not the file that was allowed.", "Look for cameras again.")
        ctypes.CDLL(load)
    except OSError as error:
        return ProducerVerdict(file, False, f"The file cannot be loaded ({error}).", _load_hint(str(error)))
    try:
        producer = Producer(file, load, sha256)
    except Exception as error:
        return ProducerVerdict(file, False, f"The driver does not work ({error}).", "Install it again.")
    if producer.problem:
        return ProducerVerdict(
            file,
            False,
            f"The driver does not start ({producer.problem}).",
            "If another program uses it, close that; else install it again.",
        )
    cameras = producer.infos()
    if not cameras:
        return ProducerVerdict(
            file,
            True,
            "The driver works, but sees no camera.",
            "Check power, cables and the network card's address; some drivers only see their maker's cameras.",
        )
    return ProducerVerdict(file, True, f"{len(cameras)} camera{'s' * (len(cameras) > 1)}.", "", cameras)


def _load_hint(text: str) -> str:
    if "ELF" in text or "not a valid" in text:
        return "It is damaged, or made for another kind of machine: install the driver for this one."
    if "No such file" in text or "cannot open shared object" in text:
        return "A library that it needs is missing: install the driver with its maker's installer, never copy the file."
    return "Install the driver again with its maker's installer."
