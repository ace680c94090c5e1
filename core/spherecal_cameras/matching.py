"""Which frames belong to one moment, by number or time, and cameras' clocks against the computer's."""

from collections import deque
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from spherecal_cameras.protocol import TriggerMode

# What is assumed where the camera's clock could not be read out: images reach the computer within this time of their
# exposure's end (12 cameras of 5 MP on one shared GigE line take 0.5 s for a set, one camera alone 45 ms).
UNLATCHED_S = 0.05
_LATCH_LIFE_S = 60.0  # quartz clocks part by up to 100 ppm: 6 ms a minute
_ARRIVALS = 64
_DRIFT_PER_S = 1e-4
# What lies between two images, by the camera's clock and by ours: more than this apart is no delay on the way. The
# simulator of the standard's own reference (TLSimu) stamps the nanoseconds of a second only.
_BACK_S, _SPAN_S, _RATIO = 0.5, 3.0, 2.0
_DOUBTS = 2  # a clock that was set once (PTP, a reset) makes one
_JUMP_S = 5.0  # an image cannot be this much older than all before it: somebody set the camera's clock


class CameraClock:
    """Brings a camera's time stamps (ns) to the computer's seconds: by latched times, else the fastest arrivals."""

    def __init__(self) -> None:
        self._latch: tuple[float, float, float] | None = None  # host s, offset s, uncertainty s
        self._arrivals: deque[tuple[float, float]] = deque(maxlen=_ARRIVALS)  # host s, arrival - stamp s
        self._since: tuple[float, float] | None = None  # host s, stamp s
        self._last_stamp_s = 0.0
        self._doubts = 0

    @property
    def trusted(self) -> bool:
        """Whether the camera's time stamps are times: they go forward, as fast as ours."""
        return self._doubts < _DOUBTS

    @property
    def uncertainty_s(self) -> float:
        """How far a time from `host_time` may be off, s."""
        return UNLATCHED_S if self._latch is None else self._latch[2]

    def latch(self, before_s: float, after_s: float, stamp_ns: int) -> None:
        """Note that the camera's clock showed `stamp_ns` at some moment between two times of the computer."""
        middle = (before_s + after_s) / 2
        self._latch = (middle, middle - stamp_ns * 1e-9, (after_s - before_s) / 2 + _LATCH_LIFE_S * _DRIFT_PER_S / 2)

    def camera_ns(self, host_s: float) -> int | None:
        """The camera's time (ns) at a moment of the computer's (s); None where the clocks were not compared."""
        return None if self._latch is None else round((host_s - self._latch[1]) * 1e9)

    def latch_is_old(self, now_s: float) -> bool:
        """Whether the clocks may have drifted apart since the last latch, or there was none."""
        return self._latch is None or now_s - self._latch[0] > _LATCH_LIFE_S

    def host_time(self, stamp_ns: int | None, arrived_s: float) -> float:
        """The computer's time (s) of a camera's time stamp; without one that can be trusted, the arrival."""
        if not stamp_ns or not self.trusted:
            return arrived_s
        stamp_s = stamp_ns * 1e-9
        self._doubt(stamp_s, arrived_s)
        delay = arrived_s - stamp_s
        if self._latch is not None:
            taken = stamp_s + self._latch[1]
            if abs(arrived_s - taken) < _JUMP_S:
                return min(taken, arrived_s)
            self._latch = None
        if self._arrivals and abs(delay - self._fastest(arrived_s)) > _JUMP_S:
            self._arrivals.clear()
        self._arrivals.append((arrived_s, delay))
        return stamp_s + self._fastest(arrived_s)

    def _doubt(self, stamp_s: float, arrived_s: float) -> None:
        """Begin again where the camera's clock jumped back or runs at another speed; more than once is no clock."""
        since, last = self._since, self._last_stamp_s
        self._last_stamp_s = stamp_s
        if since is None:
            self._since = (arrived_s, stamp_s)
            return
        ours, theirs = arrived_s - since[0], stamp_s - since[1]
        wrong_speed = ours > _SPAN_S and not ours / _RATIO < theirs < ours * _RATIO
        if stamp_s < last - _BACK_S or wrong_speed:
            self._since, self._latch = (arrived_s, stamp_s), None
            self._arrivals.clear()
            self._doubts += 1
        elif ours > 4 * _SPAN_S:
            self._since, self._doubts = (arrived_s, stamp_s), 0

    def _fastest(self, now_s: float) -> float:
        """The smallest arrival minus stamp; older ones count for less by what the clocks may have drifted."""
        return min(delay + _DRIFT_PER_S * (now_s - at) for at, delay in self._arrivals)


