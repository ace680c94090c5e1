"""Writes resources/target_sets/dots8.json, the code book of family dots8.

A code is a triple of places on a lattice beside the five template dots. The rules, all for a 28 mm sticker:

- A code dot is on the lattice, at least 5 mm from every template dot and from every other code dot.
- A and E remain the only two dots that are farthest apart.
- No wrong reading: take any five of the eight dots for A B C D E, in any order; the remaining three never look like a
  code (`clean_margins`).
- Two codes share at most one dot, so that one lost and one spurious dot together never turn a code into another.
"""

import itertools
import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(path) for path in (ROOT, ROOT / "core") if str(path) not in sys.path]

from spherecal.base.arrays import FloatArray  # noqa: E402
from spherecal.base.kernels import njit  # noqa: E402
from spherecal.targets.family import CODE_COUNT, LATTICE_MM, TEMPLATE_MM  # noqa: E402

IntArray = NDArray[np.int64]

_LEAST_DISTANCE_MM = 5.0  # two dots of 3 mm keep 2 mm between their edges: they stay apart to 65 degrees
_LATTICE_HALF_STEPS = 4  # lattice places reach the template's corners at +-10 mm

# A wrong reading is harmless when it misses these tolerances by this factor: the decoder's own are narrower today
# (grouping.py). At 3 the greedy search finds 354 codes, at 4 only 317.
_LEAST_MARGIN = 3.0
_TEMPLATE_TOLERANCE_MM = 0.25
_LATTICE_TOLERANCE_MM = 0.6
_STEEPEST_VIEW_DEG = 80.0


def lattice() -> FloatArray:
    """Places a code dot may take, (52, 2) mm on the 28 mm sticker, row by row from the top."""
    axis = LATTICE_MM * np.arange(-_LATTICE_HALF_STEPS, _LATTICE_HALF_STEPS + 1)
    places = np.array([[x, y] for y in axis for x in axis])
    distance = np.linalg.norm(places[:, None] - TEMPLATE_MM, axis=2).min(axis=1)
    return places[distance >= _LEAST_DISTANCE_MM - 1e-9]


def admissible_triples(places: FloatArray) -> IntArray:
    """Triples (m, 3) of lattice places that keep their distances and leave A-E the longest, in lexical order."""
    distance = np.linalg.norm(places[:, None] - places, axis=2)
    longest = np.linalg.norm(TEMPLATE_MM[0] - TEMPLATE_MM[4])
    compatible = (distance >= _LEAST_DISTANCE_MM - 1e-9) & (distance < longest - 1e-9)
    return np.array(
        [
            (i, j, k)
            for i, j, k in itertools.combinations(range(len(places)), 3)
            if compatible[i, j] and compatible[i, k] and compatible[j, k]
        ]
    )


def clean_margins(triples: IntArray, places: FloatArray) -> FloatArray:
    """How far each code (m,3) of places (n,2) mm is from being misread: the least misfit / tolerance of wrong readings.

    A reading takes five of the eight dots for A B C D E; it is wrong unless all five are right. Its misfit is that of
    the affine map onto the template (rms) or of the remaining dots from the lattice (largest), whichever exceeds its
    tolerance more. Mirrored readings and views steeper than 80 degrees do not count.
    """
    readings = np.array(list(itertools.permutations(range(8), 5)))
    right = (readings == np.arange(5)).all(axis=1)
    tolerances = np.array([_TEMPLATE_TOLERANCE_MM, _LATTICE_TOLERANCE_MM])
    flattest = float(np.cos(np.radians(_STEEPEST_VIEW_DEG)))
    return _margins(triples, places, TEMPLATE_MM, readings[~right], tolerances, flattest)


