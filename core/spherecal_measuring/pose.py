"""Bodies: their file and pose."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import chdtrc

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig
from spherecal.data.session import Bar
from spherecal.geometry.rotation import cross_matrix, exp_rotation
from spherecal.geometry.transform import fit_similarity
from spherecal.scale.bar_temperature import reference_length
from spherecal_files.atomic import write_file_whole
from spherecal_files.codec import FileFormat, field, identifier, integer, items, name, number, optional, record
from spherecal_measuring.measured_sets import BodyPose, MeasuredValue
from spherecal_measuring.measuring_task import CENTRE, Body, BodyPoint, PointName, Ruler
from spherecal_measuring.places import LocatedPoints
from spherecal_verify.marks import MarkPlace
from spherecal_verify.uncertainty import PointErrors, length_budget

# Below it two points are one: the direction between them is noise.
_LEAST_MM = 1e-6
_LEAST_SINE = 1e-6  # of an angle near 0 or 180 degrees, where its derivative is not defined


@dataclass(frozen=True)
class Unmeasured:
    """Why a value could not be measured."""

    reason: str


def measure_ruler(ruler: Ruler, places: LocatedPoints, rig: Rig, with_scale: bool) -> MeasuredValue | Unmeasured:
    """A distance in mm or an angle in degrees with its standard uncertainty, or why there is none."""
    rows = [places.rows.get(name) for name in ruler.points]
    if missing := [str(name) for name, row in zip(ruler.points, rows, strict=True) if row is None]:
        return Unmeasured(f"{', '.join(missing)} not measured")
    chosen = [row for row in rows if row is not None]
    at = places.places_mm[chosen]
    if ruler.kind == "distance":
        between = at[1] - at[0]
        value = float(np.linalg.norm(between))
        if value < _LEAST_MM:
            return Unmeasured("the points are one")
        derivative = np.stack([-between, between]) / value
        variance = places.variance(chosen, derivative)
        if not with_scale:
            variance += ((rig.scale.relative_uncertainty or 0.0) * value) ** 2
        u = math.sqrt(variance)
    else:
        found = _angle(at)
        if found is None:
            return Unmeasured("the points are on one line")
        value, u = math.degrees(found[0]), math.degrees(math.sqrt(places.variance(chosen, found[1])))
    deviation = None if ruler.nominal is None else value - ruler.nominal
    return MeasuredValue(ruler.kind, ruler.name, value, u, ruler.nominal, deviation, None if deviation is None else u)


def _angle(at: FloatArray) -> tuple[float, FloatArray] | None:
    """The angle at the second of three places in rad, and its derivatives (3, 3); None near 0 and 180 degrees."""
    a, b = at[0] - at[1], at[2] - at[1]
    long_a, long_b = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if min(long_a, long_b) < _LEAST_MM:
        return None
    a, b = a / long_a, b / long_b
    cosine, sine = float(a @ b), float(np.linalg.norm(np.cross(a, b)))
    if sine < _LEAST_SINE:
        return None
    by_a, by_b = -(b - cosine * a) / (long_a * sine), -(a - cosine * b) / (long_b * sine)
    return math.atan2(sine, cosine), np.stack([by_a, -by_a - by_b, by_b])


def measure_bar(
    bar: Bar, places: LocatedPoints, errors: PointErrors, rig: Rig, temperature_c: float | None
) -> list[MeasuredValue | Unmeasured]:
    """Every certified length of a bar in mm and its deviation at its temperature; or why it was not measured."""
    found: list[MeasuredValue | Unmeasured] = []
    for certified in bar.lengths:
        ends = []
        for mark in (bar.marks[certified.from_mark], bar.marks[certified.to_mark]):
            row = places.rows.get(PointName(mark.target, mark.point))
            if row is not None:
                at = places.places_mm[row], places.dots[row], places.by_dot[row], int(places.views[row])
                ends.append(MarkPlace(*at))
        if len(ends) < 2:
            found.append(Unmeasured(f"bar {bar.id}: {certified.from_mark} or {certified.to_mark} not measured"))
            continue
        pair = ends[0], ends[1]
        budget = length_budget(pair, errors, rig.scale.relative_uncertainty or 0.0, certified, bar, temperature_c)
        length = float(np.linalg.norm(pair[1].place_mm - pair[0].place_mm))
        reference = reference_length(certified, bar, temperature_c)
        u = math.hypot(budget.noise_mm, budget.calibration_mm, budget.scale_mm)
        name = f"{bar.id}:{certified.from_mark}-{certified.to_mark}"
        found.append(MeasuredValue("bar", name, length, u, reference, length - reference, budget.combined_mm))
    return found


LEAST_POINTS = 3
_MOST_POINTS = 1000
_MOST_MM = 1e6
# Points nearer to one line than this leave the turn about it undefined: at 1 mm beside 100 mm, 0.01 mm of a point is
# 0.6 degrees.
_LEAST_WIDTH_MM = 1.0


def _point(target: int, place_mm: tuple[float, float, float], point: str = CENTRE, sigma_mm: float = 0.0) -> BodyPoint:
    return BodyPoint(PointName(target, point), place_mm, sigma_mm)


_POINT = record(
    "",
    _point,
    field("target", integer("The target.", 0, 2**31), "name.target"),
    optional("point", name("The point of the target; `centre` where absent."), "name.point"),
    field("xyz_mm", items("Its position.", number("", -_MOST_MM, _MOST_MM, "mm"), length=3), "place_mm"),
    optional("sigma_mm", number("Standard deviation of its position; 0 where absent.", 0, _MOST_MM, "mm")),
)
BODY = FileFormat(
    "spherecal/body",
    "body.json",
    "A rigid body by named points in a frame of its own.",
    record(
        "",
        Body,
        field("name", identifier("Its name.")),
        field("points", items("Its points.", _POINT, LEAST_POINTS, _MOST_POINTS, differ="name", what="point")),
    ),
    ("No point occurs twice.", "The points are not all on one line."),
    more="measuring.md#bodies",
)


def read_body(path: Path) -> Body:
    """The body in a file."""
    body = BODY.read(path)
    check_body(body, str(path))
    return body


def check_body(body: Body, where: str) -> None:
    """Check that a body's points define its pose: three or more, and not within 1 mm (rms) of one line."""
    if len(body.points) < LEAST_POINTS:
        raise InputError(
            Phrase("error-body-points", {"where": where, "least": LEAST_POINTS, "found": len(body.points)})
        )
    places = body.places_mm
    width = line_width(places)
    if width < _LEAST_WIDTH_MM:
        raise InputError(Phrase("error-body-line", {"where": where, "body": body.name, "width": width}))


