"""A calibrated rig against the truth: which cameras and lengths are off beyond what the rig states of itself.

"Wrong" is an error beyond three times the stated expanded uncertainty (k = 2), so beyond six standard uncertainties.
"""

import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from benchmarks.studies.alignment import Similarity, similarity
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.errors import SpherecalError
from spherecal.calibrate import calibrate
from spherecal.data.findings import Finding
from spherecal.data.observations import Features, Observations
from spherecal.data.rig import Calibration, Quality, Rig, RigCamera
from spherecal.data.rig_camera import posed
from spherecal.data.session import Session
from spherecal.geometry.camera import project
from spherecal.geometry.length_uncertainty import Cameras, predict_lengths
from spherecal.geometry.triangulation import triangulate
from spherecal.steps.settings import CalibrationSettings
from spherecal_verify.participation import lens_corrected

BEYOND_U = 3.0
COVERAGE_FACTOR = 2.0
# what nobody can measure is not wrong, however small the stated uncertainty: 1 um, and 1 um at 1 m
_LEAST_MM, _LEAST_RAD = 0.001, 1e-6

Verdict = Literal["valid", "use-with-care", "not-valid"]


def verdict_of(quality: Quality) -> Verdict:
    """The verdict of a result; of one that knows only valid and not valid, these two."""
    given = getattr(quality, "verdict", None)
    if given is not None:
        return str(getattr(given, "value", given))  # type: ignore[return-value]
    return "valid" if quality.valid else "not-valid"


def affected_cameras(quality: Quality) -> set[str]:
    """The cameras that a result to use with care names as affected."""
    names = set()
    for entry in getattr(quality, "affected", ()) or ():
        camera = entry.get("camera") if isinstance(entry, dict) else getattr(entry, "camera", None)
        if camera is not None:
            names.add(str(camera))
    return names


@dataclass(frozen=True)
class Lengths:
    """True lengths for a test: ends (m, 2, 3) mm in the world, and what the cameras see of end `2 i + (0 or 1)`.

    Row r: end `end[r]` in camera `camera[r]` (index into the reference's ids) at `uv[r]` px, without noise.
    """

    ends_mm: FloatArray
    end: IntArray
    camera: IntArray
    uv: FloatArray

    @property
    def true_mm(self) -> FloatArray:
        """The lengths (m,)."""
        return np.linalg.norm(self.ends_mm[:, 1] - self.ends_mm[:, 0], axis=1)


@dataclass(frozen=True)
class Reference:
    """The true rig as it is after the recording: ids, poses (c, 3, 3), (c, 3), where features are, lengths to measure.

    `places_of` gives the true places (f, 3) mm of features, NaN where there is none. The poses of cameras in `excused`
    are not compared: with them what was done to the lens may as well be told as a turn.
    """

    ids: tuple[str, ...]
    rotation: FloatArray
    translation_mm: FloatArray
    places_of: Callable[[Features, Observations], FloatArray]
    lengths: Lengths
    excused: frozenset[str] = frozenset()


@dataclass(frozen=True)
class CameraError:
    """Centre in mm, angle in degrees, and the largest error of a coordinate or angle over its expanded uncertainty.

    `miss_mm`: by how much the camera's rays miss the points that it sees (median over ends of the test lengths), pose
    and lens together.
    """

    id: str
    centre_mm: float
    angle_deg: float
    over_u: float
    miss_mm: float = 0.0


@dataclass(frozen=True)
class Judged:
    """A result against the truth. `lengths_over_u`: |error| / U of the test lengths (those that can be measured).

    `seconds` wall and `processor_s` of the calibration. `failure`: why there is no result at all.
    """

    verdict: Verdict
    findings: tuple[Finding, ...]
    cameras: tuple[CameraError, ...]
    missing: tuple[str, ...]
    lengths_mm: FloatArray
    lengths_over_u: FloatArray
    rms_px: float
    seconds: float
    processor_s: float
    failure: str = ""
    affected: frozenset[str] = field(default_factory=frozenset)
    rig: Rig | None = None

    @property
    def wrong_cameras(self) -> tuple[str, ...]:
        """Cameras beyond three expanded uncertainties."""
        return tuple(c.id for c in self.cameras if not c.over_u <= BEYOND_U)

    @property
    def worst_camera(self) -> CameraError | None:
        """The camera with the largest error over its uncertainty."""
        return max(self.cameras, key=lambda c: np.nan_to_num(c.over_u, nan=np.inf), default=None)

    @property
    def lengths_wrong(self) -> bool:
        """Whether a length is beyond three expanded uncertainties."""
        return bool((~(self.lengths_over_u <= BEYOND_U)).any())

    @property
    def wrong(self) -> bool:
        """Whether a camera or a length is wrong."""
        return bool(self.wrong_cameras) or self.lengths_wrong

    @property
    def covered(self) -> float:
        """The share of lengths within their expanded uncertainty; NaN without any."""
        return float((self.lengths_over_u <= 1).mean()) if len(self.lengths_over_u) else float("nan")

    @property
    def codes(self) -> Counter[str]:
        """Findings of severity warning or error, by code."""
        return Counter(f.code for f in self.findings if f.severity != "info")

    def worst_words(self) -> str:
        """The worst camera and length in a few words."""
        worst, words = self.worst_camera, []
        if worst is not None:
            size = f"{worst.centre_mm:.3g} mm {worst.angle_deg:.2g} deg = {worst.over_u:.3g} U"
            words.append(f"{worst.id} {size} (rays miss by {worst.miss_mm:.2g} mm)")
        if len(self.lengths_over_u):
            i = int(np.nanargmax(np.nan_to_num(self.lengths_over_u, nan=np.inf)))
            words.append(f"length {self.lengths_mm[i]:.3g} mm = {self.lengths_over_u[i]:.3g} U")
        return "; ".join(words)


