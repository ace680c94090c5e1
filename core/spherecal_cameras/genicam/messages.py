"""What passes between the program and its camera process: commands one way, reports the other."""

from dataclasses import dataclass, field
from typing import get_args

from spherecal_cameras import protocol

WIRE_VERSION = 4


@dataclass(frozen=True)
class RequestedCamera:
    """A camera to keep open: its producer file, what to load for it, its hash, the driver's name, its settings."""

    serial: str
    producer: str
    load: str
    sha256: str
    settings: protocol.CameraSettings
    device_id: str = ""


@dataclass(frozen=True)
class Open:
    """Keep exactly these cameras open from now on; answered by one `Answer` when each was tried once."""

    request: int
    cameras: tuple[RequestedCamera, ...]


@dataclass(frozen=True)
class Apply:
    """Give cameras new settings; answered by `Answer`."""

    request: int
    settings: dict[str, protocol.CameraSettings]


@dataclass(frozen=True)
class UseRing:
    """Where the images of a camera go from now on."""

    serial: str
    name: str
    slots: int
    slot_bytes: int


@dataclass(frozen=True)
class Acquire:
    """Let the cameras send images, or not."""

    on: bool


@dataclass(frozen=True)
class Live:
    """Trigger all cameras with software trigger at this rate; None stops that."""

    rate_hz: float | None


@dataclass(frozen=True)
class Trigger:
    """Trigger these cameras once, now; reported by `Triggered`."""

    round: int
    serials: tuple[str, ...]


@dataclass(frozen=True)
class Describe:
    """Ask for all features of an open camera; answered by `Answer` with a report without a size."""

    request: int
    serial: str


@dataclass(frozen=True)
class Indicate:
    """Switch an open camera's own light on or off; answered by `Answer`, with a feature where it has such a light."""

    request: int
    serial: str
    on: bool


@dataclass(frozen=True)
class Quit:
    """Close everything and end."""


Command = Open | Apply | UseRing | Acquire | Live | Trigger | Describe | Indicate | Quit


@dataclass(frozen=True)
class Hello:
    """The first word of the process."""

    version: int
    pid: int


@dataclass(frozen=True)
class Working:
    """What is done now and may keep the process silent for so long (s); without it silence means that it hangs."""

    what: str
    allow_s: float


@dataclass(frozen=True)
class Alive:
    """Heartbeat, several a second, with what is not worth a message of its own."""

    counters: dict[str, protocol.Counters] = field(default_factory=dict)
    temperatures: dict[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Opened:
    """A camera was opened and set up; its images take up to `image_bytes`. `again` after a loss."""

    report: protocol.SetupReport
    image_bytes: int
    again: bool


@dataclass(frozen=True)
class StateIs:
    """The state of a camera."""

    serial: str
    state: protocol.CameraState
    cause: str = ""
    remedy: str = ""


@dataclass(frozen=True)
class Answer:
    """The answer to a command with a request number."""

    request: int
    reports: tuple[protocol.SetupReport, ...] = ()
    features: tuple[protocol.FeatureReport, ...] = ()


@dataclass(frozen=True)
class Triggered:
    """A trigger round was sent; `refused` says which cameras did not take it, and why."""

    round: int
    refused: dict[str, str]


@dataclass(frozen=True)
class FrameMeta:
    """An image that is in slot `slot` of its camera's ring under the number `sequence`."""

    serial: str
    ring: str
    slot: int
    sequence: int
    height: int
    width: int
    deep: bool  # 16 bits a pixel
    bits: int
    pixel_format: str
    taken_s: float
    uncertainty_s: float
    arrived_s: float
    frame_id: int | None
    time_stamp_ns: int | None
    round: int | None
    exposure_us: float | None
    gain_db: float | None
    temperature_c: float | None
    common_clock: bool = False


@dataclass(frozen=True)
class Slow:
    """A camera that took long to answer a register read."""

    serial: str
    seconds: float


@dataclass(frozen=True)
class Probed:
    """What a probe found out about a driver file."""

    verdict: protocol.ProducerVerdict


Report = Hello | Working | Alive | Opened | StateIs | Answer | Triggered | FrameMeta | Slow
COMMANDS: tuple[type, ...] = get_args(Command)
REPORTS: tuple[type, ...] = get_args(Report)
