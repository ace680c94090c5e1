"""Intrinsics that are held fixed and that the data contradict: how surely, and what that does to lengths.

One test for all methods. A lens that its model does not follow leaves structure in the residuals, which intrinsics take
up a little whatever they are. So what the intrinsics explain is compared, number by number, with what smooth fields
explain beyond them.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.influence import length_functions
from spherecal.diagnose.lens import LEAST_POINTS as LEAST_FOR_FIELDS
from spherecal.diagnose.lens import field_values
from spherecal.diagnose.moves import LEAST_POINTS
from spherecal.diagnose.score import Change, ScoreTest, change_of, conditional
from spherecal.geometry.camera import estimated_mask, project_with_derivatives, undistort

# Fixed intrinsics that noise alone contradicts so much in one of a million recordings. 0.15 % of the focal length of
# all cameras is found on the demo rig.
FALSE_ALARM = 1e-6
# Each camera's intrinsics, or one factor of all focal lengths, estimated beside the rest: where that changes a length
# by more than this many times U, lengths are wrong; below it, its share is added to the uncertainty.
MOST_OFF = 1.0
_BROWN = np.flatnonzero(estimated_mask("brown"))


@dataclass(frozen=True)
class _Contradiction:
    """A test that failed: of which cameras, by how much of its limit, and what it does to lengths and poses.

    `lengths`: largest change over its standard uncertainty; `poses` likewise; `focal` the relative change of the focal
    length.
    """

    cameras: tuple[str, ...]
    change: Change
    limit: float
    lengths: float
    poses: float
    focal: float


def contradicted_lenses(e: Evidence, moved: Collection[str]) -> list[Finding]:
    """Findings on cameras whose given intrinsics the data contradict, moved ones left out."""
    problem, probe = e.adjusted.problem, e.probe
    fixed = np.flatnonzero(e.placed & ~problem.free_intrinsics[:, 0])
    if probe is None or probe.shift is None or not len(fixed):
        return []
    fixed = [int(c) for c in fixed if (problem.camera == c).sum() >= LEAST_POINTS and e.camera_ids[c] not in moved]
    blocks = {c: np.flatnonzero(problem.camera == c) for c in fixed}
    values = {c: _by_intrinsics(probe, e.adjusted.state.intrinsics, blocks[c]) for c in fixed}
    structure = {c: _structure(e, probe, blocks[c], values[c]) for c in fixed}
    level = FALSE_ALARM / (len(fixed) + 1)
    found = [
        one for c in fixed if (one := _tested(e, probe, (c,), blocks[c], values[c], structure[c], level)) is not None
    ]
    if len(fixed) > 1 and len(found) < len(fixed):
        rows = np.concatenate(list(blocks.values()))
        focal = e.adjusted.state.intrinsics[:, :2, None]  # derivatives by one factor of all focal lengths
        common = np.concatenate([values[c][:, :, :2] @ focal[c] for c in fixed])
        usual = float(np.median(list(structure.values())))
        all_of_them = _tested(e, probe, tuple(fixed), rows, common, usual, level)
        found = found if all_of_them is None else [*found, all_of_them]
    return [_finding(e, one) for one in found]


def _structure(e: Evidence, probe: ScoreTest, rows: IntArray, values: FloatArray) -> float:
    """What a number of a camera's smooth fields explains beyond its intrinsics, over noise; at least 1."""
    if len(rows) < LEAST_FOR_FIELDS:
        return 1.0
    size = np.array(e.session.cameras[int(probe.problem.camera[rows[0]])].image_size, dtype=float)
    both = np.concatenate([values, field_values(probe, rows, size)], axis=2)
    rest = change_of(*conditional(*probe.block(rows, both), np.arange(values.shape[2])), probe.variance)
    return max(rest.statistic / rest.dof, 1.0) if rest.dof else 1.0


