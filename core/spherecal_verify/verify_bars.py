"""Verification of a calibrated rig with reference bars, [Tao21] (21)."""

from collections import defaultdict
from dataclasses import dataclass, field, replace
from datetime import date

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.threads import on_one_blas_thread
from spherecal.data.assumed import assumed_of_bars
from spherecal.data.findings import Finding
from spherecal.data.observations import Features, Observations, find_features
from spherecal.data.rig import Rig
from spherecal.data.rig_camera import posed
from spherecal.data.session import Bar, BarLength, BarPose, Session
from spherecal.data.verdict_words import care_phrases
from spherecal.scale.bar_temperature import reference_length
from spherecal_verify.agreement import decide, mean_uncertainty
from spherecal_verify.budget import length_budgets
from spherecal_verify.consistency import examine_cameras, noise_alone
from spherecal_verify.departures import TITLE, Procedure, departures, volume_box
from spherecal_verify.doubts import (
    DOUBTS,
    bar_doubts,
    camera_doubts,
    certificate_doubts,
    contradicted,
    doubtful_lengths,
    failures,
    temperature_doubts,
)
from spherecal_verify.limit import LengthLimit, judge_against, with_doubts
from spherecal_verify.marks import MarkFinder, MarkPlace
from spherecal_verify.outlying_views import Views, triangulate_checked
from spherecal_verify.participation import (
    cameras_in_rig,
    lens_corrected,
    many_outlying,
    participation,
    participation_doubts,
)
from spherecal_verify.uncertainty import (
    PointErrors,
    camera_gradient,
    focal_sigmas,
    length_budget,
    length_by_points,
    length_statistics,
    overall_statistics,
    point_errors,
)
from spherecal_verify.verification import MeasuredLength, Verification

STAGE = "verification"


@dataclass(frozen=True)
class VerifySettings:
    """Limit of errors (None: their uncertainty alone), day of certificates (None: today), volume's corners (3,) mm."""

    limit: LengthLimit | None = None
    today: date | None = None
    corners_mm: tuple[FloatArray, FloatArray] | None = None


@on_one_blas_thread
def verify(
    session: Session, rig: Rig, context: Context | None = None, settings: VerifySettings | None = None
) -> Verification:
    """Measure every certified length of the check bars in every pose, and judge the errors (docs/verification.md)."""
    context, settings = context or Context(), settings or VerifySettings()
    context.report(STAGE, 0.0, Phrase("triangulating"))
    findings = _Findings()
    _check_bars(session, rig, findings)
    bars = {bar.id: bar for bar in session.bars if bar.role == "check"}
    for finding in assumed_of_bars(list(bars.values())):
        findings.add(finding)
    observations, camera = _observations_of(bars, session, rig, findings)
    features = find_features(observations)
    views, expected_noise = views_of(observations, features, camera, rig)
    checked = triangulate_checked(views, expected_noise)
    consistency = examine_cameras(views, rig, expected_noise)  # of all views: those left out below show a move too
    cameras = participation(checked, rig)
    if wrong := [i for i, one in enumerate(cameras) if one.state == "rejected"]:  # a single view would spoil the others
        stays = ~np.isin(camera, wrong)
        observations, camera = observations.select(stays), camera[stays]
        features = find_features(observations)
        views, expected_noise = views_of(observations, features, camera, rig)
        checked = triangulate_checked(views, expected_noise)
        rest = participation(checked, rig)
        cameras = tuple(one if one.state == "rejected" else again for one, again in zip(cameras, rest, strict=True))
    finder = MarkFinder(observations, features, checked, session.target_set)
    _report_views(finder, many_outlying(cameras), findings)
    _report_uncertainty(rig, findings)
    errors = point_errors(replace(checked, noise=noise_alone(checked, rig)), rig)
    measured: list[MeasuredLength] = []
    poses = [pose for pose in session.bar_poses if pose.bar in bars]
    for done, pose in enumerate(poses):
        context.report(STAGE, done / len(poses), pose.id)
        measured += _measure_pose(pose, bars[pose.bar], finder, errors, rig, findings)
    context.report(STAGE, 1.0)
    by_length: dict[tuple[str, str, str], list[MeasuredLength]] = defaultdict(list)
    for m in measured:
        by_length[m.key].append(m)
    moved = {one.id for one in consistency.moved}
    doubts = [
        *certificate_doubts(list(bars.values()), settings.today or date.today()),
        *temperature_doubts(poses, bars),
        *bar_doubts([m for m in measured if m.certified], bars),
        *camera_doubts(consistency),
        *(participation_doubts([one for one in cameras if one.id not in moved]) if poses else []),
    ]
    for finding in doubts:
        findings.add(finding)
    scale, comparable = rig.scale.relative_uncertainty or 0.0, rig.scale.source != "none"
    decision = decide(measured, bars, errors, scale, comparable)
    together = mean_uncertainty(measured, bars, errors, scale) if comparable else None
    share = min(1.0, expected_noise / max(errors.checked.noise, 1e-9))
    procedure = _procedure(measured, bars, rig, share, findings.all(), settings)
    for finding in failures(measured, decision, procedure.acceptance):
        findings.add(finding)
    decision = contradicted(decision, findings.all())
    return Verification(
        measured=tuple(measured),
        lengths=tuple(length_statistics(group, errors) for group in by_length.values()),
        overall=replace(overall_statistics(measured), expanded_uncertainty_mm=together),
        decision=decision,
        findings=findings.all(),
        procedure=procedure,
        consistency=consistency,
        cameras=cameras,
    )


