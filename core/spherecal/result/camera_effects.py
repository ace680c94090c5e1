"""Fields of lenses and motions of images as the result has them: tables, drift of cameras, uncertainties."""

from dataclasses import replace

import numpy as np

from spherecal.adjust.camera_effects import FIELD, MOTION, Corrections, Field
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.lens_field import left_unknown, lens_and_turns_in
from spherecal.adjust.parameter_layout import POSE
from spherecal.ball.fit import BallFit
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.data.findings import Finding, Findings
from spherecal.data.rig import ImageMotion
from spherecal.data.rig_camera import RigCamera
from spherecal.data.session import Session
from spherecal.geometry.field_table import FieldTable, table_nodes

# Where most cameras turn by more between their images, the ball moves between the exposures: no rig drifts or shakes so
# (0.02 mm, 25 urad in realistic recordings: 2 mdeg). A ball that rolled by 0.05 degrees looked like turns by 8 mdeg; a
# camera was 4.0 U off, and lengths were within U.
MOST_TURN_MDEG = 3.0


def lens_field(solved: BallFit, cofactors: Covariance | None, c: int, size: tuple[int, int]) -> FieldTable | None:
    """The field of a camera's lens as a table, with its standard uncertainty; None where it has none."""
    corrections = solved.network.corrections
    if corrections is None:
        return None
    fields = corrections.design.fields_of[c]
    if not any(corrections.coefficients[field.columns].any() for field in fields):
        return None
    pitch, nodes, shape = table_nodes(size)
    at, sd = corrections.field(c, nodes), None
    if cofactors is not None and (own := cofactors.of_effects) is not None:
        used = np.cumsum(corrections.variances[corrections.design.part] > 0) - 1
        known = [f for f in fields if corrections.variances[corrections.design.part[f.first]] > 0]
        columns = np.concatenate([used[f.columns] for f in known])
        values = np.concatenate([f.basis.at(nodes) for f in known], axis=2)
        square = np.einsum("nij,nij->n", values @ own[np.ix_(columns, columns)], values) / 2
        square = np.maximum(square, _beyond_points(solved, corrections, known, nodes))
        sd = np.sqrt(np.maximum(square * solved.adjusted.variance, 0.0)).reshape(shape)
    return FieldTable(pitch, np.zeros(2), at[:, 0].reshape(shape), at[:, 1].reshape(shape), sd)


def _beyond_points(solved: BallFit, corrections: Corrections, fields: list[Field], nodes: FloatArray) -> FloatArray:
    """Cofactors (n,) of fields at pixels (n,2) by how far these are from where points were seen."""
    problem, square = solved.adjusted.problem, np.zeros(len(nodes))
    for field in fields:
        own = np.isin(problem.camera, field.cameras)
        amplitude = corrections.variances[corrections.design.part[field.first]]
        noise = 1.0 / float(np.median(problem.weight[own]) * np.sqrt(amplitude))
        seen = solved.network.uv[solved.adjusted.rows[own]]
        square += amplitude * left_unknown(nodes, field.basis.size, seen, noise) ** 2
    return square


def not_of_fields(corrections: Corrections | None, cofactors: Covariance | None, count: int) -> FloatArray:
    """What share (c,) of a camera's pose variances is not that of fields which are not taken but not excluded.

    Only that share grows by what parts of the recording disagree by, since that is what such fields do: seed 1206 had
    14 mm on 500 when all grew, 6 without fields, and errors of 1.4. The largest share of the pose's six variances.
    """
    if cofactors is None or (corrections is not None and FIELD in corrections.evidence):
        return np.ones(count)
    known, whole = (np.einsum("cii->ci", one.cameras)[:, :POSE] for one in (cofactors.given_effects, cofactors))
    return np.clip(known / np.where(whole > 0, whole, 1.0), 0.0, 1.0).max(axis=1)


def turn_sds(corrections: Corrections | None, cameras: IntArray, variance: float) -> FloatArray:
    """The standard deviations (k,) in rad, about each axis, by which images of cameras turn; 0 where they do not."""
    if corrections is None:
        return np.zeros(len(cameras))
    turns = np.sqrt(corrections.variances[len(corrections.design.fields) + cameras] * variance)
    return np.where(corrections.moved_once[cameras], 0.0, turns)


