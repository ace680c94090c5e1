"""What a calibration says about itself: findings with their values."""

from dataclasses import replace
from typing import Any

import numpy as np

from spherecal.adjust.intrinsic_priors import shown_lenses
from spherecal.adjust.parameter_layout import POSE
from spherecal.base.arrays import BoolArray, FloatArray, IntArray
from spherecal.base.errors import PartialResultAccepted
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.observations import Observations
from spherecal.data.session import Session
from spherecal.data.verdict import ruled
from spherecal.diagnose.diagnosis import diagnose
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.soundness import MANY_OUTLIERS, locked, outlier_share, unsound
from spherecal.diagnose.unconfirmed_poses import unconfirmed_findings
from spherecal.initialise.view_graph import MIN_COMMON, groups_of

# Self-calibration below this is what four spread placements give on rigs A and B (420 and 380 ppm) with a margin; one
# placement gives 7000.
WEAK_FOCAL_SD = 1000e-6
FEW_PLACEMENTS = 3
MANY_TWO_VIEW = 0.5
COVERAGE_CELLS, LITTLE_COVERAGE = 10, 0.6
# Stated for a length of this size, as the user thinks in millimetres on his bar.
STATED_LENGTH_MM = 500.0

STOPPED = Finding("stopped-early", "error")


def run_checks(evidence: Evidence) -> tuple[Finding, ...]:
    """All findings on a calibration with the severities of the table in data/verdict.py, errors first."""
    ambiguous = evidence.ambiguous
    # a camera's pose before it was knocked is not part of the rig
    settled = evidence.placed | ambiguous | evidence.is_earlier_pose
    faults = _faults(evidence)
    found = [
        *unlinked(evidence.observations, evidence.local.counts, evidence.local.triples, settled),
        *_outcome(evidence, ambiguous),
        *_geometry(evidence),
        *unconfirmed_findings(evidence, faults),
        *_held_intrinsics(evidence),
        *_weak_self_calibration(evidence),
        *_few(evidence),
        *_coverage(evidence),
        *_outliers(evidence),
        *_scale(evidence),
        *faults,
    ]
    return ruled([*found, *unsound(evidence, found)])


def _faults(e: Evidence) -> list[Finding]:
    """The findings of the diagnosis, or that it was stopped."""
    try:
        return diagnose(replace(e, context=e.context.accepting_partial()))
    except PartialResultAccepted:
        if e.context.has_partial_result:  # the caller's result is further on
            raise
        return [STOPPED]


def unlinked(observations: Observations, counts: IntArray, triples: list, placed: BoolArray) -> list[Finding]:
    """The finding on cameras not linked to the rest, group by group, by common features (c,c) and `placed` (c,)."""
    ids = np.array(observations.cameras)
    if placed.all():
        return []
    groups = _groups(counts, triples, placed)
    links = []
    for group in groups[1:]:
        outside = np.setdiff1d(np.arange(len(ids)), group)
        best = counts[np.ix_(group, outside)]
        i, j = np.unravel_index(int(np.argmax(best)), best.shape)
        ends = {"first": ids[group[i]], "second": ids[outside[j]]}
        links.append(Phrase("weakest-link", {"group": ids[group], "points": best[i, j], **ends}))
    named = [ids[group] for group in groups]
    where = tuple(str(name) for group in named for name in group)
    values = {"groups": named, "links": links, "least": MIN_COMMON}
    return [Finding("cameras-unlinked", "error", values, where, kind="ball" if links else "ball-none")]


def _groups(counts: IntArray, triples: list, placed: BoolArray) -> list[IntArray]:
    """Connected groups of cameras: the placed ones first, then the others by solved triples."""
    linked = np.zeros_like(counts)
    for triple in triples:
        linked[np.ix_(triple.cameras, triple.cameras)] = 1
    linked[np.ix_(placed, placed)] = 1
    linked[np.ix_(placed, ~placed)] = 0
    linked[np.ix_(~placed, placed)] = 0
    return groups_of(linked, placed)


def _outcome(e: Evidence, ambiguous: BoolArray) -> list[Finding]:
    """Findings on cameras whose points allow two poses, on the minimum, and on the form that was taken."""
    ids = tuple(e.camera_ids[c] for c in np.flatnonzero(ambiguous))
    found = [Finding("pose-ambiguous", "error", where=ids)] if ids else []
    if not e.adjusted.minimum.converged:
        found.append(Finding("not-converged", "error", {"steps": e.adjusted.minimum.iterations}, kind="ball"))
    choice = e.choice
    changed = choice.form != "rigid" and choice.ratio is not None and not choice.asked
    code = {"free": "form-free", "soft": "form-soft", "rigid": "form-rigid"}[choice.form]
    return [*found, Finding(code, "warning" if changed else "info", {"reason": choice.reason})]


