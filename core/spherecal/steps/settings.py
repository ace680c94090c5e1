"""The settings of a calibration."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.assumed import assumed_of_session
from spherecal.data.findings import Finding, Findings
from spherecal.data.rig import BallProfile
from spherecal.data.session import Session
from spherecal.geometry.camera import LensModel
from spherecal.initialise.camera_path import BASE, Search
from spherecal.initialise.triple import MIN_EIGHT_POINT
from spherecal.initialise.view_graph import EdgeWeights
from spherecal.steps.repairs import Repairs

Method = Literal["auto", "tao2021", "free", "soft", "rigid", "board", "bar"]

# TH_pt of [Tao21], which gives no value. On rig B 20 common points leave cameras without a path in 8 of 12 runs, 16 in
# 2, 12 in none; with 8, from groups that hardly hold together, 8 of 12 adjustments end in the optimum instead of 11.
TH_PT = 12


@dataclass(frozen=True)
class CalibrationSettings:
    """How to calibrate; `auto` is `rigid` if the data support it, else `soft` or `free`.

    `shape_sd_mm`: of the soft form, how far the ball's dots may be off its shape (standard deviation per coordinate);
    None to estimate it. `ball`: a stored shape of the recorded ball, for `auto` and `rigid`.

    `tao2021` is the paper's method to the letter (steps/tao2021.py). Of it alone: `search` `first` is none-OPT,
    `first-listed` the same in the literal order of Algorithm 3; `spherical_projection` False is none-SPO; `weights` and
    `base` are xi1, xi2, TH_er and b of (10)-(14); `th_pt`, the points that a group of cameras needs in common;
    `damping` of the adjustment, of the diagonal (Marquardt) or by the identity (Levenberg). `joint` False leaves a
    board or a bar as it was chained, without the joint adjustment.

    `intrinsics` `fixed` keeps the priors, `own_intrinsics` disregards intrinsics groups. `lens`: the lens model of all
    cameras; None for the session's own, `auto` for the one that fits best where the session's misfits.
    `repair_by_itself`: leave out wrong images and split moved cameras where that is certain
    (steps/automatic_repairs.py). `reference`: the camera whose frame is the world, where it can be placed; None for
    the one that belongs to most triples.
    """

    method: Method = "auto"
    search: Search = "opt"
    spherical_projection: bool = True
    intrinsics: Literal["free", "fixed"] = "free"
    own_intrinsics: bool = False
    lens: LensModel | Literal["auto"] | None = None
    seed: int = 0
    repairs: Repairs = field(default_factory=Repairs)
    shape_sd_mm: float | None = None
    ball: BallProfile | None = None
    repair_by_itself: bool = True
    reference: str | None = None
    weights: EdgeWeights = field(default_factory=EdgeWeights)
    base: float = BASE
    th_pt: int = TH_PT
    damping: Literal["diagonal", "identity"] = "diagonal"
    joint: bool = True


_OF_THE_PAPER = ("search", "spherical_projection", "weights", "base", "th_pt", "damping")


def as_stated(session: Session, settings: CalibrationSettings, seen: Mapping[str, float] | None = None) -> Findings:
    """Findings on the user's input: assumed figures, settings that have no effect in the chosen method."""
    plain, kinds = CalibrationSettings(), []
    if settings.method != "tao2021" and any(getattr(settings, one) != getattr(plain, one) for one in _OF_THE_PAPER):
        kinds.append("of-the-paper")
    if not settings.joint and settings.method not in ("board", "bar"):
        kinds.append("joint")
    vain = [Finding("setting-without-effect", "info", {"method": settings.method}, kind=kind) for kind in kinds]
    return (*assumed_of_session(session, seen), *vain)


def check_settings(session: Session, settings: CalibrationSettings) -> None:
    """Checks that the settings can be used with the session and with each other."""
    other = next((camera for camera in session.cameras if camera.lens_model != "brown"), None)
    if settings.method == "tao2021" and other is not None:
        raise InputError(Phrase("error-lens-of-method", {"camera": other.id, "model": other.lens_model}))
    w = settings.weights
    if not (1 <= settings.base <= 10 and 0 <= w.error < 1e9 and 0 <= w.count < 1e9 and w.error + w.count > 0):
        raise InputError(Phrase("error-path-weights"))
    if not 0 < w.threshold_px < 1e9 or settings.th_pt < MIN_EIGHT_POINT:
        raise InputError(Phrase("error-path-weights"))
    if settings.ball is not None and settings.method not in ("auto", "rigid"):
        raise InputError(Phrase("error-profile-method", {"method": settings.method}))
