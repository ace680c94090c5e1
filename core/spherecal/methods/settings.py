"""What a user may say of how to calibrate."""

from dataclasses import dataclass, field
from typing import Literal

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.edits import Repairs
from spherecal.data.session import Session
from spherecal.files.ball_file import BallProfile
from spherecal.geometry.camera import LensModel
from spherecal.initialise.path import Search

Method = Literal["auto", "tao2021", "free", "soft", "rigid", "board", "bar"]


@dataclass(frozen=True)
class CalibrationSettings:
    """How to calibrate; `auto` is `rigid` where the data carry it, else `soft` or `free`.

    `shape_sd_mm`: of the soft form, how far the ball's dots may be off its shape (standard deviation per coordinate);
    None to estimate it. `ball`: a stored shape of the recorded ball, for `auto` and `rigid`.

    `tao2021` starts from chained points and spherical projection and estimates the paper's distortion terms; `search`
    `first` is none-OPT, `spherical_projection` False none-SPO. `intrinsics` `fixed` keeps the priors,
    `own_intrinsics` disregards intrinsics groups. `lens`: the lens model of all cameras; None for the session's own,
    `auto` for the one that fits best where the session's misfits.
    `repair_by_itself`: leave out wrong images and split moved cameras
    where that is certain (diagnose/automatic_edits.py). `reference`: the camera whose frame is the world, where it can
    be placed; None for the one that belongs to most triples.
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


def check_settings(session: Session, settings: CalibrationSettings) -> None:
    """InputError where the settings cannot be used with the session or with each other."""
    other = next((camera for camera in session.cameras if camera.lens_model != "brown"), None)
    if settings.method == "tao2021" and other is not None:
        raise InputError(Phrase("error-lens-of-method", {"camera": other.id, "model": other.lens_model}))
    if settings.ball is not None and settings.method not in ("auto", "rigid"):
        raise InputError(Phrase("error-profile-method", {"method": settings.method}))