def _procedure(
    measured: list[MeasuredLength],
    bars: dict[str, Bar],
    rig: Rig,
    noise_share: float,
    findings: tuple[Finding, ...],
    settings: VerifySettings,
) -> Procedure:
    """The budgets, the decision against the limit, and the departures from the guideline."""
    budgets = length_budgets(measured, bars, noise_share)
    acceptance = None
    doubts = tuple(dict.fromkeys(f.code for f in findings if f.code in DOUBTS and f.severity != "info"))
    if settings.limit is not None:
        judged = [m for m in measured if m.certified]
        acceptance = judge_against(settings.limit, judged, budgets, rig.scale.source != "none")
        acceptance = with_doubts(acceptance, doubts, doubtful_lengths(measured))
    box = None
    if rig.length_map is not None or settings.corners_mm is not None:
        box = volume_box(rig, settings.corners_mm or (np.zeros(3), np.zeros(3)))
    volume_mm = None if box is None else (tuple((2 * box.half).tolist()), box.diagonal_mm)
    departed = departures(measured, bars, box, settings.limit)
    return Procedure(TITLE, departed, budgets, acceptance, tuple(bars.values()), volume_mm)


@dataclass
class _Findings:
    """Collects findings; those that say the same are joined with all their places."""

    _same: dict[tuple[str, ...], Finding] = field(default_factory=dict)

    def add(self, finding: Finding) -> None:
        key = (finding.severity, finding.code, finding.message, finding.hint)
        there = self._same.setdefault(key, finding)
        self._same[key] = replace(there, where=tuple(dict.fromkeys((*there.where, *finding.where))))

    def all(self) -> tuple[Finding, ...]:
        return tuple(self._same.values())


def _check_bars(session: Session, rig: Rig, findings: _Findings) -> None:
    """Findings about the input, before anything is measured."""
    roles = {bar.id: bar.role for bar in session.bars}
    if not any(roles[pose.bar] == "check" for pose in session.bar_poses):
        findings.add(Finding("no-check-bars", "warning"))
    if scale_poses := [pose.id for pose in session.bar_poses if roles[pose.bar] == "scale"]:
        findings.add(Finding("scale-bar-left-out", "info", where=tuple(scale_poses)))
    if not rig.quality.valid:
        findings.add(Finding("rig-not-valid", "error", kind="verify"))
    elif rig.quality.affected:
        findings.add(Finding("rig-with-care", "info", {"care": care_phrases(rig.quality.affected)}))
    if rig.scale.source == "none":
        findings.add(Finding("no-scale", "error", kind="rig"))
    elif rig.scale.relative_uncertainty is None:
        findings.add(Finding("scale-uncertainty-unknown", "warning"))


def _observations_of(
    bars: dict[str, Bar], session: Session, rig: Rig, findings: _Findings
) -> tuple[Observations, IntArray]:
    """The observations of the bars' marks by the rig's cameras, and the index (n,) of each one's camera in the rig."""
    o = session.observations
    if o is None:
        raise InputError(Phrase("error-nothing-to-verify", {"folder": session.where}))
    in_rig = cameras_in_rig(session, o, rig, Phrase("same-settings"))
    shown = [(o.placements.index(pose.id), bars[pose.bar]) for pose in session.bar_poses if pose.bar in bars]
    requested = np.zeros(len(o), dtype=bool)
    for pose, bar in shown:
        requested |= (o.placement == pose) & np.isin(o.target, [mark.target for mark in bar.marks.values()])
    missing = np.unique(o.camera[requested & (in_rig[o.camera] < 0)])
    if len(missing):
        findings.add(Finding("camera-not-in-rig", "info", where=tuple(o.cameras[i] for i in missing)))
    kept = o.select(requested & (in_rig[o.camera] >= 0))
    return kept, in_rig[kept.camera]


