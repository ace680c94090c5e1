"""A square lattice grown from neighbour to neighbour over circles, laid onto the board by rings or by filling it."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial import KDTree

from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal_boards.circles import Circles

# A neighbour lies this near to where the steps so far say, in parts of a step; dots beside the lattice's are at 0.5.
_NEAR = 0.28
_SEEDS = 12
_LEAST_DOTS = 8
# Of the median area around it; what is larger or smaller is no dot of the lattice (letters, dirt, other marks).
_AREA_RATIO = 2.5
_LEAST_RINGS = 2
# A board without ring marks counts as whole when at least this share of its dots was found.
_WHOLE = 0.8


@dataclass(frozen=True)
class Labelled:
    """Circles (indices, (k,)) and the row and column of each on the board, (k,2)."""

    circle: IntArray
    place: IntArray


def label_board(
    circles: Circles, rows: int, columns: int, rings: tuple[tuple[int, int], ...], mirrored: bool
) -> Labelled | None:
    """The circles that are dots of a board of rows x columns; None where the board is ambiguous."""
    best = Labelled(np.zeros(0, dtype=np.int64), np.zeros((0, 2), dtype=np.int64))
    for grown in _lattices(circles):
        if rings:
            labelled = _by_rings(grown, circles.ring, rows, columns, rings)
        else:
            labelled = _by_extent(grown, circles.uv, rows, columns, mirrored)
        if labelled is not None and len(labelled.circle) > len(best.circle):
            best = labelled
    return best if len(best.circle) >= _LEAST_DOTS else None


def label_shifted(circles: Circles, rows: int, columns: int, mirrored: bool) -> Labelled | None:
    """The circles of a grid whose every second row is shifted, a square lattice along its diagonals, seen whole."""
    best = Labelled(np.zeros(0, dtype=np.int64), np.zeros((0, 2), dtype=np.int64))
    for grown in _lattices(circles):
        for turn in _TURNS[:8]:
            along, across = (grown.place @ turn.T @ np.array([[1, 1], [1, -1]])).T
            row, column = along - along.min(), across - across.min()
            place = np.column_stack([row, column // 2])
            fits = row.max() + 1 == rows and ((column - row % 2) % 2 == 0).all() and column.max() // 2 + 1 == columns
            whole = len(place) >= _WHOLE * rows * columns and len(place) > len(best.circle)
            if fits and whole and _axes(np.column_stack([row, column]), circles.uv[grown.circle])[1] == mirrored:
                best = Labelled(grown.circle, place)
    return best if len(best.circle) >= _LEAST_DOTS else None


def _axes(place: IntArray, uv: FloatArray) -> tuple[FloatArray, bool]:
    """The step to the next column in the image, and whether rows count upward, seen with the columns to the right."""
    down, right = np.linalg.lstsq(place - place.mean(axis=0), uv - uv.mean(axis=0), rcond=None)[0]
    return right, bool(right[0] * down[1] - right[1] * down[0] < 0)


def _lattices(circles: Circles) -> list[Labelled]:
    """Lattices grown from some dots near the middle of the rest, largest first, each set of circles once."""
    if len(circles) < _LEAST_DOTS:
        return []
    tree = KDTree(circles.uv)
    area = circles.semi_axes.prod(axis=1)
    middle = np.median(circles.uv, axis=0)
    order = np.argsort(np.linalg.norm(circles.uv - middle, axis=1), kind="stable")
    seeds = order[:: max(1, len(order) // _SEEDS)][:_SEEDS]
    found: list[Labelled] = []
    for seed in seeds:
        if any(seed in lattice.circle for lattice in found if len(lattice.circle) > len(circles) // 2):
            continue
        for first, second in _first_steps(circles.uv, tree, int(seed)):
            lattice = _grow(circles.uv, area, tree, int(seed), first, second)
            if len(lattice.circle) >= _LEAST_DOTS:
                found.append(lattice)
    return sorted(found, key=lambda lattice: -len(lattice.circle))[:6]


def _first_steps(uv: FloatArray, tree: KDTree, seed: int) -> list[tuple[FloatArray, FloatArray]]:
    """Pairs of steps to neighbours that may be the lattice's: short, and with as much area as any between them."""
    near = np.asarray(tree.query(uv[seed], k=min(9, len(uv)))[1], dtype=np.int64)
    steps = uv[near[1:]] - uv[seed]
    pairs = []
    for i in range(len(steps)):
        for j in range(i + 1, len(steps)):
            a, b = steps[i], steps[j]
            sine = abs(a[0] * b[1] - a[1] * b[0]) / (np.linalg.norm(a) * np.linalg.norm(b))
            if sine > 0.35:
                pairs.append((float(np.linalg.norm(a) * np.linalg.norm(b)) / sine**0.5, i, j))
    pairs.sort()
    return [(steps[i], steps[j]) for _, i, j in pairs[:2]]


