"""A source of simulated cameras, with the faults that they can have."""

import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_cameras.in_process import InProcessSource, NoImage
from spherecal_cameras.protocol import CameraInfo, CameraSettings, CameraState, Frame, SourceKind
from spherecal_cameras.simulated.draw import digitise
from spherecal_cameras.simulated.stage import ArtefactPose, Stage, StageView

FaultKind = Literal["lose", "delay", "drop", "blur", "dim", "bump"]
_USUAL: dict[str, float] = {"lose": 0.0, "delay": 2.0, "drop": 0.0, "blur": 3.0, "dim": 0.25, "bump": 0.5}


@dataclass(frozen=True)
class SimulatedFault:
    """What goes wrong with a simulated camera (its id or serial) from set `first_set` to `last_set` (None: for good).

    `lose`: it is unplugged. `delay`: its images come `amount` s late. `drop`: it ignores the first trigger of each set.
    `blur`: its lens is out of focus by `amount` px. `dim`: its images have `amount` times the light. `bump`: it is
    turned by `amount` degrees. `first_set` 0 includes the live view before the first set.
    """

    kind: FaultKind
    camera: str
    amount: float | None = None
    first_set: int = 0
    last_set: int | None = None

    @property
    def size(self) -> float:
        """The amount, or the usual one of its kind."""
        return _USUAL[self.kind] if self.amount is None else self.amount

    def active(self, number: int) -> bool:
        """Whether it is there in the set of this number."""
        return number >= self.first_set and (self.last_set is None or number <= self.last_set)


def parse_fault(text: str) -> SimulatedFault:
    """A fault written as KIND:CAMERA[:AMOUNT][@FIRST[-LAST]], such as `lose:C03@2-3`."""
    body, _, sets = text.partition("@")
    kind, _, rest = body.partition(":")
    camera, _, amount = rest.partition(":")
    first, dash, last = sets.partition("-")
    try:
        known = next((known for known in get_args(FaultKind) if known == kind), None)
        if known is None or not camera:
            raise ValueError
        until = int(last) if last else (None if dash or not sets else int(first))
        return SimulatedFault(known, camera, float(amount) if amount else None, int(first) if first else 0, until)
    except ValueError:
        raise InputError(Phrase("error-bad-fault", {"text": repr(text), "kinds": list(get_args(FaultKind))})) from None


PREFIX = "SIM-"
_NOMINAL_EXPOSURE_US = 10_000.0
_WARM_C = 41.0