Item = TypeVar("Item", bound=Hashable)

# A trigger command takes effect after it was sent; clocks are never better than this.
_SLACK_S = 0.005
# Started by us: images belong to rounds.
TRIGGERED = ("software", "scheduled")
_ROUNDS_KEPT = 32
_PULSES_KEPT = 4


class RoundKeeper:
    """Assigns the images of one camera with software or scheduled trigger to trigger rounds."""

    def __init__(self) -> None:
        self._rounds: deque[tuple[int, float]] = deque(maxlen=_ROUNDS_KEPT)
        self._given: set[int] = set()
        self._last: tuple[int | None, int | None] | None = None

    def triggered(self, round_number: int, at_s: float) -> None:
        """Note that a trigger was sent to the camera, or is to take effect, at a moment."""
        self._rounds.append((round_number, at_s))

    def assign(
        self, taken_s: float, uncertainty_s: float, frame_id: int | None, stamp_ns: int | None = None
    ) -> int | None:
        """The round of an image: the last triggered before its exposure; None for live view and repeated deliveries."""
        now = (frame_id, stamp_ns)
        if now == self._last and (frame_id or stamp_ns):
            return None
        self._last = now
        slack = min(_SLACK_S + uncertainty_s, self._half_gap())
        for round_number, at_s in reversed(self._rounds):
            if at_s <= taken_s + slack:
                if not round_number or round_number in self._given:
                    return None
                self._given = {n for n, _ in self._rounds if n in self._given} | {round_number}
                return round_number
        return None

    def _half_gap(self) -> float:
        """Half the time between the last two triggers: no slack may reach into the round before."""
        if len(self._rounds) < 2:
            return float("inf")
        return (self._rounds[-1][1] - self._rounds[-2][1]) / 2


@dataclass(frozen=True)
class Sighting(Generic[Item]):
    """An image as matching sees it: whose, of which round, when exposed and how surely (s), and what it refers to."""

    camera: str
    round: int | None
    taken_s: float
    uncertainty_s: float
    item: Item


@dataclass
class _Pulse(Generic[Item]):
    """The images of one pulse of a hardware trigger."""

    at_s: float
    uncertainty_s: float
    images: dict[str, Sighting[Item]] = field(default_factory=dict)


class SetMatcher(Generic[Item]):
    """Collects one set: images of one trigger round, of one pulse, or, of free cameras, exposed after `started_s`."""

    def __init__(self, modes: Mapping[str, TriggerMode], round_number: int, started_s: float) -> None:
        self._modes = dict(modes)
        self._round = round_number
        self._started_s = started_s
        self._found: dict[str, Sighting[Item]] = {}
        self._pulses: list[_Pulse[Item]] = []

    def offer(self, image: Sighting[Item]) -> bool:
        """Whether the set can use this image; it is then kept."""
        mode = self._modes.get(image.camera)
        if mode is None:
            return False
        if mode == "hardware":
            if image.taken_s < self._started_s:
                return False
            for pulse in self._pulses:
                near = _SLACK_S + pulse.uncertainty_s + image.uncertainty_s
                if abs(image.taken_s - pulse.at_s) <= near and image.camera not in pulse.images:
                    pulse.images[image.camera] = image
                    return True
            self._pulses = self._pulses[-(_PULSES_KEPT - 1) :]
            self._pulses.append(_Pulse(image.taken_s, image.uncertainty_s, {image.camera: image}))
            return True
        fits = image.round == self._round if mode in TRIGGERED else image.taken_s >= self._started_s
        if not fits or image.camera in self._found:
            return False
        self._found[image.camera] = image
        return True

    def images(self) -> dict[str, Sighting[Item]]:
        """The images of the set as it is, by serial: those of the fullest pulse, and all others."""
        best = max(self._pulses, key=lambda pulse: len(pulse.images), default=None)
        return self._found | (best.images if best else {})

    def missing(self) -> tuple[str, ...]:
        """The cameras that have not delivered."""
        found = self.images()
        return tuple(serial for serial in self._modes if serial not in found)

    def kept(self) -> set[Item]:
        """The items of all images that may still become part of the set."""
        return {s.item for s in self._found.values()} | {s.item for p in self._pulses for s in p.images.values()}
