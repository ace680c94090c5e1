"""Whether the ball, or the rig around it, grew or shrank between placements, as with changes of temperature.

The rigid form has one size of the ball. Separate sizes for each placement are tested against everything that is
estimated (score.py), and become part of that form if they explain most of its misfit. The recording does not show
whether the ball or the rig has changed, nor which size is right from now on. So the differences of the sizes are added
to the scale's uncertainty. Sizes that are not used, but are more than chance, are added to the cameras' uncertainty by
the amount by which they would move the cameras (decision 0018).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from spherecal.adjust.ball_model import Rigid
from spherecal.adjust.bundle import Adjustment, refine
from spherecal.adjust.covariance import covariance
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import NO_LENGTHS
from spherecal.adjust.weights import left_over_by_points
from spherecal.ball.rigid import NOTICEABLE, RigidNetwork, align, share_shape
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding, leave_out
from spherecal.diagnose.evidence import STAGE, Evidence
from spherecal.diagnose.image_findings import LEAST_POINTS, WrongImage
from spherecal.diagnose.influence import MOST_OBSERVATIONS
from spherecal.diagnose.score import LEAST_SHARE, Change, ScoreTest, change_of, make_score_test

# In one of a million faultless recordings noise looks like a change.
FALSE_ALARM = 1e-6
# In one of a hundred faultless recordings cameras are stated to be less certain than they are. A ball that grew by 200
# ppm in a hall (chi-square 26 on 7) left a camera 2.7 times its U off.
WIDENED_FOR_NOTHING = 0.01
# Of what the rigid form does not explain: a camera that moved, or a ball that bends, looks a little like a change of
# size too.
MOST_OF_IT = 0.5
# The largest change that is merely stated: 0.5 mm on 500 mm. A plastic ball grows by some 70 ppm a degree, a rig of
# aluminium by 23.
MOST_CHANGE = 1000e-6
# More columns than these take longer than the rest of the diagnosis.
MOST_PLACEMENTS = 30


@dataclass(frozen=True)
class SizeChange:
    """The ball's sizes at the placements (t,), relative to their mean: used in the rigid form, or possible ones.

    `by_camera` (k,c,w): what k independent errors of the sizes, each of one standard uncertainty, do to every camera.
    Its w numbers are the pose (turn in rad, shift in mm) and the estimated intrinsics.
    """

    sizes: FloatArray
    by_camera: FloatArray

    @property
    def largest(self) -> float:
        """The largest difference from the mean size, relative."""
        return float(np.abs(self.sizes).max())

    def finding(self, placements: tuple[str, ...], diameter_mm: float) -> Finding:
        """The finding that says so; a warning where the change is more than `MOST_CHANGE`."""
        small, large = int(self.sizes.argmin()), int(self.sizes.argmax())
        change = float(self.sizes[large] - self.sizes[small])
        where = (placements[small], placements[large])
        values = {"small": where[0], "large": where[1], "ppm": 1e6 * change, "mm": change * diameter_mm}
        return Finding("ball-size-changed", "warning" if change > MOST_CHANGE else "info", values, where)


@dataclass(frozen=True)
class _Test:
    """The test of separate sizes for each placement: the network, derivatives (2n,t) by the sizes, and the result."""

    probe: ScoreTest
    columns: FloatArray
    normal: FloatArray
    change: Change
    seen: BoolArray

    @property
    def uncertain(self) -> FloatArray:
        """Directions (k,t), of one standard uncertainty each, in which the sizes that are seen are uncertain."""
        share, axes = np.linalg.eigh(self.normal)
        good = share > LEAST_SHARE * share.max()
        return (axes[:, good] * np.sqrt(self.probe.variance / share[good])).T

    def beyond_chance(self, growth: float) -> FloatArray | None:
        """Sizes (t,), also tested for steady growth by warmth, less their expectation by chance; None if by chance."""
        times = np.where(self.seen, np.arange(len(self.seen)) - np.flatnonzero(self.seen).mean(), 0.0)[:, None]
        columns = self.columns @ times
        g, normal = columns.T @ self.probe.residual, times.T @ self.normal @ times
        steady = change_of(g, normal, columns.T @ columns, self.probe.variance)
        tried = [(self.change, self.sizes), (steady, times @ steady.value)]
        tried = [(replace(change, statistic=change.statistic / growth**2), sizes) for change, sizes in tried]
        change, sizes = min(tried, key=lambda one: one[0].log10_p)
        if not change.log10_p < np.log10(WIDENED_FOR_NOTHING / len(tried)):
            return None
        return sizes * np.sqrt(1 - change.dof / change.statistic)

    @property
    def sizes(self) -> FloatArray:
        """Relative sizes (t,) about their mean; 0 where the ball is not seen."""
        value = self.change.value
        return np.where(self.seen, value - value[self.seen].mean(), 0.0)


def sizes_to_fit(
    rigid: RigidNetwork, adjusted: Adjustment, placement: IntArray, count: int, free_variance: float | None
) -> FloatArray | None:
    """Relative sizes (t,) of the ball that explain most of what its rigid form does not; None where none do.

    Rao's score test (decision 0018). Sizes are taken where chance gives such a statistic in less than one of a million,
    and where they explain more than half of what the rigid form does not.
    """
    if not _can_be_tested(adjusted, count):
        return None
    cofactors = covariance(adjusted.problem, adjusted.state, rigid.places)
    if cofactors is None:
        return None
    probe = make_score_test(adjusted.problem, adjusted.state, cofactors, adjusted.minimum.cost, adjusted.redundancy)
    points = rigid.as_features(adjusted.state).points[rigid.feature[adjusted.rows]]
    test = _tested(adjusted, probe, placement[adjusted.rows], points, count)
    if test is None or free_variance is None:
        return None if test is None else test.sizes
    change = test.change
    if not change.dof or change.statistic < chdtri(change.dof, FALSE_ALARM):
        return None
    unexplained = 2 * adjusted.minimum.cost - free_variance * adjusted.redundancy
    explained = change.statistic * adjusted.variance
    return test.sizes if explained > MOST_OF_IT * unexplained else None


def size_change(e: Evidence) -> SizeChange | None:
    """The ball's sizes in the rigid form, and the effect of their uncertainty on the cameras; None for one size."""
    sizes = e.choice.sizes
    test = None if sizes is None else _tested_result(e, len(sizes))
    return None if sizes is None or test is None else SizeChange(sizes, _by_camera(e, test, test.uncertain))


