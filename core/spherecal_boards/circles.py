"""Round dots of a board: components of relative thresholds at several window sizes, rims of whole ellipses."""

from dataclasses import dataclass

import cv2
import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.targets.blobs import GreyImage

# Windows as parts of the shorter side: dots of 1/400 (5 px of 2048) to 1/12 of it stand out in one of them.
_WINDOWS = (1 / 60, 1 / 20, 1 / 6)
# Darker than its surroundings by this part of the image's range of grey values; paper and noise stay below 0.03.
_LEAST_CONTRAST = 0.06
_LEAST_AREA_PX = 12.0
_MOST_AREA = 1 / 60  # of the image
# |area of the contour / area of the ellipse with its moments - 1|; letters, scratches and joined dots are above 0.1
_MOST_MISFIT = 0.08
_MISFIT_OF_SMALL = 1.2  # and this over the semi-axis in px, for contours run along pixels
_MOST_SLENDER = 4.0  # a circle seen at 75 degrees
_RING_RADII = (0.1, 0.68, 1.35)  # where a ring's hole, body and surroundings are, in radii
_RAYS = 72  # rim points of a dot
_REACH = 0.45  # of the semi-axis, to either side of the rim
_STEPS = 41
_LEAST_RAYS = 24
_SMALL_PX = 3.0  # semi-axis below which the rim is blur: the weighted mean of the grey values serves


@dataclass(frozen=True)
class Circles:
    """Ellipses: `uv` (n,2) px, its `sigma` (n,) px by the rim's scatter, semi-axes (n,2), which are rings (n,)."""

    uv: FloatArray
    semi_axes: FloatArray
    ring: BoolArray
    sigma: FloatArray

    def __len__(self) -> int:
        return len(self.uv)


def find_circles(image: GreyImage, light: bool) -> Circles:
    """All dark (or light) round dots in a grey image, whole ones only; `image`: grey image of 8 or 16 bits, (h, w)."""
    grey = image.astype(np.float32)
    low, high = np.percentile(grey, (0.5, 99.5))
    kept = []
    if high > low:
        grey = (grey - low) / np.float32(high - low)
        if light:
            grey = 1 - grey
        found = [row for window in _WINDOWS for row in _components(grey, window)]
        measured = [_measure(grey, row) for row in _without_doubles(np.array(found).reshape(-1, 6))]
        kept = [m for m in measured if m is not None]
    table = np.array(kept).reshape(-1, 6)
    return Circles(table[:, :2], table[:, 2:4], table[:, 4] > 0, table[:, 5])


def _components(grey: FloatArray, window: float) -> list[FloatArray]:
    """Rows u v long short angle misfit of the elliptic components against windows of one size."""
    side = int(min(grey.shape) * window) | 1
    if side < 7:
        return []
    around = cv2.blur(grey, (side, side), borderType=cv2.BORDER_REFLECT_101)
    mask = ((around - grey) > _LEAST_CONTRAST).astype(np.uint8)
    # outer contours at any depth: dark surroundings may close around the sheet, and its dots then lie inside of them
    contours, depth = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    contours = [] if depth is None else [c for c, (*_, parent) in zip(contours, depth[0], strict=True) if parent < 0]
    most = min(_MOST_AREA * grey.size, 4.0 * side * side)
    rows = [_ellipse_of(contour, grey.shape, most) for contour in contours if len(contour) >= 8]
    return [row for row in rows if row is not None]