class TooLong(Exception):
    """A calibration took more processor time than it was given."""


@contextmanager
def processor_limit(seconds: float) -> Iterator[None]:
    """Raise TooLong in the main thread after so much processor time."""

    def stop(*_: object) -> None:
        raise TooLong

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


LIMIT_S = 90.0


def calibrated_and_judged(
    session: Session, reference: Reference, settings: CalibrationSettings | None = None, limit_s: float = LIMIT_S
) -> Judged:
    """The production calibration of a session against the truth; what went wrong where there is no result."""
    begin, used = time.perf_counter(), time.process_time()
    try:
        with processor_limit(limit_s):
            done = calibrate(session, settings)
    except SpherecalError as error:
        return _none(f"refused: {error}", "not-valid", begin, used)
    except TooLong:
        return _none(f"no result after {limit_s:.0f} s of processor time", "not-valid", begin, used)
    except Exception as error:  # a study goes on, and shows it
        return _none(f"crash: {type(error).__name__}: {error}", "not-valid", begin, used)
    return judged(done, reference, time.perf_counter() - begin, time.process_time() - used)


def _none(words: str, verdict: Verdict, begin: float, used: float) -> Judged:
    empty = np.empty(0)
    seconds, processor = time.perf_counter() - begin, time.process_time() - used
    return Judged(verdict, (), (), (), empty, empty, float("nan"), seconds, processor, words)


def judged(done: Calibration, reference: Reference, seconds: float = 0.0, processor_s: float = 0.0) -> Judged:
    """A calibration against the truth."""
    rig, quality = done.rig, done.rig.quality
    fit = aligned(done, reference)
    index = {name: i for i, name in enumerate(reference.ids)}
    cameras = tuple(
        replace(camera_error(c, index[c.id], reference, fit), miss_mm=ray_miss_mm(c, index[c.id], reference, fit))
        for c in rig.cameras
        if c.id not in reference.excused
    )
    placed = {c.id for c in rig.cameras}
    error, over = _lengths(rig, reference)
    return Judged(
        verdict_of(quality),
        quality.findings,
        cameras,
        tuple(n for n in reference.ids if n not in placed),
        error,
        over,
        quality.rms_px if quality.rms_px is not None else float("nan"),
        seconds,
        processor_s,
        affected=frozenset(affected_cameras(quality)),
        rig=rig,
    )


def aligned(done: Calibration, reference: Reference) -> Similarity | None:
    """The similarity from the rig's frame to the world by the points that agree best; None without enough points."""
    true = reference.places_of(done.features, done.observations)
    known = np.isfinite(done.points_mm).all(axis=1) & np.isfinite(true).all(axis=1) & (done.views >= 2)
    if known.sum() < 4:
        return None
    return robust_similarity(done.points_mm[known], true[known])


def robust_similarity(found: FloatArray, true: FloatArray) -> Similarity:
    """The similarity of most points: the best of 200 samples of four by the median distance, then trimmed fits."""
    rng, best, least = np.random.default_rng(1), similarity(found, true), np.inf
    look = rng.choice(len(found), min(len(found), 2000), replace=False)
    for _ in range(200):
        some = rng.choice(len(found), 4, replace=False)
        with np.errstate(all="ignore"):
            fit = similarity(found[some], true[some])
        off = float(np.median(np.linalg.norm(fit.points(found[look]) - true[look], axis=1)))
        if off < least:
            best, least = fit, off
    for _ in range(5):
        off = np.linalg.norm(best.points(found) - true, axis=1)
        keep = off <= 3 * np.median(off)
        best = similarity(found[keep], true[keep])
    return best


