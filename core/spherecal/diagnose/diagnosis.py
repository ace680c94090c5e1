"""All findings on a solved network beside those of its own adjustment, in one list."""

from dataclasses import replace

from spherecal.base.memory import release_freed
from spherecal.data.findings import Finding
from spherecal.diagnose.anomalies import find_anomalies, focus_change
from spherecal.diagnose.ball_changes import changed_shape, contradicting_placements
from spherecal.diagnose.camera_findings import (
    fixed_focal_lengths,
    misfitting_lenses,
    noisy_cameras,
    scattering_poses,
    wrong_focal_lengths,
)
from spherecal.diagnose.evidence import STAGE, Evidence
from spherecal.diagnose.flattening import EXPLAINS, flattened_ball
from spherecal.diagnose.geometry import weak_links, weak_places
from spherecal.diagnose.image_findings import wrong_images
from spherecal.diagnose.influence import dependent_parts
from spherecal.diagnose.left_out import edge_findings, wrong_targets
from spherecal.diagnose.motion_findings import mixed_up_images, motion_findings, moved_cameras, unexplained_images
from spherecal.diagnose.scale_findings import scale_conflict, stretched_print
from spherecal.diagnose.sticker_size import sticker_findings
from spherecal.diagnose.swapped_cameras import swapped_cameras, swapped_images

# A focal length that is fixed 0.3 % wrong explains with one unknown 0.87 of what a moving ball does with 18.
MOST_OF_IT = 0.8
# What these do to the whole network may be taken for a strain.
_BEFORE = ("camera-moved", "cameras-moved", "camera-unsteady", "ball-moved", "wrong-placement", "image-contradicts",
           "cameras-swapped", "placements-contradict", "mirrored", "focus-changed")  # fmt: skip


def diagnose(e: Evidence) -> list[Finding]:
    """Findings on cameras, placements, targets and geometry; those that explain others come first and suppress them."""
    e.context.report(STAGE, 0.0)
    release_freed()
    found = [*_faults(e), *dependent_parts(e)]
    growth = max((f.values["lengths"] for f in found if f.code == "parts-disagree"), default=1.0)
    strained = [] if any(f.code in _BEFORE for f in found) else flattened_ball(e, growth)
    if any(f.values["percent"] > 100 * EXPLAINS for f in strained):  # that is what the shape shows
        found = [f for f in found if f.code not in ("ball-shape-changed", "rigid-form-misfit")]
    found += strained
    e.context.report(STAGE, 1.0)
    return [*found, *weak_places(e), *weak_links(e), *scale_conflict(e), *stretched_print(e), *sticker_findings(e)]


def _faults(e: Evidence) -> list[Finding]:
    wrong = wrong_images(e)
    failed = e.solution.covariance is None or not e.adjusted.minimum.converged or not e.placed.all()
    if wrong or e.choice.beyond or failed:  # the network may be distorted as a whole: its predictions say little
        swapped = swapped_images(e)
        named = {(image.camera, image.placement) for image in swapped}
        wrong = swapped + [image for image in wrong if (image.camera, image.placement) not in named]
    found = [*mixed_up_images(e, wrong), *swapped_cameras(e)]
    fixed = fixed_focal_lengths(e)
    if any(image.kind in ("other-camera", "other-placement") for image in wrong):
        # the rest of the network may be bent by them: what it shows is judged once they are where they belong
        return [*found, *wrong_focal_lengths(e)]
    anomalies = find_anomalies(e, bool(wrong))
    release_freed()
    # what looks like a move may be a focal length that is fixed at a wrong value, if that explains more
    anomalies = replace(anomalies, moves=tuple(m for m in anomalies.moves if m.statistic > fixed[m.camera]))
    motion = anomalies.group_motion
    if motion is not None and MOST_OF_IT * motion.statistic <= fixed.max(initial=0.0):
        anomalies = replace(anomalies, group_motion=None, explained=False)
    refocused = [] if anomalies.group_motion is None else focus_change(e, anomalies.group_motion)
    if refocused:
        anomalies = replace(anomalies, group_motion=None)
    if anomalies.explained:  # so are images and placements that seem to contradict the rest
        wrong = []
    e.context.report(STAGE, 0.7)
    spoilt = contradicting_placements(e, wrong)
    names = {name for finding in spoilt for name in finding.where}
    wrong = [image for image in wrong if e.observations.placements[image.placement] not in names]
    moves = motion_findings(e, anomalies, wrong)
    moved = moved_cameras(e, moves)
    found += [*refocused, *moves, *unexplained_images(e, wrong, moved), *spoilt]
    if not spoilt:
        found += [] if anomalies.explained else changed_shape(e, anomalies.in_shape)
        found += [*misfitting_lenses(e, anomalies, moved), *edge_findings(e, moved)]
        found += wrong_targets(e, moved)
    e.context.report(STAGE, 0.9)
    found += scattering_poses(e, anomalies)
    focal = [finding for finding in wrong_focal_lengths(e) if not moved & set(finding.where)]
    return [*found, *focal, *noisy_cameras(e, moved)]