def _grow(uv: FloatArray, area: FloatArray, tree: KDTree, seed: int, first: FloatArray, second: FloatArray) -> Labelled:
    """The lattice over all circles that can be reached from one by its steps."""
    place = {seed: (0, 0)}
    taken = {(0, 0): seed}
    steps = {seed: np.array([first, second])}
    queue = [seed]
    while queue:
        dot = queue.pop(0)
        for axis, sign in product((0, 1), (1, -1)):
            at = place[dot][0] + sign * (axis == 0), place[dot][1] + sign * (axis == 1)
            if at in taken:
                continue
            step = sign * steps[dot][axis]
            distance, other = tree.query(uv[dot] + step)
            other = int(other)
            ratio = area[other] / area[dot]
            if distance > _NEAR * np.linalg.norm(step) or other in place or not 1 / _AREA_RATIO < ratio < _AREA_RATIO:
                continue
            place[other], taken[at] = at, other
            own = steps[dot].copy()
            own[axis] = sign * (uv[other] - uv[dot])
            steps[other] = 0.5 * (own + steps[dot]) if len(place) < 4 else own
            queue.append(other)
    circle = np.array(list(place), dtype=np.int64)
    return Labelled(circle, np.array([place[c] for c in circle], dtype=np.int64).reshape(-1, 2))


# Integer maps of the plane onto itself: the eight of a square first, then sheared ones, since a board that is seen very
# obliquely may be grown along its diagonals.
_MAPS = [np.array(m).reshape(2, 2) for m in product((-1, 0, 1), repeat=4)]
_TURNS = sorted(
    (m for m in _MAPS if abs(m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]) == 1), key=lambda m: int(np.abs(m).sum())
)


def _by_rings(
    grown: Labelled, ring: BoolArray, rows: int, columns: int, rings: tuple[tuple[int, int], ...]
) -> Labelled | None:
    """The lattice laid onto the board by its rings, if in one way only; dots beyond the board are left out."""
    wanted = np.array(rings)
    seen = grown.place[ring[grown.circle]]
    if len(seen) < min(_LEAST_RINGS, len(wanted)):
        return None
    scores: dict[tuple[int, ...], tuple[float, Labelled]] = {}
    for number, turn in enumerate(_TURNS):
        turned = grown.place @ turn.T
        for anchor, target in product(seen @ turn.T, wanted):
            place = turned + (target - anchor)
            inside = ((place >= 0) & (place < (rows, columns))).all(axis=1)
            on_ring = (place[:, None] == wanted).all(axis=2).any(axis=1)
            is_ring = ring[grown.circle]
            right = int((inside & on_ring & is_ring).sum())
            wrong = int((inside & (on_ring != is_ring)).sum())
            if right < min(_LEAST_RINGS, len(wanted)) or wrong > 0:
                continue
            key = tuple((place[0] * 1000 + place[-1]).tolist())
            sheared = 0.5 * (number >= 8)
            scores.setdefault(
                (*key, *place[len(place) // 2]), (right - sheared, Labelled(grown.circle[inside], place[inside]))
            )
    if not scores:
        return None
    ranked = sorted(scores.values(), key=lambda item: -item[0])
    if len(ranked) > 1 and ranked[1][0] == ranked[0][0]:
        return None
    return ranked[0][1]


def _by_extent(grown: Labelled, uv: FloatArray, rows: int, columns: int, mirrored: bool) -> Labelled | None:
    """The lattice laid onto a board without marks, which it must fill; columns run most nearly to the image's right."""
    best: tuple[float, Labelled] | None = None
    for turn in _TURNS:
        place = grown.place @ turn.T
        place = place - place.min(axis=0)
        if tuple(place.max(axis=0) + 1) != (rows, columns) or len(place) < _WHOLE * rows * columns:
            continue
        right, turned_over = _axes(place, uv[grown.circle])
        if turned_over != mirrored:
            continue
        score = float(right[0] / np.linalg.norm(right)) - 0.1 * int(np.abs(turn).sum() > 2)
        if best is None or score > best[0]:
            best = score, Labelled(grown.circle, place)
    return best[1] if best else None