def camera_error(camera: RigCamera, index: int, reference: Reference, fit: Similarity | None) -> CameraError:
    """A camera's pose against the truth, with its stated standard uncertainties."""
    if fit is None:
        return CameraError(camera.id, np.inf, 180.0, np.inf)
    rotation = reference.rotation[index]
    centre = -rotation.T @ reference.translation_mm[index]
    shift = fit.points(camera.centre_mm[None])[0] - centre
    turn = camera.rotation @ fit.rotation.T @ rotation.T
    vector = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    angle = float(np.arctan2(np.linalg.norm(vector), (np.trace(turn) - 1) / 2))
    length, degrees = float(np.linalg.norm(shift)), float(np.degrees(angle))
    if camera.sigma is None:
        return CameraError(camera.id, length, degrees, np.inf)
    own = np.abs(fit.rotation.T @ shift / fit.scale)  # along the axes of the result, as its sigmas are
    by_turn = np.abs(vector) if angle < np.pi / 2 else np.full(3, angle)
    u_centre = np.maximum(COVERAGE_FACTOR * camera.sigma.centre_mm, _LEAST_MM)
    u_turn = np.maximum(COVERAGE_FACTOR * np.deg2rad(camera.sigma.rotation_deg), _LEAST_RAD)
    return CameraError(camera.id, length, degrees, float(max((own / u_centre).max(), (by_turn / u_turn).max())))


def ray_miss_mm(camera: RigCamera, index: int, reference: Reference, fit: Similarity | None) -> float:
    """The median distance in mm, across the ray, between where a camera sees the test ends and where they are."""
    rows = np.flatnonzero(reference.lengths.camera == index)
    if fit is None or not len(rows):
        return np.inf if fit is None else 0.0
    true = reference.lengths.ends_mm.reshape(-1, 3)[reference.lengths.end[rows]]
    x = ((true - fit.shift) @ fit.rotation / fit.scale) @ camera.rotation.T + camera.translation_mm
    with np.errstate(all="ignore"):
        seen = reference.lengths.uv[rows] - (
            0.0 if camera.field is None else camera.field.at(reference.lengths.uv[rows])
        )
        off = np.linalg.norm(project(x, camera.intrinsics) - seen, axis=1)
        miss = off / camera.intrinsics[0] * np.abs(x[:, 2]) * fit.scale
    return float(np.median(np.nan_to_num(miss, nan=np.inf)))


def _lengths(rig: Rig, reference: Reference) -> tuple[FloatArray, FloatArray]:
    """Errors (m,) in mm of the test lengths as the rig measures them, and over their expanded uncertainty.

    Without noise of their own: only the calibration errs. Infinite where nothing is stated. Lengths whose ends fewer
    than two placed cameras see are left out.
    """
    lengths, cameras = reference.lengths, rig.cameras
    if len(cameras) < 2 or not len(lengths.ends_mm):
        return np.empty(0), np.empty(0)
    row = {c.id: i for i, c in enumerate(cameras)}
    own = np.array([row.get(name, -1) for name in reference.ids])[lengths.camera]
    keep = own >= 0
    looking_from = posed(cameras)
    count = 2 * len(lengths.ends_mm)
    noise = max(rig.length_map.sigma_px if rig.length_map is not None else 0.0, 1e-4)
    uv, sigma = lens_corrected(cameras, own[keep], lengths.uv[keep], np.ones((int(keep.sum()), 2)), noise)
    found = triangulate(lengths.end[keep], own[keep], uv, 1 / sigma**2, count, looking_from).points  # as `verify` does
    error = np.linalg.norm(found[1::2] - found[::2], axis=1) - lengths.true_mm
    seen = np.isfinite(error)
    error, ends = error[seen], found.reshape(-1, 2, 3)[seen]
    if rig.covariance is None or rig.scale.source == "none":
        return error, np.full(len(error), np.inf)
    sizes = np.array([c.image_size for c in cameras], dtype=float)
    each = looking_from.intrinsics, looking_from.rotation, looking_from.translation
    looking = Cameras(*each, sizes, rig.covariance.matrix, rig.covariance.intrinsics, tuple(c.field for c in cameras))
    expanded = COVERAGE_FACTOR * predict_lengths(looking, ends, noise).standard_mm()
    stated = np.isfinite(expanded)  # seen by too few by the rig's own account: nothing is claimed of it
    return error[stated], np.abs(error[stated]) / np.maximum(expanded[stated], _LEAST_MM)


def words(findings: tuple[Finding, ...], most: int = 6) -> str:
    """The codes of warnings and errors with the ids they name, for a table."""
    told = [f for f in findings if f.severity != "info"]
    return ", ".join(f.code + (f" ({' '.join(f.where[:3])})" if f.where else "") for f in told[:most])