def views_of(observations: Observations, features: Features, camera: IntArray, rig: Rig) -> tuple[Views, float]:
    """The observations as views of the rig's cameras (n,), and the noise to expect in units of their sigma."""
    sigma, expected_noise = observations.sigma, 1.0
    if sigma is None:  # weights are 1/px^2, and the rig's sigma0, if it has one, says what noise to expect
        sigma, expected_noise = np.ones((len(observations), 2)), rig.quality.sigma0 or 1.0
    uv, sigma = lens_corrected(rig.cameras, camera, observations.uv, sigma, expected_noise)
    views = Views(features.of_observation, camera, uv, sigma, len(features), posed(rig.cameras))
    return views, expected_noise


def _report_uncertainty(rig: Rig, findings: _Findings) -> None:
    """Findings where the cameras' uncertainty is not or only partly known."""
    if rig.covariance is not None:
        return
    unknown = [c.id for c in rig.cameras if c.sigma is None or np.isnan(c.sigma.intrinsics[:2]).any()]
    if unknown:
        findings.add(Finding("camera-uncertainty-unknown", "warning", where=tuple(unknown)))
    elif focal_sigmas(rig).any():
        findings.add(Finding("camera-covariance-missing", "info"))


def _report_views(finder: MarkFinder, many: bool, findings: _Findings) -> None:
    """Findings about views left out, `many` or a few, and points that could not be measured."""
    o, checked = finder.observations, finder.checked
    contradicting = checked.contradicting[finder.features.of_observation]
    left_out = ~checked.kept & ~contradicting & np.isfinite(checked.points.residual[:, 0])
    if left_out.any():
        places = [f"{o.placements[o.placement[i]]}/{o.cameras[o.camera[i]]}" for i in np.flatnonzero(left_out)]
        severity = "warning" if many else "info"
        findings.add(Finding("outlying-views", severity, {"views": len(places)}, tuple(dict.fromkeys(places))))
    if contradicting.any():
        given_up = np.flatnonzero(checked.contradicting)
        places = [o.placements[finder.features.placement[i]] for i in given_up]
        values = {"points": len(given_up)}
        findings.add(Finding("contradicting-views", "warning", values, tuple(dict.fromkeys(places))))


def _measure_pose(
    pose: BarPose, bar: Bar, finder: MarkFinder, errors: PointErrors, rig: Rig, findings: _Findings
) -> list[MeasuredLength]:
    """The lengths of a bar in one pose; those that cannot be measured become findings."""
    if pose.temperature_c is None:
        findings.add(Finding("no-temperature", "warning", where=(pose.id,)))
    index = finder.observations.placements.index(pose.id)
    used = {name for length in bar.lengths for name in (length.from_mark, length.to_mark)}
    places = {name: finder.find(index, mark) for name, mark in bar.marks.items() if name in used}
    measured = []
    for certified in bar.lengths:
        ends = []
        for name in (certified.from_mark, certified.to_mark):
            place = places[name]
            if isinstance(place, Phrase):
                values = {"mark": name, "bar": bar.id, "why": place}
                findings.add(Finding("mark-not-found", "warning", values, (pose.id,)))
            else:
                ends.append(place)
        if len(ends) == 2:
            measured.append(_measure(pose, bar, certified, (ends[0], ends[1]), errors, rig))
    return measured


def _measure(
    pose: BarPose, bar: Bar, certified: BarLength, ends: tuple[MarkPlace, MarkPlace], errors: PointErrors, rig: Rig
) -> MeasuredLength:
    scale_relative = rig.scale.relative_uncertainty or 0.0
    features, by_point = length_by_points(ends)
    return MeasuredLength(
        bar.id,
        pose.id,
        certified.from_mark,
        certified.to_mark,
        length_mm=float(np.linalg.norm(ends[1].place_mm - ends[0].place_mm)),
        reference_mm=reference_length(certified, bar, pose.temperature_c),
        budget=length_budget(ends, errors, scale_relative, certified, bar, pose.temperature_c),
        views=min(end.views for end in ends),
        temperature_c=pose.temperature_c,
        ends_mm=np.stack([end.place_mm for end in ends]),
        by_cameras=camera_gradient(features, by_point, errors),
        certified=certified.certified,
        features=features,
        by_point=by_point,
    )