@njit(nogil=True, cache=True)
def _margins(triples, places, template, readings, tolerances, flattest):
    margins = np.full(len(triples), 1e3)
    dots = np.empty((8, 2))
    dots[:5] = template
    taken = np.empty(8, np.bool_)
    goal_mean = np.array([template[:, 0].mean(), template[:, 1].mean()])
    for i in range(len(triples)):
        for j in range(3):
            dots[5 + j] = places[triples[i, j]]
        for reading in readings:
            # affine map of the five dots onto the template, about the means: M = U C^-1
            mx, my = 0.0, 0.0
            for q in range(5):
                mx += dots[reading[q], 0] / 5
                my += dots[reading[q], 1] / 5
            cxx, cxy, cyy, uxx, uxy, uyx, uyy, total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for q in range(5):
                x, y = dots[reading[q], 0] - mx, dots[reading[q], 1] - my
                gx, gy = template[q, 0] - goal_mean[0], template[q, 1] - goal_mean[1]
                cxx, cxy, cyy = cxx + x * x, cxy + x * y, cyy + y * y
                uxx, uxy, uyx, uyy = uxx + gx * x, uxy + gx * y, uyx + gy * x, uyy + gy * y
                total += gx * gx + gy * gy
            det_c = cxx * cyy - cxy * cxy
            if det_c < 1e-6:
                continue
            a, b = (uxx * cyy - uxy * cxy) / det_c, (uxy * cxx - uxx * cxy) / det_c
            c, d = (uyx * cyy - uyy * cxy) / det_c, (uyy * cxx - uyx * cxy) / det_c
            det = a * d - b * c
            squared = max(total - (a * uxx + b * uxy + c * uyx + d * uyy), 0.0)
            margin = np.sqrt(squared / 5) / tolerances[0]
            if det <= 0 or margin >= margins[i]:
                continue
            trace = a * a + b * b + c * c + d * d
            largest = (trace + np.sqrt(max(trace * trace - 4 * det * det, 0.0))) / 2  # singular value, squared
            if det < flattest * largest:
                continue
            taken[:] = False
            for q in range(5):
                taken[reading[q]] = True
            for q in range(8):
                if not taken[q]:
                    x, y = dots[q, 0] - mx, dots[q, 1] - my
                    px, py = a * x + b * y + goal_mean[0], c * x + d * y + goal_mean[1]
                    nearest = np.sqrt(((places[:, 0] - px) ** 2 + (places[:, 1] - py) ** 2).min())
                    margin = max(margin, nearest / tolerances[1])
            margins[i] = min(margins[i], margin)
    return margins


def generate_codes() -> FloatArray:
    """The code book: dots M1 M2 M3 of each code, (344, 3, 2) mm on the 28 mm sticker, the most open codes first.

    Greedy, skipping codes that share two dots with one taken. Codes are tried in order of decreasing distance of their
    closest dots, then of decreasing margin, then lexical. That distance decides how steeply a target can be seen before
    dots merge; the first 214 codes keep 5.59 mm or more.
    """
    places = lattice()
    triples = admissible_triples(places)
    # rounded, so that the last bit of a processor decides nothing
    margins = np.round(clean_margins(triples, places), 6)
    gaps = np.round([_closest_mm(places[triple]) for triple in triples], 6)
    pairs_taken: set[tuple[int, int]] = set()
    codes: list[IntArray] = []
    for i in np.lexsort((-margins, -gaps)):
        pairs = set(itertools.combinations(triples[i].tolist(), 2))
        if margins[i] >= _LEAST_MARGIN and len(codes) < CODE_COUNT and not pairs & pairs_taken:
            pairs_taken |= pairs
            codes.append(triples[i])
    return places[np.array(codes)]


def _closest_mm(code: FloatArray) -> float:
    dots = np.vstack([TEMPLATE_MM, code])
    distance = np.linalg.norm(dots[:, None] - dots, axis=2)
    return float(distance[np.triu_indices(len(dots), 1)].min())


def main() -> None:
    """Write the code book to resources/target_sets/dots8.json, places in lattice steps."""
    steps = np.rint(generate_codes() / LATTICE_MM).astype(int).tolist()
    rows = ",\n".join("  " + json.dumps(code, separators=(",", ":")) for code in steps)
    header = f'"family": "dots8", "lattice_mm": {LATTICE_MM}, "size_mm": 28.0'
    text = f'{{{header}, "codes": [\n{rows}\n]}}\n'
    (ROOT / "resources" / "target_sets" / "dots8.json").write_text(text)


if __name__ == "__main__":
    main()
