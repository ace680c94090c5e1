"""Real photographs held out: whether fields of lenses and motions of images predict placements they were not fitted to.

A fold is every fourth placement of dome15. The others are calibrated, with fields and motions and without. The images
held out are then compared with that rig, its cameras held, and with each image turned freely about its camera's centre.
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.stages import without_effects
from benchmarks.studies.bound import derivatives
from benchmarks.studies.report import Report
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray
from spherecal.calibrate import calibrate
from spherecal.data.observations import Observations, find_features
from spherecal.data.rig import Calibration
from spherecal.data.rig_camera import posed
from spherecal.data.session import Session
from spherecal.geometry.rotation import exp_rotation
from spherecal.geometry.triangulation import triangulate
from spherecal.steps.settings import CalibrationSettings
from spherecal_files.read_session import read_session
from spherecal_verify.participation import lens_corrected

DOME = Path(os.environ.get("SPHERECAL_DATA", "../data")) / "dome15"
FOLDS, GOAL_PX = 4, 0.48
_ROUNDS = 4


@dataclass(frozen=True)
class HeldOut:
    """Of one fold: rms px of what was fitted; squares (n,) px^2 of what was held out, cameras held and turning."""

    fitted: float
    held: FloatArray
    turning: FloatArray
    fields: int
    verdict: str


def held_out(done: Calibration, o: Observations) -> tuple[FloatArray, FloatArray]:
    """Squares (n,) px^2 of the residuals of a placement's points that were seen twice: cameras held, and turning."""
    names = [camera.id for camera in done.rig.cameras]
    o = o.select(np.flatnonzero(np.isin(o.camera, [o.cameras.index(name) for name in names])))
    o = o.select(np.flatnonzero(np.bincount(f := find_features(o).of_observation)[f] >= 2))
    point = find_features(o).of_observation
    camera = np.array([names.index(name) if name in names else -1 for name in o.cameras])[o.camera]
    uv, _ = lens_corrected(done.rig.cameras, camera, o.uv, np.ones((len(o), 2)))
    count, rows, looking = int(point.max()) + 1, np.arange(len(o)), posed(done.rig.cameras)
    state = State(looking.rotation, looking.translation, looking.intrinsics, np.zeros((0, 3)))
    squares = []
    for _ in range(1 + _ROUNDS):
        found = triangulate(point, camera, uv, np.ones((len(o), 2)), count, state.cameras)
        squares.append((found.residual**2).sum(axis=1))
        by_camera, by_point = derivatives(state, camera, found.points[point], np.zeros(0, dtype=np.int64))
        jacobian = np.zeros((len(o), 2, 3 * (len(names) + count)))
        for k in range(3):
            jacobian[rows, :, 3 * camera + k] = by_camera[:, :, k]
            jacobian[rows, :, 3 * (len(names) + point) + k] = by_point[:, :, k]
        step = np.linalg.lstsq(jacobian.reshape(2 * len(o), -1), found.residual.ravel())[0][: 3 * len(names)]
        turn = exp_rotation(-np.asarray(step, dtype=np.float64).reshape(-1, 3))
        translation = np.einsum("cij,cj->ci", turn, state.translation)
        state = replace(state, rotation=turn @ state.rotation, translation=translation)
    return squares[0], squares[-1]


def study(session: Session, fold: int, own_lenses: bool) -> dict[bool, HeldOut]:
    """One fold, calibrated with effects (True) and without."""
    o = session.observations
    assert o is not None
    out = range(fold, len(session.placements), FOLDS)
    kept = replace(session, observations=o.select(np.flatnonzero(~np.isin(o.placement, list(out)))))
    settings = CalibrationSettings(own_intrinsics=own_lenses)
    done = {True: calibrate(kept, settings)}
    with without_effects():
        done[False], whole = calibrate(kept, settings), calibrate(session, settings)
    good = whole.observations.select(
        np.flatnonzero(whole.used)
    )  # gross errors are those of the plain adjustment of all
    results = {}
    for effects, by in done.items():
        parts = [held_out(by, good.select(np.flatnonzero(good.placement == t))) for t in out]
        held, turning = (np.concatenate(each) for each in zip(*parts, strict=True))
        fields, quality = sum(camera.field is not None for camera in by.rig.cameras), by.rig.quality
        results[effects] = HeldOut(quality.rms_px or np.nan, held, turning, fields, quality.verdict)
    return results


def report(runs: int | None = None) -> Report:
    """The study's page; the number of runs does not matter."""
    page = Report("Placements held out: fields and motions on a real recording", "dev.py studies folds")
    if not DOME.is_dir():
        page.text(f"{DOME} is not there.")
        return page
    session = read_session(DOME)
    page.text(
        f"dome15, twelve placements, {FOLDS} folds of every fourth one. rms px (2-D) of the placements fitted, "
        "and of those held out: cameras held, and each image turned freely about its camera's centre. Points are "
        "triangulated from the images held out, in both."
    )
    rows = []
    for own in (False, True):
        by_fold = [study(session, fold, own) for fold in range(FOLDS)]
        for effects, name in ((True, "fields and motions"), (False, "plain")):
            lenses = "own" if own else "as the session groups them"
            for fold, found in enumerate(by_fold):
                f = found[effects]
                rows.append((lenses, name, fold + 1, f.fitted, _rms(f.held), _rms(f.turning), f.fields, f.verdict))
            held, turning = (np.concatenate([getattr(f[effects], one) for f in by_fold]) for one in ("held", "turning"))
            fitted = float(np.sqrt(np.mean([f[effects].fitted ** 2 for f in by_fold])))
            rows.append((lenses, name, "all", fitted, _rms(held), _rms(turning), "", ""))
    page.table(
        ("lenses", "adjusted with", "fold", "fitted", "held out", "held out, turning", "fields", "verdict"), rows
    )
    page.heading("Goals")
    of = {(lenses, name): (held, turning) for lenses, name, fold, _, held, turning, *_ in rows if fold == "all"}
    for lenses in dict.fromkeys(key[0] for key in of):
        (held, turning), (plain_held, plain_turning) = of[lenses, "fields and motions"], of[lenses, "plain"]
        page.verdict(
            f"lenses {lenses}: at most {GOAL_PX} px where images turn", turning <= GOAL_PX, f"{turning:.3f} px"
        )
        page.verdict(
            f"lenses {lenses}: held out and turning no worse than the plain adjustment",
            turning <= plain_turning,
            f"{turning:.3f} px, plain {plain_turning:.3f} (cameras held {held:.3f} and {plain_held:.3f})",
        )
    return page


def _rms(squares: FloatArray) -> float:
    return float(np.sqrt(squares.mean()))
