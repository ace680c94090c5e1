"""How much the result depends on single placements, cameras and images, compared with the effect of noise alone.

Left out, a group of observations with residuals r_g changes the unknowns by N^-1 A_g' r_g to first order: the
delete-one-group jackknife (B. Efron, The jackknife, the bootstrap and other resampling plans, 1982). Noise that differs
from point to point makes these changes as large as the covariance says, less what the fit takes up. Errors that whole
placements, cameras or images have in common make them larger, long before any single test is certain. Such are a ball
that bends, a lens beyond its model, a camera that exposes late.
"""

from collections.abc import Iterator

import numpy as np

from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.data.findings import Finding
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.score import TERMS, ScoreTest, change_of, field_terms, field_values, spread
from spherecal.geometry.field_table import FieldTable, table_nodes
from spherecal.geometry.length_uncertainty import LENGTH_MM, Cameras, length_gradients, measured_volume

# Adjustments of noise alone that the real one is compared with; so many standard deviations above their mean is beyond
# chance.
DRAWS, BEYOND = 16, 4.0
# Frames of a board are few, and nothing but their number keeps them from being certain: halves of 3 of 28 real pictures
# were up to 5.9 stated standard deviations apart (nominal points of a print that was 0.04 mm off).
BEYOND_OF_FRAMES = 1.0
# What is less than this is not worth a word (cameras.SCATTERING).
LEAST_TIMES = 1.3
# What several parts have in common shows only in part when one is left out: five cameras of ten on a beam that sagged
# by 0.02 mm called for 1.48, and one of them was 5.4 times its U off.
IN_COMMON = 1.5
# Of two groups one is as far off as the other.
LEAST_GROUPS = 3
# Places along each axis of the volume at which lengths along all three axes are judged.
GRID = 3
# With more, the draws take longer than the rest of the diagnosis: 1.5 s at 36,000 (hall50), 6 s at 69,000 (hall100).
MOST_OBSERVATIONS = 40_000


def dependent_parts(e: Evidence) -> list[Finding]:
    """The finding that results depend on single placements, cameras or images more than noise explains.

    It has factors by which standard uncertainties of lengths and of poses must grow.
    """
    cofactors = e.solved.cofactors
    if cofactors is None or len(e.adjusted.rows) > MOST_OBSERVATIONS:
        return []
    if e.choice.form == "soft":  # its dots have their own shape noise, stated by its size
        return []
    probe = e.probe
    if probe is None or probe.shift is None:
        return []
    # the image of each row (n,), and for all images (i,) their placement, their camera and themselves
    both = np.stack([e.observations.placement[e.adjusted.rows], probe.problem.camera], axis=1)
    pairs, image = np.unique(both, axis=0, return_inverse=True)
    by_placement, by_camera = (np.unique(column, return_inverse=True)[1].reshape(-1) for column in pairs.T)
    groupings = by_placement, by_camera, np.arange(len(pairs))
    # poses of the placed cameras, of boards their intrinsics too, as functions (m, c*w) of all parameters
    width = probe.linear.width
    own = (width * np.flatnonzero(e.placed)[:, None] + np.arange(width if e.of_frames else POSE)).ravel()
    functions = length_functions(e, probe.problem.intrinsic_columns)[0], np.eye(len(e.placed) * width)[own]
    covariance = probe.variance * cofactors.all_cameras()
    variances = [np.einsum("mi,mi->m", f @ covariance, f) for f in functions]
    noise = np.random.default_rng(0).normal(0.0, np.sqrt(probe.variance), (len(probe.residual), DRAWS))
    residuals = np.column_stack([probe.residual, probe.past_unknowns(noise)])
    by_scores = cofactors.by_scores(np.concatenate(functions))
    by_image = _changes(probe, by_scores, image.reshape(-1), residuals)
    changes = np.stack(list(by_image), axis=1)  # (1 + draws, images, functions)
    growth, beyond = [1.0, 1.0], BEYOND_OF_FRAMES if e.of_frames else BEYOND
    for group in groupings:
        count = int(group.max()) + 1
        if count < LEAST_GROUPS:
            continue
        e.context.check()
        alone = count == len(group)
        together = changes if alone else (group == np.arange(count)[:, None]).astype(float) @ changes
        together = together - together.mean(axis=1, keepdims=True)
        parts = np.split(together, [len(functions[0])], axis=2)
        for k, (part, variance) in enumerate(zip(parts, variances, strict=True)):
            growth[k] = max(growth[k], _growth(_squares(part, variance), beyond))
    lengths, poses = growth
    # all poses are off together by what turns the points' frame, and a mean over them hides it: lengths grew 2.13
    # times, poses by nothing, and two cameras of 16 were 3.1 and 4.6 times their U off
    poses = max(lengths, IN_COMMON * poses if poses > LEAST_TIMES else poses)
    return [Finding("parts-disagree", "info", {"lengths": lengths, "poses": poses})] if poses > LEAST_TIMES else []


