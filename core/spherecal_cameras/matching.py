"""Which images belong together: by trigger round, time stamp and pulse, never by the order in which they arrive."""

from collections import deque
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from spherecal_cameras.protocol import TriggerMode

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
        """The round of an image: the last one triggered before its exposure; None for live view and repetitions.

        An image with the frame id and the time stamp of the one before is a repeated delivery. Where a driver has no
        ids it may give every image the id 0.
        """
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
            return self._offer_to_pulse(image)
        fits = image.round == self._round if mode in TRIGGERED else image.taken_s >= self._started_s
        if not fits or image.camera in self._found:
            return False
        self._found[image.camera] = image
        return True

    def _offer_to_pulse(self, image: Sighting[Item]) -> bool:
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
