"""Leave one placement out: how well the rest of the session predicts it."""

from dataclasses import dataclass, replace

import numpy as np

from spherecal.adjust.bundle import MIN_ANGLE_RAD
from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.threads import on_one_blas_thread
from spherecal.calibrate import calibrate
from spherecal.data.observations import find_features
from spherecal.data.rig import Calibration, Rig
from spherecal.data.rig_camera import posed
from spherecal.data.session import Session
from spherecal.detect.session_images import observed
from spherecal.geometry.transform import fit_similarity
from spherecal.geometry.triangulation import triangulate
from spherecal.steps.settings import CalibrationSettings

STAGE = "cross-validation"


@dataclass(frozen=True)
class LeftOut:
    """One placement measured with the rig that the others gave.

    `rms_px`: how well its image points agree with that rig (2-D rms of triangulated dots). `shape_rms_mm`: how far its
    dots then are from where the whole session has them, after the best rigid motion. `length_error`: the relative
    difference in size. All three are None where the others do not give a valid rig, or fewer than four dots can be
    compared.
    """

    placement: str
    dots: int
    rms_px: float | None
    shape_rms_mm: float | None
    length_error: float | None


@on_one_blas_thread
def cross_validate(
    session: Session, settings: CalibrationSettings | None = None, context: Context | None = None
) -> tuple[Calibration, tuple[LeftOut, ...]]:
    """The calibration of the whole session, and every placement compared with the rig that the others give."""
    settings, context = settings or CalibrationSettings(), context or Context()
    if len(session.placements) < 3:
        values = {"folder": session.where, "placements": len(session.placements)}
        raise InputError(Phrase("error-few-placements", values))
    session = observed(session, context)
    whole = calibrate(session, settings, context)
    found = []
    for number, placement in enumerate(session.placements):
        context.report(STAGE, number / len(session.placements), Phrase("without", {"place": placement.id}))
        o = session.observations
        assert o is not None
        without = replace(session, observations=o.select(o.placement != number))
        found.append(_left_out(placement.id, number, whole, calibrate(without, settings, context).rig))
    context.report(STAGE, 1.0)
    return whole, tuple(found)


def _left_out(placement: str, number: int, whole: Calibration, rig: Rig) -> LeftOut:
    o = whole.observations
    index = {camera.id: i for i, camera in enumerate(rig.cameras)}
    camera = np.array([index.get(name, -1) for name in o.cameras])[o.camera]
    rows = np.flatnonzero((o.placement == number) & whole.used & (camera >= 0))
    if not rig.quality.valid or not len(rows):
        return LeftOut(placement, 0, None, None, None)
    own = o.select(rows)
    features = find_features(own)
    weight = np.ones((len(own), 2)) if own.sigma is None else 1.0 / own.sigma**2
    points = triangulate(features.of_observation, camera[rows], own.uv, weight, len(features), posed(rig.cameras))
    full = whole.features.of_observation[rows]
    place = np.full((len(features), 3), np.nan)
    place[features.of_observation] = whole.points_mm[full]
    good = points.in_front & (points.max_angle_rad >= MIN_ANGLE_RAD) & np.isfinite(place[:, 0])
    if good.sum() < 4:
        return LeftOut(placement, int(good.sum()), None, None, None)
    sized = fit_similarity(place[good], points.points[good])
    rigid = fit_similarity(place[good], points.points[good], with_scale=False)
    off = np.linalg.norm(rigid.apply(place[good]) - points.points[good], axis=1)
    residual = points.residual[good[features.of_observation]]
    rms_px, shape_rms_mm = float(np.sqrt((residual**2).sum(axis=1).mean())), float(np.sqrt((off**2).mean()))
    return LeftOut(placement, int(good.sum()), rms_px, shape_rms_mm, sized.scale - 1.0)