class SimulatedSource(InProcessSource):
    """The simulated cameras of a preset rig; `stage` moves ball and bars, `faults` may be exchanged at any time."""

    kind: SourceKind = "simulated"

    def __init__(
        self,
        preset: str = "demo",
        seed: int = 1,
        faults: Iterable[SimulatedFault] = (),
        rendered: bool = False,
        stage: Stage | None = None,
    ) -> None:
        super().__init__()
        self.stage = stage or Stage(preset, seed)
        self.session, self.poses = self.stage.session, self.stage.poses
        self.label = f"SIMULATED: rig {self.stage.preset}, no real cameras"
        self._rendered = rendered
        self._rng = np.random.default_rng([seed, 77])
        self._index = {PREFIX + camera.id: i for i, camera in enumerate(self.stage.truth.cameras)}
        self._pictures: dict[str, tuple[object, NDArray[np.float32]]] = {}
        self._picture_locks = {serial: threading.Lock() for serial in self._index}
        self._exposed: Mapping[str, ArtefactPose] = {}
        self.faults: tuple[SimulatedFault, ...] = ()
        for fault in faults:
            self.inject(fault)

    @property
    def shown(self) -> str:
        """The id of what is shown."""
        return self.stage.shown

    def show(self, pose: str) -> None:
        """Put the ball to a placement, or a bar into a pose."""
        self.stage.show(pose)

    def inject(self, fault: SimulatedFault) -> None:
        """Add a fault."""
        serial = fault.camera if fault.camera in self._index else PREFIX + fault.camera
        if serial not in self._index:
            known = ", ".join(camera.id for camera in self.stage.truth.cameras)
            raise InputError(Phrase("error-no-simulated-camera", {"camera": repr(fault.camera), "names": known}))
        self.faults = (*self.faults, replace(fault, camera=serial))

    def heal(self, camera: str) -> None:
        """Take all faults of a camera (its id or serial) away."""
        self.faults = tuple(fault for fault in self.faults if fault.camera not in (camera, PREFIX + camera))

    def camera_infos(self) -> tuple[CameraInfo, ...]:
        """The rig's cameras; the name of each is its id."""
        return tuple(
            CameraInfo(
                PREFIX + camera.id,
                camera.kind.model,
                "simulated",
                self.label,
                "simulated",
                camera.id,
                camera.id,
                image_size=camera.kind.image_size,
                access="free",
            )
            for camera in self.stage.truth.cameras
        )

    def triggered(self, exposed_s: Mapping[str, float]) -> None:
        """Keep what is there at the cameras' moments of exposure (s, by serial): drawing takes too long for that."""
        self._exposed = {serial: self.stage.at(moment) for serial, moment in exposed_s.items()}

    def take_image(self, serial: str, settings: CameraSettings, number: int, attempt: int, timeout_s: float) -> Frame:
        """One image, drawn or rendered with the faults that the simulated camera has now."""
        began = time.perf_counter()  # the scene is drawn as it is now, which takes a second where others work too
        now = number or self.sets_taken + 1  # the live view shows the state of the set to come
        faults = {fault.kind: fault for fault in self.faults if fault.camera == serial and fault.active(now)}
        _deliverable(faults, number, attempt, timeout_s)
        turn = np.deg2rad(faults["bump"].size) if "bump" in faults else 0.0
        view = StageView(turned_rad=(0.0, turn, 0.0))
        if "blur" in faults:
            view = replace(view, blur_px=float(np.hypot(view.blur_px, faults["blur"].size)))
        light = settings.exposure_us / _NOMINAL_EXPOSURE_US * (faults["dim"].size if "dim" in faults else 1.0)
        artefact = self._exposed[serial] if number else self.stage.at()
        picture = self._picture(serial, replace(view, brightness=light), artefact)
        bits = 12 if "12" in settings.pixel_format else 10 if "10" in settings.pixel_format else 8
        with self._lock:
            rng = np.random.default_rng(self._rng.integers(2**63))
        image = digitise(picture, bits, 10 ** (settings.gain_db / 20), rng)
        if (cut := settings.region) is not None:
            image = image[cut.y : cut.y + cut.height, cut.x : cut.x + cut.width]
        image.flags.writeable = False
        arrived = time.perf_counter()
        temperature = _WARM_C + 0.5 * float(np.sin(arrived / 900 + self._index[serial]))  # at most 0.03 K a minute
        return Frame(
            serial, image, bits, f"Mono{bits}", began, arrived, self.next_frame_id(serial), self.stamp_ns(), None,
            settings.exposure_us, settings.gain_db, round(temperature, 2),
        )  # fmt: skip

    def _picture(self, serial: str, view: StageView, artefact: ArtefactPose) -> NDArray[np.float32]:
        """The noise-free image, kept while nothing changes."""
        with self._picture_locks[serial]:
            key = (artefact, view)
            kept = self._pictures.get(serial)
            if kept is None or kept[0] != key:
                kept = (key, self.stage.picture(self._index[serial], view, self._rendered, artefact))
                self._pictures[serial] = kept
        return kept[1]


def _deliverable(faults: dict[str, SimulatedFault], number: int, attempt: int, timeout_s: float) -> None:
    """Raise NoImage where a fault keeps the image away."""
    if "lose" in faults:
        raise NoImage("The camera no longer answers (simulated).", "Take the simulated fault away.", CameraState.LOST)
    if number and "drop" in faults and attempt == 1:
        raise NoImage(f"It sent no image within {timeout_s:g} s (simulated).", "Try again.")
    if "delay" in faults and number:
        seconds = faults["delay"].size
        if seconds > timeout_s:
            time.sleep(timeout_s)
            raise NoImage(f"It sent no image within {timeout_s:g} s (simulated).", "Allow more time.")
        time.sleep(seconds)
