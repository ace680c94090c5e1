"""What a calibration says about itself: findings with code, plain words, cause and remedy."""

from collections import Counter
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from spherecal.adjust.problem import POSE
from spherecal.arrays import BoolArray, FloatArray, IntArray
from spherecal.diagnose.diagnosis import diagnose
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.soundness import locked, outlier_share, unsound
from spherecal.errors import StoppedHere
from spherecal.findings import Finding, counted
from spherecal.network.graph import MIN_COMMON
from spherecal.network.observations import Observations
from spherecal.session.model import Session
from spherecal.verdict import ruled

# Self-calibration below this is what four spread placements give on rigs A and B (420 and 380 ppm) with a margin; one
# placement gives 7000.
WEAK_FOCAL_SD = 1000e-6
FEW_PLACEMENTS = 3
MANY_TWO_VIEW = 0.5
COVERAGE_CELLS, LITTLE_COVERAGE = 10, 0.6
# Stated for a length of this size, as the user thinks in millimetres on his bar.
STATED_LENGTH_MM = 500.0

# What printers err by in size, all stickers alike.
PRINT_ERROR_PERCENT = (0.1, 0.5)

STOPPED = Finding(
    "error", "stopped-early", "The computation was stopped: these are the numbers it had come to.",
    "Calibrate again and let it come to its end.",
)  # fmt: skip


def judge(evidence: Evidence) -> tuple[Finding, ...]:
    """All findings on a calibration with the severities of the table in verdict.py, errors first."""
    ambiguous = evidence.ambiguous
    # a camera's pose before it was knocked is not part of the rig
    settled = evidence.placed | ambiguous | evidence.is_earlier_pose
    found = [
        *unlinked(evidence.observations, evidence.local.counts, evidence.local.triples, settled),
        *_ambiguous_poses(evidence, ambiguous),
        *_convergence(evidence),
        *_form(evidence),
        *_geometry(evidence),
        *_unconfirmed_poses(evidence),
        *_held_intrinsics(evidence),
        *_weak_self_calibration(evidence),
        *_placements(evidence),
        *_two_view_share(evidence),
        *_coverage(evidence),
        *_outliers(evidence),
        *_scale(evidence),
        *_faults(evidence),
    ]
    if locked(evidence):  # what the locked cameras err by looks like intrinsics that do not fit
        found = [replace(f, severity="info") if f.code == "fixed-intrinsics-contradicted" else f for f in found]
    return ruled([*found, *unsound(evidence, found)])


def _faults(e: Evidence) -> list[Finding]:
    """What the diagnosis finds; that it was stopped, where it was."""
    try:
        return diagnose(replace(e, context=e.context.holding()))
    except StoppedHere:
        if e.context.holds_result:  # the caller's result is further on
            raise
        return [STOPPED]


def unlinked(observations: Observations, counts: IntArray, triples: list, placed: BoolArray) -> list[Finding]:
    """Cameras that could not be linked to the rest, group by group, with the common features that were missing."""
    ids = np.array(observations.cameras)
    if placed.all():
        return []
    groups = _groups(counts, triples, placed)
    lines = []
    for group in groups[1:]:
        outside = np.setdiff1d(np.arange(len(ids)), group)
        best = counts[np.ix_(group, outside)]
        i, j = np.unravel_index(int(np.argmax(best)), best.shape)
        lines.append(
            f"{' '.join(ids[group])}: at most {best[i, j]} points in common with another group "
            f"({ids[group[i]]} and {ids[outside[j]]})"
        )
    names = " | ".join(" ".join(ids[group]) for group in groups)
    message = f"{len(groups)} groups of cameras cannot be linked: {names}. " + "; ".join(lines) + "."
    return [
        Finding(
            "error",
            "cameras-unlinked",
            message if lines else f"None of the cameras could be placed: {names}.",
            f"Three cameras are linked by at least {MIN_COMMON} points that all of them see. Put the ball where "
            "cameras of both groups see it, or check that these cameras recorded images.",
            tuple(str(name) for group in groups for name in ids[group]),
        )
    ]