def shared_with_fields(cameras: tuple[RigCamera, ...], uv: dict[str, FloatArray]) -> tuple[RigCamera, ...]:
    """Cameras with the uncertainty of pose and lens by what their fields do as lens or turn where points were seen.

    Over the whole image a field holds nothing that these could do, over a part of it it does. Another such choice moves
    pose and principal point, and no ray: with wide lenses cameras were turned by up to 5 mrad, 12 px, at a stated 0.8,
    and rays right to 0.01 mm (seed 1013). So lengths and the covariance are as certain as they were.

    `uv`: used image points (n,2) px of each camera by its id.
    """
    wider = []
    for camera in cameras:
        if camera.field is not None and (s := camera.sigma) is not None:
            seen = uv[camera.id]
            lens, turn = lens_and_turns_in(camera.field.at(seen), seen, camera.intrinsics, s.intrinsics > 0)
            degrees, intrinsics = np.hypot(s.rotation_deg, np.rad2deg(turn)), np.hypot(s.intrinsics, lens)
            wider.append(replace(camera, sigma=replace(s, rotation_deg=degrees, intrinsics=intrinsics)))
        else:
            wider.append(camera)
    return tuple(wider)


def image_motions(
    session: Session, placements: tuple[str, ...], corrections: Corrections | None
) -> tuple[ImageMotion, ...]:
    """How each image's camera is turned against its mean pose; () where no motions were applied."""
    if corrections is None or MOTION not in corrections.evidence or not corrections.turns.any():
        return ()
    design, turns = corrections.design, np.rad2deg(corrections.turns)
    each = zip(design.span_of_image.tolist(), design.camera_of_image.tolist(), turns, strict=True)
    return tuple(
        ImageMotion(name, session.cameras[c].id, turn, np.zeros(3))
        for span, c, turn in sorted(each, key=lambda one: one[:2])
        for name in placements[span * design.together : (span + 1) * design.together]
    )


def effects_findings(
    cameras: tuple[RigCamera, ...], motions: tuple[ImageMotion, ...], uv: dict[str, FloatArray]
) -> Findings:
    """What is said of fields and drift of which lenses and cameras; `uv`: used image points (n,2) px by camera."""
    found = []
    fields = {
        camera.id: float(np.sqrt((camera.field.at(uv[camera.id]) ** 2).mean()))
        for camera in cameras
        if camera.field is not None
    }
    if fields:
        worst = max(fields, key=lambda name: fields[name])
        values = {"cameras": len(fields), "worst": worst, "rms_px": fields[worst]}
        found.append(Finding("lens-field", "info", values, tuple(fields)))
    drifts = {camera.id: _drift(camera, motions) for camera in cameras}
    drifts = {name: drift for name, drift in drifts.items() if drift is not None}
    if drifts:
        order = sorted(drifts, key=lambda name: -drifts[name][1])
        degrees, px = drifts[order[0]]
        values = {
            "worst": order[0], "turn_mdeg": 1e3 * degrees, "shift_px": px,
            "median_mdeg": 1e3 * float(np.median([own for own, _ in drifts.values()])),
        }  # fmt: skip
        if len(drifts) > len(cameras) / 2 and values["median_mdeg"] > MOST_TURN_MDEG:
            found.append(Finding("camera-drifts", "warning", values, tuple(order), kind="most"))
        else:
            found.append(Finding("camera-drifts", "info", values, tuple(order)))
    return tuple(found)


def _drift(camera: RigCamera, motions: tuple[ImageMotion, ...]) -> tuple[float, float] | None:
    """How far a camera turns, rms over its images: in degrees, and in px half-way between the axis and the corners."""
    turns = np.array([motion.rotation_deg for motion in motions if motion.camera == camera.id])
    if not len(turns):
        return None
    across = np.array([camera.intrinsics[1], camera.intrinsics[0], np.hypot(*camera.image_size) / 4])
    degrees, px = (float(np.sqrt((turns**2 * by**2).sum(axis=1).mean())) for by in (np.ones(3), np.deg2rad(across)))
    return degrees, px