def _geometry(e: Evidence) -> list[Finding]:
    found = []
    points, state = e.solution.state.points, e.solution.state
    if e.solution.covariance is None:
        found.append(Finding("degenerate-geometry", "error", kind="ball"))
    used = e.used
    depth = np.einsum("nj,nj->n", state.rotation[e.observations.camera, 2], points[e.features.of_observation])
    behind = used & (depth + state.translation[e.observations.camera, 2] <= 0)
    if behind.any():
        cameras = tuple(e.camera_ids[c] for c in np.unique(e.observations.camera[behind]))
        found.append(Finding("behind-camera", "error", {"points": behind.sum()}, cameras))
    if _mirrored(e):
        found.append(Finding("mirrored", "error", kind="targets"))
    return found


def _mirrored(e: Evidence) -> bool:
    """Whether most reconstructed targets face away from the cameras that see them, going by their layout's sense."""
    targets = e.session.target_set
    if targets is None:
        return False
    points = e.solution.state.points
    centres = -np.einsum("cji,cj->ci", e.solution.state.rotation, e.solution.state.translation)
    a_view = np.full(len(points), -1)
    a_view[e.features.of_observation[e.used]] = e.observations.camera[e.used]
    known = np.flatnonzero(np.isfinite(points[:, 0]))
    new_target = (np.diff(e.features.placement[known]) != 0) | (np.diff(e.features.target[known]) != 0)
    votes, groups = 0, np.split(known, np.flatnonzero(new_target) + 1)  # features are sorted by placement and target
    for k, rows in enumerate(groups):
        if abs(votes) > len(groups) - k:  # whatever the others say
            break
        layout = targets.layouts.get(int(e.features.target[rows[0]]), {}) if len(rows) else {}
        dots = [(row, layout[name]) for row in rows if (name := e.observations.points[e.features.point[row]]) in layout]
        if len(dots) < 4:
            continue
        at, flat = points[[row for row, _ in dots]], np.array([place for _, place in dots])
        axes = np.linalg.lstsq(flat - flat.mean(axis=0), at - at.mean(axis=0), rcond=None)[0]
        into_ball = np.cross(axes[0], axes[1])  # x right, y down: z away from the viewer
        votes += 1 if into_ball @ (at.mean(axis=0) - centres[a_view[dots[0][0]]]) > 0 else -1
    return votes < 0


def _held_intrinsics(e: Evidence) -> list[Finding]:
    shown = shown_lenses(e.adjusted.problem.free_intrinsics, e.placed, e.solved.has_prior).any()
    found = held_lenses(e.session, e.solution.state.intrinsics, e.solved.has_prior & e.placed, "ball")
    return [replace(one, severity="info") for one in found] if shown else found  # stated by what the others are off


def held_lenses(session: Session, intrinsics: FloatArray, held: BoolArray, kind: str) -> list[Finding]:
    """The finding on lenses (c,) that are held near their priors: which, and their focal lengths in px beside these."""
    own = np.flatnonzero(held)
    if not len(own):
        return []
    ids = tuple(session.cameras[c].id for c in own)
    now = [f"{session.cameras[c].id} {intrinsics[c, 0]:.0f} px ({session.cameras[c].prior[0]:.0f})" for c in own[:8]]
    values = {"held": [*now, *(["..."] if len(own) > 8 else [])]}
    return [Finding("intrinsics-held", "warning", values, ids, kind=kind)]


def _weak_self_calibration(e: Evidence) -> list[Finding]:
    cofactors, columns = e.solution.covariance, e.adjusted.problem.intrinsic_columns
    if cofactors is None or not len(columns) or columns[0] != 0:
        return []
    sd = np.sqrt(e.adjusted.variance * cofactors.cameras[:, POSE, POSE]) / e.solution.state.intrinsics[:, 0]
    free = e.adjusted.problem.free_intrinsics[:, 0] & e.placed & ~e.solved.has_prior
    return weak_focal_lengths(e.session, free, sd, "ball")


def weak_focal_lengths(session: Session, free: BoolArray, sd: FloatArray, kind: str) -> list[Finding]:
    """The finding on cameras (c,) whose estimated focal lengths have large relative standard deviations (c,)."""
    weak = np.flatnonzero(free & (sd > WEAK_FOCAL_SD))
    if not len(weak):
        return []
    worst = weak[np.argmax(sd[weak])]
    values = {"limit_ppm": WEAK_FOCAL_SD * 1e6, "worst": session.cameras[worst].id, "worst_ppm": sd[worst] * 1e6}
    return [Finding("weak-self-calibration", "warning", values, tuple(session.cameras[c].id for c in weak), kind=kind)]


