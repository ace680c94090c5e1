"""Bodies: their file and pose."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.special import chdtrc

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.geometry.rotation import cross_matrix, exp_rotation
from spherecal.geometry.transform import fit_similarity
from spherecal_files.atomic import write_file_whole
from spherecal_files.codec import FileFormat, field, identifier, integer, items, name, number, optional, record
from spherecal_measuring.measured_sets import BodyPose
from spherecal_measuring.measured_values import Unmeasured
from spherecal_measuring.measuring_task import CENTRE, Body, BodyPoint, PointName
from spherecal_measuring.places import LocatedPoints

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