def line_width(places: np.ndarray) -> float:
    """How far (rms, mm) points (n, 3) are from their best line."""
    spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return float(np.hypot(spread[1], spread[2] if len(spread) > 2 else 0.0) / np.sqrt(len(places)))


def write_body(body: Body, path: Path) -> None:
    """Write body.json, whole or not at all."""
    check_body(body, str(path))
    write_file_whole(path, BODY.bytes(body))


# A body of ten points whose points are all right loses one in 10 000 sets; a point 5 sd off is always found.
_CHANCE = 1e-5
_STEPS = 4  # Gauss-Newton from the unweighted fit: the third changes nothing above 1e-9 mm


def measure_body(body: Body, places: LocatedPoints) -> BodyPose | Unmeasured:
    """The pose that fits a body's points best, by their noise, the file's sigmas, and what cameras err in common."""
    seen = [i for i, point in enumerate(body.points) if point.name in places.rows]
    left_out: list[int] = []
    while True:
        used = [i for i in seen if i not in left_out]
        if len(used) < LEAST_POINTS:
            return Unmeasured(f"body {body.name}: {len(used)} of its {len(body.points)} points measured, 3 needed")
        if line_width(body.places_mm[used]) < _LEAST_WIDTH_MM:
            return Unmeasured(f"body {body.name}: the points measured lie on one line")
        fit = _Fit(body, places, used)
        wrong = fit.contradicting()
        if wrong is None:
            names = tuple(body.points[i].name for i in left_out)
            return BodyPose(
                body.name, fit.rotation, fit.translation, fit.covariance, len(used), names,
                float(np.sqrt((fit.residual**2).sum(axis=1).mean())),
            )  # fmt: skip
        if len(used) == LEAST_POINTS or wrong < 0:
            return Unmeasured(f"body {body.name}: its points do not fit the body file")
        left_out.append(used[wrong])