def _tested(
    e: Evidence,
    probe: ScoreTest,
    cameras: tuple[int, ...],
    rows: IntArray,
    values: FloatArray,
    structure: float,
    level: float,
) -> _Contradiction | None:
    change = change_of(*probe.block(rows, values), probe.variance)
    limit = structure * float(chdtri(change.dof, level)) if change.dof else np.inf
    if change.statistic <= limit:
        return None
    step = np.zeros((len(e.placed), POSE + len(_BROWN)))
    intrinsics, is_factor = e.adjusted.state.intrinsics, len(change.value) == 1
    for c in cameras:
        own = intrinsics[c, :2] * change.value[0] if is_factor else change.value
        step[c, POSE : POSE + len(own)] = own
    width = probe.linear.width
    force = probe.forces(rows, values.reshape(-1, values.shape[2]) @ change.value[:, None])[0][0]
    followed = -(probe.inverse @ force)[: len(e.placed) * width].reshape(-1, width)
    step[:, :POSE] += followed[:, :POSE]
    at = np.searchsorted(_BROWN, probe.problem.intrinsic_columns)
    known = np.isin(probe.problem.intrinsic_columns, _BROWN)
    step[:, POSE + at[known]] += followed[:, POSE:][:, known]
    focal = change.value[0] if is_factor else step[cameras[0], POSE] / intrinsics[cameras[0], 0]
    ids = tuple(e.camera_ids[c] for c in cameras)
    return _Contradiction(ids, change, limit, *_effect(e, probe, step), float(focal))


def _effect(e: Evidence, probe: ScoreTest, step: FloatArray) -> tuple[float, float]:
    """Changes of lengths and of poses by a step (c, 6 + 9) of the cameras, the largest over their uncertainties."""
    assert e.solved.cofactors is not None
    covariance = probe.variance * e.solved.cofactors.all_cameras()
    by_all, length = length_functions(e, _BROWN)
    by_own, _ = length_functions(e, probe.problem.intrinsic_columns)
    off = by_all @ step.ravel()
    if not e.has_own_scale and len(off):  # the scale is measured in the changed network anew
        off = off - off.mean()
    scale = length * (e.solution.scale.relative_uncertainty or 0.0)
    sd = np.sqrt(np.einsum("mi,mi->m", by_own @ covariance, by_own).clip(0) + scale**2)
    pose = np.sqrt(covariance.diagonal().clip(0)).reshape(len(e.placed), -1)[:, :POSE]
    turned = np.abs(step[:, :POSE]) / np.where(pose > 1e-9 * pose.max(initial=0.0), pose, np.inf)
    return float((np.abs(off) / sd).max(initial=0.0)), float(turned.max(initial=0.0))


def _finding(e: Evidence, one: _Contradiction) -> Finding:
    """Not valid where lengths are off by more than U; else the change is added to the uncertainties."""
    severity = "error" if one.lengths > 2 * MOST_OFF else "warning"
    values = {
        "chi_square": one.change.statistic, "dof": one.change.dof, "limit": one.limit,
        "times": one.change.statistic / one.limit, "lengths": one.lengths / 2,
        "grow_lengths": float(np.hypot(1, one.lengths)), "grow_poses": float(np.hypot(1, one.poses)),
    }  # fmt: skip
    camera, *others = one.cameras
    if others:
        values |= {"worst": Phrase("all-focal-lengths")}
        return Finding("fixed-intrinsics-contradicted", severity, values, one.cameras, kind="all")
    prior = e.session.cameras[e.camera_ids.index(camera)].prior[:2].mean()
    values |= {"fixed_px": prior, "fitting_px": prior * (1 + one.focal)}
    return Finding("fixed-intrinsics-contradicted", severity, values, one.cameras, kind="one")


def _by_intrinsics(probe: ScoreTest, intrinsics: FloatArray, rows: IntArray) -> FloatArray:
    """Weighted derivatives (k,2,9) of some rows of one camera by Brown's intrinsics."""
    problem, c = probe.problem, int(probe.problem.camera[rows[0]])
    predicted = problem.uv[rows] + probe.linear.residual[rows] / problem.weight[rows]
    xy = np.nan_to_num(undistort(predicted, intrinsics[c])[0])
    x = np.column_stack([xy, np.ones(len(rows))])
    by_all = project_with_derivatives(x, intrinsics[c])[2]
    return by_all[:, :, _BROWN] * problem.weight[rows][:, :, None]