def possible_sizes(e: Evidence, growth: float) -> SizeChange | None:
    """Sizes that the ball may have had where the rigid form has one, and what they do to the cameras; None for none."""
    if e.choice.sizes is not None or not len(e.adjusted.problem.intrinsic_columns):
        return None
    test = _tested_result(e, len(e.session.placements))
    sizes = None if test is None else test.beyond_chance(growth)
    return None if sizes is None or test is None else SizeChange(sizes, _by_camera(e, test, sizes[None]))


def _tested_result(e: Evidence, count: int) -> _Test | None:
    points = e.solution.state.points[e.features.of_observation[e.adjusted.rows]] / e.solution.factor
    return _tested(e.adjusted, e.probe, e.observations.placement[e.adjusted.rows], points, count)


def _by_camera(e: Evidence, test: _Test, sizes: FloatArray) -> FloatArray:
    """The effect of sizes (k,t) on the pose (rad, mm) and estimated intrinsics of every camera, (k,c,w)."""
    cofactors, problem = e.solved.cofactors, e.adjusted.problem
    assert cofactors is not None
    width = POSE + len(problem.intrinsic_columns)
    by_column, pulled, by_datum = cofactors.by_scores(np.eye(len(e.placed) * width))
    force, by_points = test.probe.forces(np.arange(len(problem.uv)), test.columns @ sizes.T)
    by_camera = (force @ by_column + by_points @ pulled @ by_datum).reshape(len(sizes), -1, width)
    by_camera[:, :, 3:POSE] *= e.solution.factor
    return by_camera


def _can_be_tested(adjusted: Adjustment, count: int) -> bool:
    has_noise = adjusted.redundancy > 0 and adjusted.variance > 0
    few = 2 <= count <= MOST_PLACEMENTS and len(adjusted.rows) <= MOST_OBSERVATIONS
    return isinstance(adjusted.problem.ball, Rigid) and has_noise and few


def _tested(
    adjusted: Adjustment, probe: ScoreTest | None, placement: IntArray, points: FloatArray, count: int
) -> _Test | None:
    """The test on a rigid form; placement (n,) of its rows, their points (n,3) in the world; None if there is none."""
    if probe is None or probe.shift is None or not _can_be_tested(adjusted, count):
        return None
    columns = _by_size(probe, adjusted, placement, np.where(np.isfinite(points), points, 0.0), count)
    left = columns.T @ probe.past_unknowns(columns)
    normal = (left + left.T) / 2
    change = change_of(columns.T @ probe.residual, normal, columns.T @ columns, probe.variance)
    return _Test(probe, columns, normal, change, np.bincount(placement, minlength=count)[:count] > 0)


def _by_size(probe: ScoreTest, adjusted: Adjustment, placement: IntArray, place: FloatArray, count: int) -> FloatArray:
    """Derivatives (2n,t) of all rows by the ball's relative size at each placement."""
    columns = np.zeros((len(placement), 2, count))
    by_shift = probe.by_pose()[:, :, 3:POSE]
    for t in range(count):
        own = np.flatnonzero(placement == t)
        if not len(own):
            continue
        outward = place[own] - place[own].mean(axis=0)
        in_camera = np.einsum("nij,nj->ni", adjusted.state.rotation[adjusted.problem.camera[own]], outward)
        columns[own, :, t] = np.einsum("nij,nj->ni", by_shift[own], in_camera)
    return columns.reshape(-1, count)


# --- finding ---------------------------------------------------------------------------------------------------------

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
