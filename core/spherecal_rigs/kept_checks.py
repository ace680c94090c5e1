"""Quick checks kept in a profile: checks/20261121T171530123456Z.json, one a check, never changed afterwards."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, get_args

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_files import codec
from spherecal_files.filesystem import write_below

FOLDER = "checks"
_ID = re.compile(r"[0-9]{8}T[0-9]{12}Z")
# Two a day for more than a year; older ones stay in the folder.
_MOST_READ = 1000

Verdict = Literal["ok", "watch", "recalibrate"]


@dataclass(frozen=True)
class KeptCheck:
    """One check: when, of which calibration, its verdict, and what it measured; None where it was not measured."""

    at: datetime
    calibration: str
    verdict: Verdict
    sentence: str
    point_mm: Mapping[str, float]  # by camera, the largest error of a point by its move
    rms_px: float | None
    scale_ppm: float | None  # the ball's size against the calibration
    bar_error_mm: float | None  # mean of the bars' lengths
    temperature_c: float | None


def _kept(
    checked_at: datetime, calibration: str, check: Mapping[str, Any], temperature_c: float | None = None
) -> KeptCheck:
    cameras = check["cameras"]
    # of all cameras' residuals together
    known = [(c["rms_px"], c["points"]) for c in cameras if "rms_px" in c and "points" in c]
    total = sum(points for _, points in known)
    return KeptCheck(
        at=checked_at,
        calibration=calibration,
        verdict=check["verdict"],
        sentence=check["sentence"],
        point_mm={c["id"]: c["point_mm"] for c in cameras if "point_mm" in c},
        rms_px=(sum(points * rms**2 for rms, points in known) / total) ** 0.5 if total else None,
        scale_ppm=_mean([ball["scale_ppm"] for ball in check["balls"]]),
        bar_error_mm=_mean([length["error_mm"] for length in check["lengths"]]),
        temperature_c=temperature_c,
    )


def _part(*read: codec.Field, others: Sequence[str]) -> codec.Kind[tuple[dict[str, Any], ...]]:
    """Cameras, balls or lengths of check.json, of which only some fields are read."""
    return codec.items(
        "As in check.json.", codec.record("", dict, *read, *(codec.unread(key, "As in check.json.") for key in others))
    )


_CAMERAS = _part(
    codec.field("id", codec.name("Its id.")),
    codec.optional("point_mm", codec.number("Largest shift of a point.", 0)),
    codec.optional("rms_px", codec.number("Root mean square of its residuals.", 0)),
    codec.optional("points", codec.number("Points that it saw.", 0)),
    others=("verdict", "calibrated_rms_px", "moved", "move_px", "shift_mm", "turn_deg", "probability", "reason"),
)
_BALLS = _part(
    codec.field("scale_ppm", codec.number("Size of the ball.")),
    others=("placement", "dots", "scale_sd_ppm", "shape_rms_mm", "changed"),
)
_LENGTHS = _part(
    codec.field("error_mm", codec.number("Error of the length.")),
    others=("bar", "from", "to", "pose", "length_mm", "reference_mm", "u_mm"),
)
_CHECK = codec.record(
    "The result, as in check.json.",
    dict,
    codec.field("verdict", codec.choice("The verdict.", get_args(Verdict))),
    codec.field("sentence", codec.prose("The verdict in words.")),
    codec.unread("tolerance_mm", "As in check.json."),
    codec.field("cameras", _CAMERAS),
    codec.field("balls", _BALLS),
    codec.field("lengths", _LENGTHS),
)
PROFILE_CHECK = codec.FileFormat(
    "spherecal/profile-check",
    "checks/*.json",
    "A quick check kept in a profile.",
    codec.record(
        "",
        _kept,
        codec.field("checked_at", codec.time("When it was checked.")),
        codec.field("calibration", codec.name("The calibration that was checked.")),
        codec.optional("temperature_c", codec.celsius("The rig's temperature in degrees Celsius.")),
        codec.field("check", replace(_CHECK, entry=dict)),
        codec.software(),
    ),
    more="profiles.md",
)


@dataclass(frozen=True)
class _Written:
    """A check as it is kept."""

    checked_at: datetime
    calibration: str
    temperature_c: float | None
    check: Mapping[str, Any]


def keep_check(
    folder: Path, calibration: str, check: Mapping[str, Any], temperature_c: float | None, now: datetime | None = None
) -> Path:
    """Add a check to the profile in `folder`; the file that it is in."""
    at = (now or datetime.now(UTC)).astimezone(UTC)
    file = f"{FOLDER}/{at:%Y%m%dT%H%M%S%f}Z.json"
    parts = {key: check[key] for key in ("verdict", "sentence", "tolerance_mm", "cameras", "balls", "lengths")}
    write_below(folder, file, PROFILE_CHECK.bytes(_Written(at, calibration, temperature_c, parts)))
    return folder / file


def read_checks(folder: Path, most: int = _MOST_READ) -> tuple[tuple[KeptCheck, ...], tuple[str, ...]]:
    """The newest checks of a profile, oldest first, and what is wrong with those that cannot be read."""
    try:
        names = sorted(p.name for p in (folder / FOLDER).iterdir() if _ID.fullmatch(p.stem) and p.suffix == ".json")
    except OSError:
        return (), ()
    found, problems = [], []
    for file in names[-most:] if most else ():
        try:
            if (path := folder / FOLDER / file).is_symlink():
                raise InputError(Phrase("error-not-profiles-file", {"file": path}))
            found.append(PROFILE_CHECK.read(path, below=path.parent))
        except InputError as error:
            problems.append(str(error))
    return tuple(found), tuple(problems)


def last_check(folder: Path, calibration: str | None) -> KeptCheck | None:
    """The newest check, if it was of this calibration; None as well where it cannot be read."""
    found, _ = read_checks(folder, 1)
    return found[0] if found and found[0].calibration == calibration else None


def _mean(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None
