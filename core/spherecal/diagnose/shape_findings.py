"""Finding: the ball is not one rigid object; whether its shape changed, and at which placement."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spherecal.adjust.bundle import Adjustment, refine
from spherecal.adjust.problem import NO_LENGTHS
from spherecal.adjust.weights import left_over_by_points
from spherecal.ball.rigid import align, share_shape
from spherecal.ball.selection import NOTICEABLE
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding, leave_out
from spherecal.diagnose.evidence import STAGE, Evidence
from spherecal.diagnose.image_findings import LEAST_POINTS, WrongImage

# One placement is named when without it this little is left of what the rigid form does not explain: a ball changed at
# one of four placements (0.2 mm) leaves 0 to 3 %, changed at all four 41 to 115 % whichever is left out.
LITTLE_LEFT = 0.2
# Another placement that shares most dots with the odd one leaves as little as 4.5 %, but always several times more.
TIMES_MORE, LEAST_MORE = 2.0, 0.03
# With more placements than this only those with most unexplained are tried (0.1 s each).
MOST_TRIED = 6
# A placement is at fault, not its cameras, when this many and at least this share of its images contradict the rest.
MANY_IMAGES, MOST_IMAGES = 3, 0.5
# Of squares in variances that an observation has at least which the gate left out (4.5 standard deviations).
GATED = 20.0
# So large a change is no ball's: 20 times what makes the rigid form useless.
TOO_LARGE_MM = 1.0
# Of a smooth change the pose of the placement and the shape take so much that 0.4 of it is seen (0.8 of random ones).
VISIBLE_SHARE = 0.5


def changed_shape(e: Evidence, in_shape: bool) -> list[Finding]:
    """The finding where the rigid form fits clearly worse than free points, and cameras agree on it (decision 0011)."""
    choice = e.choice
    if choice.ratio is None or choice.limit is None or not np.isfinite(choice.ratio):
        return []
    beyond = choice.ratio > choice.limit
    if not beyond and not (in_shape and choice.ratio > NOTICEABLE and choice.ball_changed):
        return []
    if not choice.ball_changed:
        return [Finding("rigid-form-misfit", "warning", {"ratio": choice.ratio, "limit": choice.limit})]
    where, at = (), Phrase("at-all-placements")
    odd = _odd_one(e)
    if odd is not None:
        where = (e.observations.placements[odd[0]],)
        at = Phrase("above-all-at", {"place": where[0], "percent": 100 * odd[1]})
    size = _size_mm(e, choice.ratio)
    if size > TOO_LARGE_MM:
        return [Finding("placements-contradict", "warning", {"at": at, "size_mm": size}, where, kind="gross")]
    kind = "not-rigid" if choice.form != "rigid" else "beyond" if beyond else "harmless"
    values = {"at": at, "ratio": choice.ratio, "limit": choice.limit, "size_mm": size}
    repairs = leave_out(*(f"placement:{name}" for name in where))
    return [Finding("ball-shape-changed", "warning" if beyond else "info", values, where, repairs, kind)]


def contradicting_placements(e: Evidence, wrong: Sequence[WrongImage]) -> list[Finding]:
    """Findings on placements most of whose images contradict all others in the rigid form."""
    if e.solved.rigid is None:
        return []
    seen = (e.image_counts(e.candidates) >= LEAST_POINTS).sum(axis=1)
    kinds = [image.placement for image in wrong if image.kind in ("moved", "unknown")]
    bad = np.bincount(np.array(kinds, dtype=np.int64), minlength=len(seen))
    found = []
    for t in np.flatnonzero((bad >= MANY_IMAGES) & (bad >= MOST_IMAGES * seen)):
        name = e.observations.placements[t]
        out = int(e.image_counts(e.contradicting)[t].sum())
        values = {"wrong": bad[t], "images": seen[t], "out": out}
        repairs = leave_out(f"placement:{name}")
        found.append(Finding("ball-shape-changed", "warning", values, (name,), repairs, "placement"))
    return found


def _odd_one(e: Evidence) -> tuple[int, float] | None:
    """The placement without which the rigid form fits, and the share of the misfit that is then left."""
    alignment, ratio = e.choice.alignment, e.choice.ratio
    placement = e.observations.placement
    count = len(e.session.placements)
    if alignment is None or ratio is None or alignment.moved.sum() < 2:
        return None
    network = replace(e.solved.network, lengths=NO_LENGTHS)
    if e.solved.rigid is None:
        known = e.adjusted.state  # in millimetres, which those of the choice are not
        alignment = align(e.features, known.points, len(alignment.root), count)
        rigid, start = share_shape(network, e.features, known, alignment)
        everything = refine(rigid.network, start, e.used, e.solved.placed, e.context.part_of(STAGE, 0.8))
    else:
        rigid, everything = e.solved.rigid, e.adjusted
    free_variance = everything.variance / ratio
    tried = np.arange(count)
    if count > MOST_TRIED:
        tried = np.argsort(-_shares(e, everything, free_variance), kind="stable")[:MOST_TRIED]
    left = []
    for t in tried:
        rows, context = np.flatnonzero(placement != t), e.context.part_of(STAGE, 0.8)
        own, used = rigid.network.only(rows), everything.used[rows]
        fitted = refine(own, everything.state, used, e.solved.placed, context)
        left.append(max(fitted.variance / free_variance - 1, 0.0) / (ratio - 1))
    order = np.argsort(left)
    if len(order) < 2 or left[order[0]] > LITTLE_LEFT:
        return None
    best, second = (float(left[k]) for k in order[:2])
    if second < max(TIMES_MORE * best, best + LEAST_MORE):
        return None
    return int(tried[order[0]]), best


def _shares(e: Evidence, rigid: Adjustment, free_variance: float) -> FloatArray:
    """What each placement (t,) adds to v'Pv beyond its share, as a share of the whole excess."""
    problem = rigid.problem
    residual, taken = left_over_by_points(problem, rigid.state)
    placement: IntArray = e.observations.placement[rigid.rows]
    count = len(e.session.placements)
    ball = placement < count
    squares = np.bincount(placement[ball], (residual[ball] ** 2).sum(axis=1), count)
    left = np.bincount(placement[ball], 2.0 - taken[ball], count)
    left *= max(rigid.redundancy, 1) / max(float((2.0 - taken).sum()), 1.0)
    used = np.zeros(len(e.used), dtype=bool)
    used[rigid.rows] = True
    lost = e.used & ~used & (e.observations.placement < count)  # to the rigid form's gate
    squares += GATED * free_variance * np.bincount(e.observations.placement[lost], minlength=count)
    excess = np.maximum(squares - free_variance * left, 0.0)
    return excess / excess.sum() if excess.sum() > 0 else excess


def _size_mm(e: Evidence, ratio: float) -> float:
    """Roughly how far the dots moved, rms in three dimensions."""
    state, o = e.solution.state, e.observations
    points = state.points[e.features.of_observation]
    rows = np.flatnonzero(e.used & np.isfinite(points[:, 0]))
    camera = o.camera[rows]
    depth = np.einsum("ni,ni->n", state.rotation[camera, 2], points[rows]) + state.translation[camera, 2]
    mm_per_px = float(np.median(depth / state.intrinsics[camera, 0]))
    noise = float(np.nanmedian(e.noise_px)) / (np.sqrt(ratio) if e.solved.rigid is not None else 1.0)
    return noise * np.sqrt(max(ratio - 1, 0.0) * 3) * mm_per_px / VISIBLE_SHARE