def _groups(counts: IntArray, triples: list, placed: BoolArray) -> list[IntArray]:
    """Groups of cameras that hang together: the placed ones first, then the others by solved triples."""
    linked = np.zeros_like(counts)
    for triple in triples:
        linked[np.ix_(triple.cameras, triple.cameras)] = 1
    linked[np.ix_(placed, placed)] = 1
    linked[np.ix_(placed, ~placed)] = 0
    linked[np.ix_(~placed, placed)] = 0
    label = connected_components(csr_array(linked), directed=False)[1]
    groups = [np.flatnonzero(label == value) for value in dict.fromkeys(label)]
    return sorted(groups, key=lambda group: (-int(placed[group].any()), -len(group), int(group[0])))


def _ambiguous_poses(e: Evidence, ambiguous: BoolArray) -> list[Finding]:
    """The finding on cameras whose points allow two poses."""
    ids = tuple(e.camera_ids[c] for c in np.flatnonzero(ambiguous))
    if not ids:
        return []
    return [
        Finding(
            "error", "pose-ambiguous",
            f"The points that {', '.join(ids)} see allow two different poses that fit equally well: "
            f"{'they are' if len(ids) > 1 else 'it is'} left out.",
            "Few points, or points near one plane and far away, do that. Show the ball nearer to "
            f"{'these cameras' if len(ids) > 1 else 'this camera'}, or at more places in its image.", ids,
        )
    ]  # fmt: skip


def _convergence(e: Evidence) -> list[Finding]:
    if e.adjusted.minimum.converged:
        return []
    return [
        Finding(
            "error", "not-converged",
            f"The bundle adjustment did not converge within {e.adjusted.minimum.iterations} steps.",
            "The start was too far off or the geometry too weak: check the focal lengths and add placements.",
        )
    ]  # fmt: skip


def _form(e: Evidence) -> list[Finding]:
    choice = e.choice
    changed = choice.form != "rigid" and choice.ratio is not None and not choice.asked
    message = f"Form of the network: {choice.form}; {choice.reason}."
    hint = ""
    if choice.form == "free":
        hint = "Lengths are several times surer where the same stiff ball is seen turned by 30 to 60 degrees each time."
    return [Finding("warning" if changed else "info", f"form-{choice.form}", message, hint)]


def _geometry(e: Evidence) -> list[Finding]:
    found = []
    points, state = e.solution.state.points, e.solution.state
    if e.solution.covariance is None:
        found.append(
            Finding(
                "error", "degenerate-geometry",
                "The observations do not determine the network: its normal equations are singular.",
                "Use placements spread over the volume, in different depths, and seen by three or more cameras.",
            )
        )  # fmt: skip
    used = e.used
    depth = np.einsum("nj,nj->n", state.rotation[e.observations.camera, 2], points[e.features.of_observation])
    behind = used & (depth + state.translation[e.observations.camera, 2] <= 0)
    if behind.any():
        cameras = np.unique(e.observations.camera[behind])
        found.append(
            Finding(
                "error", "behind-camera",
                f"{behind.sum()} observed points lie behind their cameras: the solution is not a real one.",
                "Cameras or targets may be mixed up; check serial numbers and image folders.",
                tuple(e.camera_ids[c] for c in cameras),
            )
        )  # fmt: skip
    if _mirrored(e):
        found.append(
            Finding(
                "error", "mirrored",
                "The reconstructed targets are mirror images of the printed ones.",
                "The images are mirrored (a flip in the camera settings) or the target set is the wrong one.",
            )
        )  # fmt: skip
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
    votes = 0
    for rows in np.split(known, np.flatnonzero(new_target) + 1):  # features are sorted by placement and target
        layout = targets.layouts.get(int(e.features.target[rows[0]]), {}) if len(rows) else {}
        dots = [(row, layout[name]) for row in rows if (name := e.observations.points[e.features.point[row]]) in layout]
        if len(dots) < 4:
            continue
        at, flat = points[[row for row, _ in dots]], np.array([place for _, place in dots])
        axes = np.linalg.lstsq(flat - flat.mean(axis=0), at - at.mean(axis=0), rcond=None)[0]
        into_ball = np.cross(axes[0], axes[1])  # x right, y down: z away from the viewer
        votes += 1 if into_ball @ (at.mean(axis=0) - centres[a_view[dots[0][0]]]) > 0 else -1
    return votes < 0