def _few(e: Evidence) -> list[Finding]:
    """Findings on few placements, and on many points that few cameras see."""
    found, views = [], e.solved.network.views(e.adjusted.used)
    count = len(np.unique(e.features.placement[e.features.placement < len(e.session.placements)]))
    if count < FEW_PLACEMENTS:
        known = locked(e) or e.solution.scale.source == "ball"  # the other cameras, or the ball's shape, carry the rest
        found.append(Finding("few-placements", "info" if known else "warning", {"placements": count}))
    share = float((views == 2).sum() / max((views >= 2).sum(), 1))
    if share > MANY_TWO_VIEW:
        found.append(Finding("two-view-points", "warning", {"percent": 100 * share}))
    return found


def image_coverage(observations: Observations, used: BoolArray, session: Session) -> FloatArray:
    """Share (c,) of a 10 x 10 grid of each camera's image that contains used observations."""
    return _seen_cells(observations, used, session).mean(axis=(1, 2))


def _seen_cells(observations: Observations, used: BoolArray, session: Session) -> BoolArray:
    size = np.array([camera.image_size for camera in session.cameras], dtype=float)[observations.camera]
    cell = np.clip((observations.uv + 0.5) / size * COVERAGE_CELLS, 0, COVERAGE_CELLS - 1e-9).astype(int)
    seen = np.zeros((len(session.cameras), COVERAGE_CELLS, COVERAGE_CELLS), dtype=bool)
    seen[observations.camera[used], cell[used, 1], cell[used, 0]] = True
    return seen


def _coverage(e: Evidence) -> list[Finding]:
    seen, group = _seen_cells(e.observations, e.used, e.session), e.solved.network.group
    # cameras that share intrinsics see the lens for each other, as a camera before and after it moved does
    coverage = np.array([seen[group == g].any(axis=0).mean() for g in group])
    coverage[[camera.earlier_pose_of is not None for camera in e.session.cameras]] = 1.0
    return little_coverage(e.session, e.placed, coverage, "ball")


def little_coverage(session: Session, placed: BoolArray, coverage: FloatArray, kind: str) -> list[Finding]:
    """The finding on cameras (c,) of whose images used observations cover a small share (c,)."""
    little = np.flatnonzero(placed & (coverage < LITTLE_COVERAGE))
    if not len(little):
        return []
    worst = little[np.argmin(coverage[little])]
    least, percent = session.cameras[worst].id, 100 * coverage[worst]
    values = {"limit_percent": 100 * LITTLE_COVERAGE, "least": least, "percent": percent}
    return [Finding("little-coverage", "warning", values, tuple(session.cameras[c].id for c in little), kind=kind)]


def _outliers(e: Evidence) -> list[Finding]:
    out, total, many = outlier_share(e)
    count = int(out.sum())
    if not count:
        return []
    by_camera = np.bincount(e.observations.camera[out], minlength=len(e.camera_ids))
    most = int(np.argmax(by_camera))
    values = {"out": count, "observations": total, "percent": 100 * count / total, "most": by_camera[most]}
    return [outliers(values, many, e.camera_ids[most])]


def outliers(values: dict[str, Any], many: bool, camera: str) -> Finding:
    """The finding on observations that were left out, `many` or a few; `camera` had most."""
    if many:
        values = values | {"limit_percent": 100 * MANY_OUTLIERS}
        return Finding("outliers-removed", "warning", values, (camera,), kind="many")
    return Finding("outliers-removed", "info", values, (camera,))


def _scale(e: Evidence) -> list[Finding]:
    scale, found = e.solution.scale, e.solution.found
    if scale.source == "none":
        if e.session.scale is not None and e.session.scale.kind == "none":
            return [Finding("no-scale", "info", kind="chosen")]
        asked = e.session.scale is not None
        return [Finding("no-scale", "error", kind="asked") if asked else Finding("no-scale", "warning", kind="unnamed")]
    if scale.relative_uncertainty is None:
        return [Finding("scale-uncertainty", "info", kind="unknown")]
    values = {"mm": scale.relative_uncertainty * STATED_LENGTH_MM, "length_mm": STATED_LENGTH_MM}
    if scale.source != "target_spacing":
        odd = [] if found is None or found.odd is None else [found.odd.finding]
        return [*odd, Finding("scale-uncertainty", "info", values, kind="ball" if scale.source == "ball" else "bar")]
    stated = e.session.scale
    if stated is not None and stated.expanded_uncertainty_mm is None:
        return [Finding("print-unmeasured", "warning", values | {"percent": 100 * stated.print_sd})]
    scatter = 0.0 if found is None else found.scatter
    return [Finding("scale-uncertainty", "info", values | {"scatter_ppm": scatter * 1e6}, kind="spacing")]