class _Fit:
    """A weighted rigid fit of some points of a body."""

    def __init__(self, body: Body, places: LocatedPoints, used: Sequence[int]) -> None:
        rows = [places.rows[body.points[i].name] for i in used]
        self.source, self.target = body.places_mm[list(used)], places.places_mm[rows]
        sigma = np.array([body.points[i].sigma_mm for i in used])
        own = sigma[:, None, None] ** 2 * np.eye(3)
        self.joint = places.joint(rows)
        for i in range(len(rows)):
            self.joint[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += own[i]
        self.weight = np.linalg.inv(places.noise[rows] + own)
        start = fit_similarity(self.source, self.target, with_scale=False)
        self.rotation, self.translation = start.rotation, start.translation
        for _ in range(_STEPS):
            step = -self.gain() @ self.residual.ravel()
            self.rotation = exp_rotation(step[:3]) @ self.rotation
            self.translation = self.translation + step[3:]
        gain = self.gain()
        self.covariance: FloatArray = gain @ self.joint @ gain.T

    @property
    def residual(self) -> FloatArray:
        """Predicted - measured (k, 3)."""
        return self.source @ self.rotation.T + self.translation - self.target

    def design(self) -> FloatArray:
        """Derivatives (3k, 6) of the predicted points by turn and translation."""
        arm = self.source @ self.rotation.T
        return np.concatenate([-cross_matrix(arm), np.broadcast_to(np.eye(3), (len(arm), 3, 3))], axis=2).reshape(-1, 6)

    def gain(self, without: int | None = None) -> FloatArray:
        """How the pose follows the measured points, (6, 3k); `without` one of them."""
        a = self.design().reshape(-1, 3, 6)
        weight = self.weight.copy()
        if without is not None:
            weight[without] = 0.0
        weighted = np.swapaxes(a, 1, 2) @ weight  # (k, 6, 3)
        normal = np.einsum("kij,kjl->il", weighted, a)
        return np.linalg.pinv(normal, hermitian=True) @ weighted.transpose(1, 0, 2).reshape(6, -1)

    def contradicting(self) -> int | None:
        """Which point contradicts the others most, beyond chance; -1 where all do and none can be named, else None."""
        residual, k = self.residual.ravel(), len(self.source)
        whole = np.eye(3 * k) - self.design() @ self.gain()
        score, freedom = _score(whole @ residual, whole @ self.joint @ whole.T)
        if chdtrc(freedom, score) > _CHANCE:
            return None
        if k == LEAST_POINTS:
            return -1
        scores = []
        for i in range(k):  # the point without which the others agree best
            others = np.repeat(np.arange(k) != i, 3)
            rest = (np.eye(3 * k) - self.design() @ self.gain(i))[others]
            scores.append(_score(rest @ residual, rest @ self.joint @ rest.T)[0])
        return int(np.argmin(scores))


def _score(vector: FloatArray, covariance: FloatArray) -> tuple[float, int]:
    """Chi-square of a vector, and its degrees of freedom: the directions in which it can err."""
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    good = values > 1e-9 * values[-1]
    return float(((vectors[:, good].T @ (vector / size)) ** 2 / values[good]).sum()), int(good.sum())
