"""Whether the ball is deformed in space and not in itself: flattened by its weight, however it is turned.

A strain that is the same in space at all placements is no change of the ball from one to the next. The rigid form then
bends lenses and lengths to make up for it. Cameras that all look in one direction hardly show a strain along it.
"""

import numpy as np
from scipy.special import chdtri

from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.space_strain import STRAINS
from spherecal.base.arrays import FloatArray, IntArray, blocks
from spherecal.data.findings import Finding
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.score import ScoreTest

# Once in 10,000 recordings by chance: chi-square 32 to 3,700 for 0.3 mm on 500 mm (rigs A and B, hall12, random), 1 to
# 8 without. Lengths on rig A are off by a third of the strain, 17 times U on a random rig. It is part of every
# U then, so that only a ball that nobody should use costs the verdict: lenses beyond their model passed for 0.061 %
# with a chi-square of 70 (realistic recording 9200).
FALSE_ALARM, LEAST, HARMFUL = 1e-4, 1e-4, 1e-3
# From here on it is what a change of the ball's shape, or what the rigid form leaves, comes from.
EXPLAINS = 2e-4
# Known less well than to 0.02 % a strain is not believed: lenses beyond their model had 0.2 to 50 %, with standard
# deviations of 0.03 to 10 %, in 3 of 60 realistic recordings; 0.3 mm on 500 mm has 0.005 to 0.013 %.
MOST_SD = 2e-4
# Where one direction is known less well than this, a ball that has a strain in the others may have any in it: flattened
# by 1 mm before four to six cameras at random, 4 to 21 times U (known to 0.16 to 0.36 %, chi-square 9 to 75 on 4). One
# in 200 by chance, of such rigs alone; lenses beyond their model show as much where it is known to 0.06 to 0.09 %.
UNKNOWN, OFTEN = 1e-3, 5e-3


def flattened_ball(e: Evidence, growth: float) -> list[Finding]:
    """The finding where one strain in space explains what the ball, as one rigid object, does not.

    `growth`: so many times as much as noise do parts of the recording disagree about lengths: a ball that bends by 0.02
    mm at random has a chi-square of 36, of which 7 are left; one that its weight flattens by 0.3 mm 55 to 195.
    """
    probe, count = e.probe, len(e.session.placements)
    lenses_free = e.adjusted.problem.free_intrinsics[e.placed, 0].all()  # wrong ones that are fixed look alike
    if probe is None or e.solved.rigid is None or not lenses_free:
        return []
    rows, values = _derivatives(e, probe, count)
    g, a, _ = probe.block(rows, values)
    information, direction = np.linalg.eigh(a / probe.variance)
    known = information > MOST_SD**-2
    value = -(direction.T @ g)[known] / probe.variance / information[known]
    statistic = float(value**2 @ information[known]) / growth**2
    strain = float(np.abs(np.linalg.eigvalsh(np.einsum("k,kij->ij", direction[:, known] @ value, STRAINS))).max())
    is_known = bool(information.min() > UNKNOWN**-2)
    if not known.any() or statistic < chdtri(len(value), FALSE_ALARM if is_known else OFTEN):
        return []
    if is_known and (strain < LEAST or strain > MOST_SD * np.sqrt(statistic)):
        return []
    diameter = 2 * float(np.median([s.radius for s in e.solution.spheres.values()] or [0.0]))
    values_of = {"percent": 100 * strain, "mm": strain * diameter, "chi_square": statistic, "dof": len(value)}
    if not is_known:
        return [Finding("ball-shape-changed", "warning", values_of, kind="in-space-unknown")]
    return [Finding("ball-shape-changed", "warning" if strain > HARMFUL else "info", values_of, kind="in-space")]


def _derivatives(e: Evidence, probe: ScoreTest, count: int) -> tuple[IntArray, FloatArray]:
    """The rows of the ball (k,), and their weighted derivatives (k,2,5) by the strains, about the ball's middle."""
    a, state = e.adjusted, e.solution.state
    placement, feature = e.observations.placement[a.rows], e.features.of_observation[a.rows]
    rows = np.flatnonzero((placement < count) & np.isfinite(state.points[feature, 0]))
    x, rotation = state.points[feature[rows]] / e.solution.factor, state.rotation[a.problem.camera[rows]]
    number = np.maximum(np.bincount(placement[rows], minlength=count), 1)
    middle = np.stack([np.bincount(placement[rows], x[:, i], count) / number for i in range(3)], axis=1)
    out, moved = x - middle[placement[rows]], np.empty((len(rows), 2, len(STRAINS)))
    for some in blocks(len(rows)):
        turned = np.einsum("nij,kjl,nl->nik", rotation[some], STRAINS, out[some], optimize=True)
        moved[some] = probe.by_pose(rows[some])[:, :, 3:POSE] @ turned
    return rows, moved