def bent_by_lenses(e: Evidence, cameras: IntArray) -> tuple[FloatArray, dict[int, FieldTable]] | None:
    """What the fields of some lenses (k,), all estimated together, may have done to the cameras: a change (c*w,).

    Nothing corrects the fields: they move the ends of lengths in their images too, and by camera that is what its image
    points are uncertain by. Pixels skewed by 2 px over the height, the same in all ten cameras of rig A: what both do
    to lengths by a bar or a board has correlations of 0.91 to 0.998 with their errors, and hardly any with what noise
    does: no factor served the middle of the volume and its rim.
    """
    cofactors, probe = e.solved.cofactors, e.probe
    if cofactors is None or probe is None or probe.shift is None or len(e.adjusted.rows) > MOST_OBSERVATIONS:
        return None
    sizes = [e.session.cameras[c].image_size for c in cameras]
    rows = np.flatnonzero(np.isin(probe.problem.camera, cameras))
    at = np.searchsorted(cameras, probe.problem.camera[rows])
    values = np.zeros((len(rows), 2, 2 * TERMS))
    for k, size in enumerate(sizes):
        values[at == k] = field_values(probe, rows[at == k], np.array(size))
    fields = spread(values, 2 * TERMS * at, (2 * len(rows), 2 * TERMS * len(cameras)))
    change = change_of(*probe.block(rows, fields), probe.variance)
    if change.statistic <= change.dof:
        return None
    real = np.sqrt(1 - change.dof / change.statistic)  # the rest is noise
    force, by_points = probe.forces(rows, (fields @ change.value)[:, None])
    by_column, pulled, by_datum = cofactors.by_scores(np.eye(len(e.placed) * probe.linear.width))
    tables = {}
    for c, size, field in zip(cameras, sizes, change.value.reshape(-1, 2, TERMS), strict=True):
        pitch, nodes, shape = table_nodes(size)
        off = real * np.linalg.norm(field_terms(nodes, np.array(size)) @ field.T, axis=1) / np.sqrt(2)
        tables[int(c)] = FieldTable(pitch, np.zeros(2), np.zeros(shape), np.zeros(shape), off.reshape(shape))
    return real * (force @ by_column + by_points @ pulled @ by_datum)[0], tables


def length_functions(e: Evidence, columns: IntArray) -> tuple[FloatArray, float]:
    """Derivatives (m, c*w) of lengths in the volume by poses and intrinsics (k,), w = 6 + k; these lengths' size."""
    state, placed, width = e.adjusted.state, np.flatnonzero(e.placed), POSE + len(columns)
    size = np.array([e.session.cameras[c].image_size for c in placed], dtype=float)
    cameras = Cameras(
        state.intrinsics[placed], state.rotation[placed], state.translation[placed], size, np.zeros((0, 0)), columns
    )
    places = e.solution.state.points / e.solution.factor
    volume = measured_volume(places[np.isfinite(places[:, 0])], cameras.centres)
    length = LENGTH_MM / e.solution.factor
    middle, half = volume.grid(GRID), length / 2 * volume.axes
    ends = np.stack([middle[:, None] - half, middle[:, None] + half], axis=2).reshape(-1, 2, 3)
    of_placed = length_gradients(cameras, ends)
    gradient = np.zeros((len(of_placed), len(e.placed), width))
    gradient[:, placed] = of_placed.reshape(len(of_placed), len(placed), width)
    return gradient.reshape(len(of_placed), len(e.placed) * width), length


def _changes(
    probe: ScoreTest, by_scores: tuple[FloatArray, ...], image: IntArray, residuals: FloatArray
) -> Iterator[FloatArray]:
    """The effect of each image, with each of the residuals (2n, k), on the functions: (k, m)."""
    by_column, pulled, by_datum = by_scores
    order = np.argsort(image, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(image[order])) + 1):
        force, by_points = probe.forces(rows, residuals[(2 * rows[:, None] + np.arange(2)).ravel()])
        yield force @ by_column + by_points @ pulled @ by_datum


def _squares(changes: FloatArray, variance: FloatArray) -> FloatArray:
    """Sums (k,) over groups of squared changes (k, groups, ...) over variances (...), the mean of those that vary."""
    # what is all but fixed varies by rounding alone
    count, varies = changes.shape[1], variance > 1e-12 * variance.max(initial=0.0)
    if not varies.any():
        return np.zeros(len(changes))
    return count / (count - 1) * ((changes[..., varies] ** 2).sum(axis=1) / variance[varies]).mean(axis=1)


def _growth(squares: FloatArray, beyond: float = BEYOND) -> float:
    """The growth of standard uncertainties by squares (1 + draws,), the first of them of the real residuals."""
    real, noise = squares[0], squares[1:]
    if not real > noise.mean() + beyond * noise.std():
        return 1.0
    return float(np.sqrt(real / noise.mean()))