def unconfirmed_poses(e: Evidence) -> list[tuple[int, int]]:
    """Split cameras (indices) whose pose rests on one image alone, each with the index of its earlier pose."""
    seen = (e.image_counts(e.used) > 0).sum(axis=0)
    ids = list(e.camera_ids)
    pairs = [
        (ids.index(camera.earlier_pose_of), k)
        for k, camera in enumerate(e.session.cameras)
        if camera.earlier_pose_of is not None and e.placed[k]
    ]
    latest = dict(pairs)  # of several former poses the last is that before the image
    return [(c, k) for c, k in latest.items() if e.placed[c] and seen[c] == 1]


def _unconfirmed_poses(e: Evidence) -> list[Finding]:
    found = []
    for c, _ in unconfirmed_poses(e):
        name = e.camera_ids[c]
        place = e.observations.placements[int(np.flatnonzero(e.image_counts(e.used)[:, c])[0])]
        found.append(
            Finding(
                "warning", "pose-unconfirmed",
                f"The pose of camera {name} rests on its image at {place} alone, and differs from the pose before. "
                "Whether it stayed there is not known from the recording; its uncertainty covers both.",
                f"Verify the rig with bars that {name} sees. If it is wrong, calibrate with --leave-out "
                f"{name}@{place}.",
                (name,),
            )
        )  # fmt: skip
    return found + _not_seen_since(e)


def _not_seen_since(e: Evidence) -> list[Finding]:
    """Cameras without an image since several others moved at once: one part of the frame may carry all of them.

    A beam of three cameras bent by 2 mm after the last image of one of them; that one was 83 U off.
    """
    images = e.image_counts(e.used) > 0
    seen = np.flatnonzero(~e.is_earlier_pose & e.placed & images.any(axis=0))
    split = {camera.earlier_pose_of for camera in e.session.cameras}
    since = {k: int(np.argmax(images[:, k])) for k in seen if e.camera_ids[k] in split}
    together = [t for t, count in Counter(since.values()).items() if count > 1]
    if not together:
        return []
    first = min(together)
    last = len(images) - 1 - np.argmax(images[::-1], axis=0)
    unseen = [e.camera_ids[k] for k in seen if last[k] < first]
    if not unseen:
        return []
    others = ", ".join(e.camera_ids[k] for k, t in since.items() if t == first)
    return [
        Finding(
            "warning", "pose-unconfirmed",
            f"{counted(len(unseen), 'camera')} ({', '.join(unseen)}) did not see the ball again after {others} moved "
            f"together before {e.observations.placements[first]}. Whether the same part of the frame carried them "
            "along the recording cannot tell.",
            f"Verify the rig with bars that {', '.join(unseen)} see, or record one more placement that they see.",
            tuple(unseen),
        )
    ]  # fmt: skip


def _held_intrinsics(e: Evidence) -> list[Finding]:
    ids = tuple(e.camera_ids[c] for c in np.flatnonzero(e.solved.held & e.placed))
    if not ids:
        return []
    return [
        Finding(
            "warning", "intrinsics-held",
            f"The data cannot carry the intrinsics of {', '.join(ids)}: they are held near their nominal values.",
            "Show the ball to these cameras in more places of their image, or give them calibrated intrinsics.", ids,
        )
    ]  # fmt: skip


def _weak_self_calibration(e: Evidence) -> list[Finding]:
    cofactors, columns = e.solution.covariance, e.adjusted.problem.intrinsic_columns
    if cofactors is None or not len(columns) or columns[0] != 0:
        return []
    sd = np.sqrt(e.adjusted.variance * cofactors.cameras[:, POSE, POSE]) / e.solution.state.intrinsics[:, 0]
    free = e.adjusted.problem.free_intrinsics[:, 0] & e.placed & ~e.solved.held
    weak = np.flatnonzero(free & (sd > WEAK_FOCAL_SD))
    if not len(weak):
        return []
    worst = weak[np.argmax(sd[weak])]
    return [
        Finding(
            "warning", "weak-self-calibration",
            f"The focal lengths of {counted(len(weak), 'camera')} are known to no better than "
            f"{WEAK_FOCAL_SD * 1e6:.0f} ppm (worst: {e.camera_ids[worst]}, {sd[worst] * 1e6:.0f} ppm).",
            "Add placements in different depths, or fix calibrated intrinsics.",
            tuple(e.camera_ids[c] for c in weak),
        )
    ]  # fmt: skip


