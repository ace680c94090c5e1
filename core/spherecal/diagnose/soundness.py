"""Tests of a calibration as a whole: what was left out, the ball's size, given intrinsics, contradictions."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from spherecal.base.arrays import BoolArray
from spherecal.data.findings import Finding, leave_out
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.fixed_lenses import contradicted_lenses
from spherecal.diagnose.image_findings import LEAST_POINTS, MOST_LEFT_OUT
from spherecal.diagnose.plausibility import implausible_size

# On clean rigs A, B, halls and domes a camera keeps 96 to 100 % of its observations, with 5 % wrong matches 88 %.
LEAST_USED = 0.6
# Wrong observations beyond this share, by more than chance, are more than reflections and wrong codes.
MANY_OUTLIERS, SURE = 0.05, 3.0
# A globe is as large as it is called within 0.2 % (bumps of 1 mm on 500), and printers err by 0.1 to 0.5 %; beyond 2 %
# something was typed, or printed, wrong.
DOUBTFUL_DIAMETER, WRONG_DIAMETER = 0.005, 0.02
# What is not round within this share of its radius is no ball, whatever the session calls it.
ROUND = 0.05
# Cameras with 30 points each ended 543 mm off, all in one wrong minimum, at 9 times the stated noise; lenses beyond the
# model reach twice to three times.
FEW_POINTS, FITS_BADLY = 60, 5.0
# Lenses on most cameras and another test fail together: nothing can be blamed. So it is where residuals are large in
# pixels and against the noise between neighbouring dots: lenses beyond their model reach 0.8 px and twice the noise
# (dome15), 0.2 px and 3 times (camcal); a ball moved by 1 mm between exposures 0.4 px and more than 6 times (demo).
MOST_CAMERAS, LARGE_PX, LARGE = 0.6, 0.3, 5.0
# Lenses beyond their model by 0.04 to 0.25 px make the rigid form's variance 1.08 to 1.35 times the free one's.
CHANGED_BY_LENSES = 2.0


def unsound(e: Evidence, reported: Sequence[Finding]) -> list[Finding]:
    """Findings on the calibration as a whole, beside those reported already."""
    blamed = {name for finding in reported for name in finding.where if finding.code in _BLAMES}
    moved = {name for f in reported if f.code in ("camera-moved", "cameras-moved") for name in f.where}
    lenses = [] if locked(e) else contradicted_lenses(e, moved)
    found = [*_size(e), *_rejected(e, blamed), *ball_diameter(e), *lenses, *_fits_badly(e)]
    return [*found, *_contradicting(e, [*reported, *found])]


def _size(e: Evidence) -> list[Finding]:
    """The finding on lengths in another unit."""
    if e.solution.scale.source == "none":
        return []
    o, state, used = e.observations, e.solution.state, np.flatnonzero(e.used)
    camera, points = o.camera[used], state.points[e.features.of_observation[used]]
    depth = np.einsum("nj,nj->n", state.rotation[camera, 2], points) + state.translation[camera, 2]
    centres = -np.einsum("cji,cj->ci", state.rotation, state.translation)[e.placed & ~e.is_earlier_pose]
    return implausible_size(depth, state.intrinsics[camera, 0], centres)


# Findings that explain why a camera's observations were left out.
_MOTIONS = ("cameras-moved", "camera-unsteady", "ball-moved")
_BLAMES = ("camera-moved", *_MOTIONS, "wrong-placement", "image-contradicts", "cameras-swapped")


def outlier_share(e: Evidence) -> tuple[BoolArray, int, bool]:
    """Observations that contradict the rest (n,), how many could be checked, and whether they are more than a few.

    Of a point that two cameras see both views are left out where one is wrong: they count as one.
    """
    placed = e.placed[e.observations.camera]
    feature = e.features.of_observation
    views = np.bincount(feature[placed], minlength=len(e.features))
    candidates = placed & (views >= 2)[feature]
    out = candidates & e.contradicting
    gone = np.bincount(feature[out], minlength=len(e.features)) == 2
    wrong = int(out.sum()) - int((gone & (views == 2)).sum())
    n = max(int(candidates.sum()), 1)
    chance = SURE * np.sqrt(MANY_OUTLIERS * (1 - MANY_OUTLIERS) / n)
    return out, n, wrong / n > MANY_OUTLIERS + chance


def _rejected(e: Evidence, blamed: set[str]) -> list[Finding]:
    """Cameras of which too little is left, and images rejected by majority, where nothing else explains it."""
    out, seen = e.image_counts(e.contradicting), e.image_counts(e.candidates)
    found = []
    for c in np.flatnonzero(e.placed):
        name, total = e.camera_ids[c], int(seen[:, c].sum())
        images = np.flatnonzero((seen[:, c] >= LEAST_POINTS) & (out[:, c] > MOST_LEFT_OUT * seen[:, c]))
        used = 1 - out[:, c].sum() / max(total, 1)
        if name in blamed or (used >= LEAST_USED and not len(images)) or total < LEAST_POINTS:
            continue
        places = [e.observations.placements[t] for t in images]
        values = {"percent": 100 * (1 - used), "camera": name, "places": places}
        kind, repairs = "images" if places else "camera", leave_out(f"camera:{name}")
        found.append(Finding("images-rejected", "warning", values, (name, *places), repairs, kind))
    return found


def _fits_badly(e: Evidence) -> list[Finding]:
    """The finding where residuals are large and no camera has enough points to find the cause or a better minimum."""
    sigma = e.observations.sigma
    count = np.bincount(e.observations.camera[e.used], minlength=len(e.placed))[e.placed]
    if not len(count) or np.median(count) >= FEW_POINTS:
        return []
    usual = np.full((1, 2), LARGE_PX / FITS_BADLY) if sigma is None else sigma[e.used]
    times = float(np.sqrt(np.mean((e.residual_px[e.used] / usual) ** 2)))
    if times <= FITS_BADLY:
        return []
    values = {"times": times, "points": np.median(count)}
    return [Finding("fits-badly", "warning", values, kind="usual" if sigma is None else "stated")]


def ball_diameter(e: Evidence) -> list[Finding]:
    """The finding where the ball is not as large as the session says."""
    off = diameter_error(e)
    if off is None or abs(off) <= DOUBTFUL_DIAMETER:
        return []
    nominal = e.session.sphere_diameter_mm
    assert nominal is not None
    wrong = abs(off) > WRONG_DIAMETER
    by_bar = e.solution.scale.source == "bar"
    values = {"measured_mm": nominal * (1 + off), "nominal_mm": nominal, "percent": 100 * off}
    return [Finding("ball-diameter", "error" if wrong else "info" if by_bar else "warning", values)]


def diameter_error(e: Evidence) -> float | None:
    """The relative excess of the ball over its nominal diameter; None where that cannot be decided."""
    nominal = e.session.sphere_diameter_mm
    if nominal is None or e.solution.scale.source in ("none", "ball") or "ball" in e.session.struck:
        return None
    radii = [s.radius for s in e.solution.spheres.values() if s.radial_sd < ROUND * s.radius]
    return 2 * float(np.median(radii)) / nominal - 1 if radii else None


def further_scale_uncertainty(e: Evidence) -> float:
    """The relative standard uncertainty that a ball of another size than the nominal one adds to the scale.

    Twice it covers the difference; 0 for a scale from a bar, which is surer than a ball's name.
    """
    off = diameter_error(e)
    if off is None or abs(off) <= DOUBTFUL_DIAMETER or e.solution.scale.source == "bar":
        return 0.0
    return abs(off) / 2


def locked(e: Evidence) -> bool:
    """Whether cameras are locked at the poses of another calibration: their errors then appear as other faults."""
    return (~e.adjusted.problem.free_pose[e.placed]).sum() > 1  # one is the frame of a board's or bar's network


def _contradicting(e: Evidence, reported: Sequence[Finding]) -> list[Finding]:
    """The finding where the tests of lenses and others fail together on most cameras, so that no cause can be named."""
    if any(f.code in ("fixed-intrinsics-contradicted", *_MOTIONS) for f in reported):  # explains it
        return []
    lenses = {name for f in reported if f.code == "lens-misfit" and f.severity == "warning" for name in f.where}
    if len(lenses) < MOST_CAMERAS * e.placed.sum():
        return []
    others = [f.code for f in reported if f.code in _FAIL_WITH_LENSES and f.severity == "warning"]
    if (e.choice.ratio or 0.0) < CHANGED_BY_LENSES:
        others = [code for code in others if code not in ("ball-shape-changed", "rigid-form-misfit")]
    size = np.linalg.norm(e.residual_px[e.used & np.isfinite(e.residual_px[:, 0])], axis=1)
    rms = float(np.sqrt((size**2).mean())) if len(size) else 0.0
    if not others and rms <= max(LARGE_PX, LARGE * np.sqrt(2) * _neighbours_noise_px(e)):
        return []
    values = {"cameras": int(e.placed.sum()), "rms_px": rms, "tests": list(dict.fromkeys(others))}
    where = tuple(name for name in e.camera_ids if name in lenses)
    return [Finding("recording-contradicts", "warning", values, where, kind="others" if others else "lenses")]


def _neighbours_noise_px(e: Evidence) -> float:
    """Standard deviation of a coordinate by nearest neighbours in one image, the median over cameras."""
    noise, o = [], e.observations
    for c in np.flatnonzero(e.placed):
        own = np.flatnonzero(e.used & (o.camera == c))
        if len(own) < LEAST_POINTS:
            continue
        place = np.column_stack([o.uv[own], 1e6 * o.placement[own]])  # neighbours are of one image
        near = np.asarray(KDTree(place).query(place, k=2)[1])[:, 1]
        noise.append(np.sqrt(((e.residual_px[own] - e.residual_px[own[near]]) ** 2).sum(axis=1).mean() / 4))
    return float(np.median(noise)) if noise else np.inf


_FAIL_WITH_LENSES = (
    "camera-moved", "ball-shape-changed", "rigid-form-misfit", "placements-contradict", "image-contradicts",
)  # fmt: skip
