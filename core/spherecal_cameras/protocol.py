"""What every source of camera images offers, and the frozen data that passes: the seam for commands and window.

A source is `genicam` (real cameras), `replay` (a session folder as live cameras) or `simulated`. All three are used
in the same way::

    with open_source("simulated:demo") as source:            # spherecal_cameras.sources
        discovery = source.discover()
        source.open(discovery.serials, {})                   # {}: default settings for all

        source.start_live(5.0)
        frame = source.latest(discovery.serials[0])          # newest frame or None, never waits
        taken = source.capture_set(CaptureRequest())         # waits: call it in a worker thread

Cameras are named by serial number everywhere; names for people are in the camera profile (profile.py). Times ending in
`_s` are seconds of `time.perf_counter()`, which all processes of a machine share. Methods may be called from any
thread. `latest`, `statuses` and `take_events` never wait; the others may, and raise `CameraError`. The data
types are part of the protocol: fields may be added, with a default, but not renamed.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Literal, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from spherecal.base.context import Context
from spherecal.base.errors import SpherecalError

if TYPE_CHECKING:  # the camera process needs no sessions
    from spherecal.data.session import Session

GreyPixels = NDArray[np.uint8] | NDArray[np.uint16]
SourceKind = Literal["genicam", "replay", "simulated"]
TriggerMode = Literal["software", "hardware", "free", "scheduled"]


class CameraError(SpherecalError):
    """Something about cameras that the user has to know: which camera or file, the likely cause, what to do."""


class CamerasNotInstalled(CameraError):
    """The packages for live cameras are missing or cannot be loaded."""

    exit_code = 3


class CameraState(StrEnum):
    """What a camera is doing; the value is the word shown to people."""

    FOUND = "found"  # listed, not opened by us
    CONNECTED = "connected"  # open and set up, no images asked for
    STREAMING = "streaming"
    NO_TRIGGER = "no trigger"  # waits for a trigger that does not come
    INCOMPLETE_FRAMES = "incomplete frames"  # images arrive with parts missing
    LOST = "lost"  # no longer reachable; re-opened by itself when it returns
    BUSY = "busy"  # held by another program
    ERROR = "error"

    @property
    def usable(self) -> bool:
        """Whether images can be expected of a camera in this state."""
        return self in (CameraState.CONNECTED, CameraState.STREAMING, CameraState.INCOMPLETE_FRAMES)


# --- finding cameras -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CameraInfo:
    """A camera as it was found; `producer` is the file (or source) that reaches it.

    `image_size` (width, height) in px is None until the camera has been opened. `access` is `free`, `busy` (another
    program has it), `unreachable` or `unknown`. `address` is an IP address or a bus place where one is known.
    """

    serial: str
    model: str
    vendor: str
    producer: str
    transport: str = ""
    user_name: str = ""
    device_id: str = ""
    address: str = ""
    image_size: tuple[int, int] | None = None
    access: Literal["free", "busy", "unreachable", "unknown"] = "unknown"


@dataclass(frozen=True)
class ProducerVerdict:
    """What became of one producer file (.cti): the cameras it reaches, or why it cannot be used and what to do."""

    file: str
    usable: bool
    message: str
    hint: str = ""
    cameras: tuple[CameraInfo, ...] = ()
    seconds: float = 0.0
    refused: bool = False  # not loaded, because nobody has allowed it


@dataclass(frozen=True)
class Discovery:
    """Every camera once, sorted by serial, and a verdict for every producer file."""

    cameras: tuple[CameraInfo, ...]
    producers: tuple[ProducerVerdict, ...] = ()
    doubles: tuple[CameraInfo, ...] = ()  # listed by a second producer too; reached through the first one

    @property
    def serials(self) -> tuple[str, ...]:
        """The cameras' serial numbers."""
        return tuple(camera.serial for camera in self.cameras)

    def camera(self, serial: str) -> CameraInfo | None:
        """The camera with this serial number, None where there is none."""
        return next((camera for camera in self.cameras if camera.serial == serial), None)


