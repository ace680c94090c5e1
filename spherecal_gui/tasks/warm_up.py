"""Which cameras are still getting warmer: lens and sensor creep with them, and so would the calibration."""

from dataclasses import dataclass

# Cameras count as warm when their temperature changes by less than this in a minute. A camera that is switched on
# gains some 20 K in 30 to 60 minutes, the time that makers of measuring systems ask for; this is the end of it.
STEADY_K_PER_MIN = 0.1
_WINDOW_S = 180.0
_LEAST_S = 60.0
_EVERY_S = 2.0


@dataclass(frozen=True)
class _Reading:
    at_s: float
    celsius: float


class WarmUp:
    """The cameras' temperatures over the last minutes; fed by one thread, asked by another."""

    def __init__(self) -> None:
        self._readings: dict[str, tuple[_Reading, ...]] = {}  # exchanged whole, so no lock is needed

    def feed(self, serial: str, at_s: float, celsius: float | None) -> None:
        """A temperature that came with an image; None where the camera has none to tell."""
        kept = self._readings.get(serial, ())
        if celsius is None or (kept and at_s - kept[-1].at_s < _EVERY_S):
            return
        self._readings[serial] = (*(one for one in kept if at_s - one.at_s <= _WINDOW_S), _Reading(at_s, celsius))

    def rate_k_per_min(self, serial: str) -> float | None:
        """How fast the camera warms (or cools) for certain; None before a minute of readings.

        One step of a coarse sensor may have come at any moment: it is taken off the change.
        """
        kept = self._readings.get(serial, ())
        if not kept or kept[-1].at_s - kept[0].at_s < _LEAST_S:
            return None
        values = [one.celsius for one in kept]
        step = min((abs(b - a) for a, b in zip(values, values[1:], strict=False) if a != b), default=0.0)
        change = values[-1] - values[0]
        certain = max(abs(change) - step, 0.0) * 60 / (kept[-1].at_s - kept[0].at_s)
        return certain if change > 0 else -certain

    def unsteady(self) -> dict[str, float]:
        """The cameras that are not warm yet, by serial, with their rates in K/min."""
        rates = {serial: self.rate_k_per_min(serial) for serial in self._readings}
        return {serial: rate for serial, rate in rates.items() if rate is not None and abs(rate) >= STEADY_K_PER_MIN}