def _placements(e: Evidence) -> list[Finding]:
    count = len(np.unique(e.features.placement[e.features.placement < len(e.session.placements)]))
    if count >= FEW_PLACEMENTS:
        return []
    known = locked(e) or e.solution.scale.source == "ball"  # the other cameras, or the ball's shape, carry the rest
    return [
        Finding(
            "info" if known else "warning", "few-placements",
            f"Only {count} placement{'s' if count != 1 else ''} of the ball: lengths will be worse than with four.",
            "Record four placements spread over the volume.",
        )
    ]  # fmt: skip


def _two_view_share(e: Evidence) -> list[Finding]:
    views = e.solved.point_views
    share = float((views == 2).sum() / max((views >= 2).sum(), 1))
    if share <= MANY_TWO_VIEW:
        return []
    return [
        Finding(
            "warning", "two-view-points",
            f"{100 * share:.0f} % of the points are seen by two cameras only: their errors in depth stay hidden.",
            "Turn or move the ball so that more points are seen by three cameras.",
        )
    ]  # fmt: skip


def image_coverage(observations: Observations, used: BoolArray, session: Session) -> FloatArray:
    """Share of a 10 x 10 grid of each camera's image that holds used observations, (c,)."""
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
    little = np.flatnonzero(e.placed & (coverage < LITTLE_COVERAGE))
    if not len(little):
        return []
    worst = little[np.argmin(coverage[little])]
    return [
        Finding(
            "warning", "little-coverage",
            f"{counted(len(little), 'camera')} saw targets in less than {100 * LITTLE_COVERAGE:.0f} % of their image "
            f"(least: {e.camera_ids[worst]}, {100 * coverage[worst]:.0f} %): distortion is extrapolated in the rest.",
            "Put the ball where these images are still empty.", tuple(e.camera_ids[c] for c in little),
        )
    ]  # fmt: skip


def _outliers(e: Evidence) -> list[Finding]:
    out, total, many = outlier_share(e)
    count = int(out.sum())
    if not count:
        return []
    by_camera = np.bincount(e.observations.camera[out], minlength=len(e.camera_ids))
    most = int(np.argmax(by_camera))
    return [
        Finding(
            "warning" if many else "info", "outliers-removed",
            f"{count} of {total} observations ({100 * count / total:.1f} %) contradict the others and are left out "
            f"(most in {e.camera_ids[most]}: {by_camera[most]}).",
            "Some are normal: reflections, dirt, wrong codes. Look at this camera's images if there are many.",
            (e.camera_ids[most],),
        )
    ]  # fmt: skip


def _scale(e: Evidence) -> list[Finding]:
    scale = e.solution.scale
    if scale.source == "none":
        asked = e.session.scale is not None
        message = (
            "The scale asked for could not be measured: lengths are arbitrary." if asked
            else "The session names no scale: lengths are arbitrary."
        )  # fmt: skip
        hint = "Show the points or marks that give the scale to at least two cameras." if asked else (
            "Give a target spacing or a reference bar in session.json.")  # fmt: skip
        return [Finding("error" if asked else "warning", "no-scale", message, hint)]
    if scale.relative_uncertainty is None:
        message = "The scale is that of the rig's file; its uncertainty is not known."
        return [Finding("info", "scale-uncertainty", message, "Verify the rig with a reference bar.")]
    sources = {"target_spacing": "the target spacing", "ball": "the ball profile"}
    message = (
        f"The scale comes from {sources.get(scale.source, 'a reference bar')}; its "
        f"standard uncertainty is {scale.relative_uncertainty * STATED_LENGTH_MM:.3f} mm on {STATED_LENGTH_MM:.0f} mm"
    )
    if scale.source == "bar":
        return [Finding("info", "scale-uncertainty", message + ", certificate included.", "")]
    if scale.source == "ball":
        return [Finding("info", "scale-uncertainty", message + ", as that of its calibration.", "")]
    low, high = (1e-2 * share * STATED_LENGTH_MM for share in PRINT_ERROR_PERCENT)
    return [
        Finding(
            "info", "scale-uncertainty",
            f"{message} for perfect prints (scatter between stickers {e.solution.scatter * 1e6:.0f} ppm). What all "
            f"stickers of a print err by alike is not in it: {PRINT_ERROR_PERCENT[0]} to {PRINT_ERROR_PERCENT[1]} % is "
            f"common, {low:g} to {high:g} mm on {STATED_LENGTH_MM:.0f} mm.",
            "Measure the printed sheet, or give the scale by a reference bar.",
        )
    ]  # fmt: skip