# --- setting up ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Region:
    """A part of the sensor: left and top offset, width and height in px."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True)
class CameraSettings:
    """All settings that a camera is given after each opening; nothing is left to what it remembers.

    `pixel_format` is a GenICam name (Mono8, Mono10, Mono12, Mono12p, BayerRG8, ...); where the camera lacks it the
    nearest one is taken and reported. `region` None is the whole sensor. `trigger_source` is the input of a hardware
    trigger; `scheduled` is an action command for a moment of the clock that cameras share by IEEE 1588 (PTP).
    `frame_rate_hz` None lets the camera run as fast as it can; it does not limit triggers. `packet_size`,
    `packet_delay` and `frame_delay` (ticks of the camera's clock) None leave what the driver negotiated, as does
    `throughput_bytes_s`, the most that the camera sends.
    """

    exposure_us: float = 10_000.0
    gain_db: float = 0.0
    pixel_format: str = "Mono8"
    region: Region | None = None
    trigger: TriggerMode = "software"
    trigger_source: str = "Line1"
    frame_rate_hz: float | None = None
    packet_size: int | None = None
    packet_delay: int | None = None
    frame_delay: int | None = None
    throughput_bytes_s: int | None = None


@dataclass(frozen=True)
class FeatureReport:
    """One feature after setting up: the camera's own name for it (None: it has none), wanted and actual value."""

    feature: str
    node: str | None
    wanted: str = ""
    got: str = ""
    problem: str = ""  # empty where it took its setting, or a missing feature is of no consequence


@dataclass(frozen=True)
class SetupReport:
    """How the setting up of one camera went; `image_size` (width, height) px of its images."""

    serial: str
    features: tuple[FeatureReport, ...] = ()
    image_size: tuple[int, int] | None = None
    seconds: float = 0.0

    @property
    def problems(self) -> tuple[FeatureReport, ...]:
        """The features that are not as wanted."""
        return tuple(feature for feature in self.features if feature.problem)

    @property
    def missing(self) -> tuple[str, ...]:
        """The features that this camera does not have; that is normal."""
        return tuple(feature.feature for feature in self.features if feature.node is None)


# --- images ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Frame:
    """One image: `image` (height, width) in memory of its own, not writeable, `bits` significant bits in the low bits.

    A Bayer mosaic is left as it is (`spherecal.targets.images.balance_mosaic` makes it grey). `time_stamp_ns` and
    `frame_id` are the camera's, `taken_s` the moment of exposure in the computer's time as well as it is known,
    `arrived_s` when the image was there. `round` counts trigger rounds. Averages have `averaged` > 1.
    `common_clock`: the time stamp is of a clock that the camera shares with others (IEEE 1588).
    """

    camera: str
    image: GreyPixels
    bits: int
    pixel_format: str
    taken_s: float
    arrived_s: float
    frame_id: int | None = None
    time_stamp_ns: int | None = None
    round: int | None = None
    exposure_us: float | None = None
    gain_db: float | None = None
    temperature_c: float | None = None
    averaged: int = 1
    common_clock: bool = False


@dataclass(frozen=True)
class MissingFrame:
    """A camera whose image is missing from a set, and why."""

    camera: str
    cause: str
    remedy: str


@dataclass(frozen=True)
class CaptureRequest:
    """A set to take: of which cameras (None: all that are open), how long to wait a try, how often to try again."""

    cameras: tuple[str, ...] | None = None
    timeout_s: float = 1.0
    retries: int = 2


@dataclass(frozen=True, eq=False)
class FrameSet:
    """Images that belong together, by serial; `missing` names the cameras that did not deliver in any try.

    `spread_s` is the largest difference between the moments of exposure, None for fewer than two images. It is taken
    from the cameras' time stamps where all share a clock (`common_clock`), else from the computer's time as well as it
    is known. `late` names the cameras for which a try was repeated.
    """

    number: int
    frames: Mapping[str, Frame]
    missing: tuple[MissingFrame, ...] = ()
    late: tuple[str, ...] = ()
    attempts: int = 1
    seconds: float = 0.0
    spread_s: float | None = None
    common_clock: bool = False

    @property
    def complete(self) -> bool:
        """Whether every camera delivered."""
        return not self.missing


# --- state, counters, events -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Counters:
    """What was counted since the camera was opened."""

    delivered: int = 0  # whole images
    incomplete: int = 0  # images with parts missing
    underrun: int = 0  # images the driver had no buffer for
    overwritten: int = 0  # images that nobody fetched in time
    reopened: int = 0  # returns after a loss
    rate_hz: float = 0.0  # of whole images, now
    wanted_hz: float | None = None  # None: none in particular
    triggered: int = 0  # software triggers and action commands
    late: int = 0  # answers to a register read for which all cameras had to wait


@dataclass(frozen=True)
class CameraStatus:
    """The state of one camera in words: `cause` and `remedy` are empty where all is well."""

    serial: str
    state: CameraState
    cause: str = ""
    remedy: str = ""
    counters: Counters = field(default_factory=Counters)
    temperature_c: float | None = None


class EventKind(StrEnum):
    """What an event is about."""

    STATE = "state"  # a camera's state changed; `status` is set
    SERVICE_LOST = "service lost"  # the camera process ended or hung; it is being started again
    SERVICE_BACK = "service back"  # ... and is back with all cameras that can be reached
    NOTICE = "notice"


@dataclass(frozen=True)
class CameraEvent:
    """Something that happened, with words for people; `camera` is a serial or None for all."""

    kind: EventKind
    message: str
    hint: str = ""
    camera: str | None = None
    at_s: float = 0.0
    status: CameraStatus | None = None


# --- the source ------------------------------------------------------------------------------------------------------


@runtime_checkable
class CameraSource(Protocol):
    """Cameras to take images with; use it in a `with` block, or close it."""

    @property
    def kind(self) -> SourceKind:
        """Which of the sources this is."""
        ...

    @property
    def label(self) -> str:
        """What the screen has to say about the images' origin, such as `SIMULATED: demo`; empty for real cameras."""
        ...

    def discover(self, context: Context | None = None) -> Discovery:
        """The cameras that can be found now; may take seconds. Cameras that are open stay so.

        Raises
        ------
        CamerasNotInstalled
            Where the packages for GenICam cameras are missing.
        Cancelled
            Where the context says so.
        """
        ...

    def open(self, serials: Iterable[str], settings: Mapping[str, CameraSettings]) -> tuple[SetupReport, ...]:
        """Open and set up exactly these cameras (others are closed); the report of each that could be opened.

        A camera that cannot be opened now does not raise: its state says why, and it is opened when it returns.

        Parameters
        ----------
        serials
            Serial numbers of the cameras.
        settings
            Settings by serial; cameras that are not in it have the defaults.

        Raises
        ------
        CameraError
            Where a camera was never found, or none was named.
        """
        ...

    def apply(self, settings: Mapping[str, CameraSettings]) -> tuple[SetupReport, ...]:
        """Set up open cameras with new settings, by serial, live or not; they are kept for every later opening.

        Raises
        ------
        CameraError
            Where a camera is not open.
        """
        ...

    def start_live(self, rate_hz: float = 5.0) -> None:
        """Keep fresh images coming for `latest`; cameras with software trigger are triggered at `rate_hz`.

        Raises
        ------
        CameraError
            Where no camera is open.
        """
        ...

    def stop_live(self) -> None:
        """No images but those of sets."""
        ...

    def latest(self, serial: str) -> Frame | None:
        """The camera's newest image (a one-slot mailbox: older ones are dropped), None if there was none yet."""
        ...

    def capture_set(self, request: CaptureRequest | None = None, context: Context | None = None) -> FrameSet:
        """Take one set of images exposed after this call; complete or not, it says who is missing.

        Works with and without live view.

        Parameters
        ----------
        request
            Which cameras, how long to wait and how often to try again; None is `CaptureRequest()`.
        context
            To stop; None never stops.

        Raises
        ------
        CameraError
            Where no camera is open, or a requested one is not.
        Cancelled
            Where the context says so.
        """
        ...

    def statuses(self) -> dict[str, CameraStatus]:
        """The state of every camera that was opened, by serial."""
        ...

    def take_events(self) -> Sequence[CameraEvent]:
        """The events since the last call, oldest first."""
        ...

    def close(self) -> None:
        """Release all cameras, end what was started; may be called twice."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


@runtime_checkable
class Recorded(Protocol):
    """A source whose cameras are those of a session: a recording, or a simulated rig."""

    @property
    def session(self) -> "Session":
        """The session."""
        ...


@runtime_checkable
class Described(Protocol):
    """A source that lists the features of its cameras."""

    def describe(self, serial: str) -> tuple[FeatureReport, ...]:
        """The features of an open camera with their present values; none while it is lost."""
        ...


def session_behind(source: object) -> "Session | None":
    """The session of a recording or a simulated rig; None for real cameras."""
    return source.session if isinstance(source, Recorded) else None


def features_of(source: object, serial: str) -> tuple[FeatureReport, ...]:
    """The features of a camera with their present values; empty for sources that cannot list them."""
    return source.describe(serial) if isinstance(source, Described) else ()