def _ellipse_of(contour: np.ndarray, shape: tuple[int, ...], most_area: float) -> FloatArray | None:
    """Row u v long short angle misfit of a contour that is an ellipse inside the image, or None."""
    x, y, width, height = cv2.boundingRect(contour)
    if x <= 1 or y <= 1 or x + width >= shape[1] - 1 or y + height >= shape[0] - 1:
        return None
    m = cv2.moments(contour)
    if not _LEAST_AREA_PX <= m["m00"] <= most_area:
        return None
    area = m["m00"]
    u, v = m["m10"] / area, m["m01"] / area
    xx, xy, yy = m["mu20"] / area, m["mu11"] / area, m["mu02"] / area
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    if values[0] <= 0:
        return None
    short, long = 2 * np.sqrt(values)
    misfit = abs(area / (np.pi * long * short) - 1)
    if misfit > _MOST_MISFIT + _MISFIT_OF_SMALL / short / 4 or long > _MOST_SLENDER * short:
        return None
    local = (contour[:, 0] - (u, v)) @ vectors[:, ::-1] / (long, short)
    off = np.abs(np.hypot(local[:, 0], local[:, 1]) - 1) * short
    if not float(np.percentile(off, 95)) <= 1.0 + 0.1 * short:  # to a pixel and a tenth
        return None
    # a contour runs through the middles of its outermost pixels
    angle = np.arctan2(vectors[1, 1], vectors[0, 1])
    return np.array([u, v, long + 0.5, short + 0.5, angle, misfit])


def _without_doubles(rows: FloatArray) -> FloatArray:
    """Each dot once, (m, 6): that with the least misfit of those whose centres lie inside one another."""
    kept: list[FloatArray] = []
    for row in rows[np.argsort(rows[:, 5], kind="stable")]:
        same = [k for k in kept if np.hypot(k[0] - row[0], k[1] - row[1]) < max(k[3], row[3])]
        if not same:
            kept.append(row.copy())
        elif row[2] > 1.5 * same[0][2]:  # the dot around a ring's hole
            same[0][:] = row
    return np.array(kept).reshape(-1, 6)


def _measure(grey: FloatArray, row: FloatArray) -> tuple[float, ...] | None:
    """u v long short ring sigma of a dot from the places where its rim crosses half of its contrast, or None."""
    u, v, long, short, angle, _ = row
    if short < _SMALL_PX:
        return _weighted_mean(grey, row)
    rms, count = 0.0, 1
    for _ in range(2):  # again around the better ellipse
        rim = _rim(grey, u, v, long, short, angle)
        count = len(rim)
        fitted = _fit_ellipse(rim, np.array([u, v]), long) if count >= _LEAST_RAYS else None
        if fitted is None:
            return None
        u, v, long, short, angle, rms = fitted
    if short <= 0 or not np.isfinite([u, v, long, short]).all():
        return None
    # the centre's share of the rim's scatter: a coordinate is the mean of n rim points twice over
    sigma = max(rms * np.sqrt(2 / count), 0.005)
    return float(u), float(v), float(long), float(short), float(_is_ring(grey, row)), float(sigma)


