"""Velocities of what moves, from set to set, and how far they may be off."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray

# Beyond it the sets before say nothing of how a target carried by hand moved since.
_LONGEST_S = 3.0


@dataclass(frozen=True)
class Motion:
    """Of values (n, w): `mean` velocities since the last set, those `now`, and their `change`.

    Per second (the change: per s^2); NaN where unknown. The velocity now is that of the parabola through the last three
    sets. Its `sd` (n,) is what the change itself changed since, or, with fewer sets, all of what is less known.
    """

    mean: FloatArray
    now: FloatArray
    sd: FloatArray
    change: FloatArray
    _jerk: FloatArray
    _passed: FloatArray

    def shared_by(self, group: IntArray) -> "Motion":
        """The same, with the mean of their group's (n,) where a value's own velocity is unknown."""
        known = np.isfinite(self.now[:, 0])
        if known.all() or not known.any():
            return self
        _, of = np.unique(group, return_inverse=True)
        sums = np.zeros((of.max() + 1, self.now.shape[1] + 2))
        np.add.at(sums, of[known], np.column_stack([self.now, self.sd, np.ones(len(known))])[known])
        with np.errstate(invalid="ignore"):
            mean = (sums[:, :-1] / sums[:, -1:])[of]
        now = np.where(known[:, None], self.now, mean[:, :-1])
        return replace(self, now=now, sd=np.where(known, self.sd, mean[:, -1]))


@dataclass(frozen=True)
class _Past:
    key: IntArray
    value: FloatArray
    at_s: FloatArray
    motion: Motion


class Velocities:
    """Velocities of named vectors from set to set: of image points, or of points in space."""

    def __init__(self) -> None:
        self._past: _Past | None = None

    def of(self, key: IntArray, value: FloatArray, at_s: FloatArray) -> Motion:
        """The motion of some values by the sets kept before; unknown for values that were not in the last set.

        `key`: number of each value, (n,), all different; `value`: the values, (n, w); `at_s`: when each was measured,
        (n,) s.
        """
        n, w = value.shape
        x, mean, acceleration = (np.full((n, w), np.nan) for _ in range(3))
        at, jerk, passed = (np.full(n, np.nan) for _ in range(3))
        past = self._past
        if past is not None and len(past.key):
            row = np.searchsorted(past.key, key).clip(max=len(past.key) - 1)
            same = past.key[row] == key
            row = row[same]
            x[same], at[same] = past.value[row], past.at_s[row]
            before = past.motion
            for new, old in zip(
                (mean, acceleration, jerk, passed),
                (before.mean, before.change, before._jerk, before._passed),
                strict=True,
            ):
                new[same] = old[row]
        dt = at_s - at
        with np.errstate(invalid="ignore"):
            dt[~((dt > 0) & (dt <= _LONGEST_S))] = np.nan
        velocity = (value - x) / dt[:, None]
        change = (velocity - mean) / ((dt + passed) / 2)[:, None]
        jerk_now = np.linalg.norm(change - acceleration, axis=1) / ((dt + passed) / 2)
        now = velocity + np.nan_to_num(change) * dt[:, None] / 2
        sd = np.fmax(jerk_now, jerk) * dt * (dt + passed) / 6
        sd = np.where(np.isfinite(jerk_now), sd, np.linalg.norm(change, axis=1) * dt / 2)
        sd = np.where(np.isfinite(sd), sd, np.linalg.norm(velocity, axis=1))
        return Motion(velocity, now, sd, change, jerk_now, dt)

    def keep(self, key: IntArray, value: FloatArray, at_s: FloatArray, motion: Motion) -> None:
        """Remember a set with its motion for the next.

        `key`, `value`, `at_s`: the values (n, w) with their numbers and times (n,), as in `of`.
        """
        order = np.argsort(key, kind="stable")
        arrays = (motion.mean, motion.now, motion.sd, motion.change, motion._jerk, motion._passed)
        self._past = _Past(key[order], value[order], at_s[order], Motion(*(array[order] for array in arrays)))
