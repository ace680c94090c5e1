"""Which cameras are still getting warmer: lens and sensor creep with them, and so would the calibration."""

import numpy as np

# Cameras count as warm when their temperature changes by less than this in a minute. A camera that is switched on
# gains some 20 K in 30 to 60 minutes, the time that makers of measuring systems ask for; this is the end of it.
STEADY_K_PER_MIN = 0.1
_WINDOW_S = 180.0
_LEAST_S = 60.0
_EVERY_S = 2.0


class WarmUp:
    """The cameras' temperatures over the last minutes; fed by one thread, asked by another."""

    def __init__(self) -> None:
        self._readings: dict[str, tuple[tuple[float, float], ...]] = {}  # s, °C; exchanged whole, so no lock is needed

    def feed(self, serial: str, at_s: float, celsius: float | None) -> None:
        """A temperature that came with an image; None where the camera has none to tell."""
        kept = self._readings.get(serial, ())
        if celsius is None or (kept and at_s - kept[-1][0] < _EVERY_S):
            return
        self._readings[serial] = (*(one for one in kept if at_s - one[0] <= _WINDOW_S), (at_s, celsius))

    def rate_k_per_min(self, serial: str) -> float | None:
        """How fast the camera warms (or cools) for certain; None before a minute of readings."""
        kept = self._readings.get(serial, ())
        if not kept or kept[-1][0] - kept[0][0] < _LEAST_S:
            return None
        at, celsius = np.array(kept).T
        at = (at - at[0]) / 60
        (slope, offset), spread = np.polyfit(at, celsius, 1), float(((at - at.mean()) ** 2).sum())
        left = celsius - slope * at - offset
        error = float(np.sqrt((left**2).sum() / max(len(at) - 2, 1) / spread))
        step = min((change for change in np.abs(np.diff(celsius)).tolist() if change > 0), default=0.0)
        # three standard errors, as sensors jitter, and one step: of a coarse one it may have come at any moment
        certain = max(abs(float(slope)) - 3 * error - step / float(at[-1]), 0.0)
        return certain if slope > 0 else -certain

    def unsteady(self) -> dict[str, float]:
        """The cameras that are not warm yet, by serial, with their rates in K/min."""
        rates = {serial: self.rate_k_per_min(serial) for serial in self._readings}
        return {serial: rate for serial, rate in rates.items() if rate is not None and abs(rate) >= STEADY_K_PER_MIN}