def _is_ring(grey: FloatArray, row: FloatArray) -> bool:
    """Whether the middle of a dot is nearer to the brightness around it than to its own."""
    u, v, long, short, angle, _ = row
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    on_rim = (axes @ np.stack([long * np.cos(turn), short * np.sin(turn)])).T
    at = (np.array([u, v]) + np.array(_RING_RADII)[:, None, None] * on_rim).astype(np.float32)
    values = cv2.remap(grey, at[:, :, 0], at[:, :, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    middle, body, around = np.median(values, axis=1)
    return float(middle) > float(body + around) / 2


def _rim(grey: FloatArray, u: float, v: float, long: float, short: float, angle: float) -> FloatArray:
    """Sub-pixel rim points (k,2) px of a dark ellipse, along rays from its centre."""
    turn = np.linspace(0, 2 * np.pi, _RAYS, endpoint=False)
    axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    on_rim = (axes @ np.stack([long * np.cos(turn), short * np.sin(turn)])).T
    radius = np.linalg.norm(on_rim, axis=1)
    reach = np.maximum(_REACH, 2.0 / radius)  # two pixels at least
    along = 1 + reach[:, None] * np.linspace(-1, 1, _STEPS)
    places = np.array([u, v]) + along[:, :, None] * on_rim[:, None]
    columns, rows = np.moveaxis(places.astype(np.float32), 2, 0)
    profile = cv2.remap(grey, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inside, outside = np.median(profile[:, : _STEPS // 4], axis=1), np.median(profile[:, -_STEPS // 4 :], axis=1)
    half = (inside + outside) / 2
    above = profile > half[:, None]
    # the crossing nearest to the expected rim
    steps = np.arange(_STEPS - 1)
    rises = ~above[:, :-1] & above[:, 1:]
    distance = np.where(rises, np.abs(steps - (_STEPS - 1) / 2), np.inf)
    at = np.argmin(distance, axis=1)
    rays = np.arange(_RAYS)
    good = rises.any(axis=1) & (outside - inside > _LEAST_CONTRAST / 2)
    before, after = profile[rays, at], profile[rays, at + 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        part = (half - before) / (after - before)
    factor = 1 + reach * (2 * (at + part) / (_STEPS - 1) - 1)
    points = np.array([u, v]) + factor[:, None] * on_rim
    inside_image = ((points > 1) & (points < np.array(grey.shape[::-1]) - 2)).all(axis=1)
    return points[good & inside_image & np.isfinite(factor)]


def _fit_ellipse(
    rim: FloatArray, start: FloatArray, size: float
) -> tuple[float, float, float, float, float, float] | None:
    """u v long short angle and rms distance of the conic of least algebraic error; stray rim points are left out."""
    p = (rim - start) / size
    keep = np.ones(len(p), dtype=bool)
    result = None
    for _ in range(3):
        x, y = p[keep].T
        # a x^2 + b xy + c y^2 + d x + e y = 1 about a centre inside: no ellipse passes through it
        conic = np.linalg.lstsq(np.stack([x * x, x * y, y * y, x, y], axis=1), np.ones(len(x)), rcond=None)[0]
        a, b, c, d, e = conic
        form = np.array([[a, b / 2], [b / 2, c]])
        if np.linalg.det(form) <= 0 or a <= 0:
            return None
        centre = -0.5 * np.linalg.solve(form, np.array([d, e]))
        level = 1 + centre @ form @ centre
        values, vectors = np.linalg.eigh(form / level)
        long, short = 1 / np.sqrt(values)
        local = (p - centre) @ vectors / (long, short)
        radius = np.hypot(local[:, 0], local[:, 1])
        off = (radius - 1) * np.hypot(*(local / radius[:, None] * (long, short)).T) * size
        spread = 1.4826 * np.median(np.abs(off[keep])) + 1e-3
        angle = np.arctan2(vectors[1, 0], vectors[0, 0])
        rms = float(np.sqrt((off[keep] ** 2).mean()))
        result = (
            float(centre[0] * size + start[0]),
            float(centre[1] * size + start[1]),
            float(long * size),
            float(short * size),
            float(angle),
            rms,
        )
        again = np.abs(off) <= 3.5 * spread
        if again.sum() < _LEAST_RAYS or (again == keep).all():
            break
        keep = again
    return result


def _weighted_mean(grey: FloatArray, row: FloatArray) -> tuple[float, ...] | None:
    """u v long short ring sigma of a small dot: the mean place of what is darker than its surroundings."""
    u, v, long, short, _, _ = row
    half = int(np.ceil(long + 3))
    x, y = round(u), round(v)
    window = grey[y - half : y + half + 1, x - half : x + half + 1]
    if y < half or x < half or window.shape != (2 * half + 1, 2 * half + 1):
        return None
    edge = np.concatenate([window[0], window[-1], window[:, 0], window[:, -1]])
    weight = np.clip(np.median(edge) - window - 2 * edge.std(), 0, None)
    total = float(weight.sum())
    if total <= 0:
        return None
    steps = np.arange(-half, half + 1)
    noise = float(edge.std()) / max(float(weight.max()), 1e-6)
    return (
        x + float(weight.sum(axis=0) @ steps) / total,
        y + float(weight.sum(axis=1) @ steps) / total,
        float(long),
        float(short),
        0.0,
        max(noise, 0.02),
    )
