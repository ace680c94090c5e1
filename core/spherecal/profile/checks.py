"""Quick checks kept in a profile: checks/20261121T171530123456Z.json, one a check, never changed afterwards."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from spherecal.base.errors import InputError
from spherecal.base.filesystem import write_below
from spherecal.base.messages.values import Phrase
from spherecal.files.json_file import JsonValue, finite, json_bytes, software_entry
from spherecal.profile.entry import migrated

FORMAT = "spherecal/profile-check"
VERSION = 1
FOLDER = "checks"
_ID = re.compile(r"[0-9]{8}T[0-9]{12}Z")
# Two a day for more than a year; older ones stay in the folder.
_MOST_READ = 1000

Verdict = Literal["ok", "watch", "recalibrate"]


@dataclass(frozen=True)
class KeptCheck:
    """One check: when, of which calibration, its verdict, and what it measured; None where it was not measured.

    `point_mm` gives by camera the largest shift of a point that its move brings about, `scale_ppm` the ball's size
    against the calibration, `bar_error_mm` the mean error of the bars' lengths.
    """

    at: datetime
    calibration: str
    verdict: Verdict
    sentence: str
    point_mm: Mapping[str, float]
    rms_px: float | None
    scale_ppm: float | None
    bar_error_mm: float | None
    temperature_c: float | None


def keep_check(
    folder: Path, calibration: str, check: Mapping[str, Any], temperature_c: float | None, now: datetime | None = None
) -> Path:
    """Add a check (the document of check.json) to the profile in `folder`; OutputError where it cannot be written."""
    at = (now or datetime.now(UTC)).astimezone(UTC)
    name = f"{FOLDER}/{at:%Y%m%dT%H%M%S%f}Z.json"
    document = {
        "format": FORMAT,
        "version": VERSION,
        "checked_at": at.isoformat(),
        "calibration": calibration,
        "temperature_c": finite(temperature_c),
        "check": {key: check[key] for key in ("verdict", "sentence", "tolerance_mm", "cameras", "balls", "lengths")},
        "software": software_entry(None),
    }
    write_below(folder, name, json_bytes(document))
    return folder / name


def read_checks(folder: Path, most: int = _MOST_READ) -> tuple[tuple[KeptCheck, ...], tuple[str, ...]]:
    """The newest checks of a profile, oldest first, and what is wrong with those that cannot be read."""
    try:
        names = sorted(p.name for p in (folder / FOLDER).iterdir() if _ID.fullmatch(p.stem) and p.suffix == ".json")
    except OSError:
        return (), ()
    found, problems = [], []
    for name in names[-most:] if most else ():
        try:
            found.append(_read(folder / FOLDER / name))
        except InputError as error:
            problems.append(str(error))
    return tuple(found), tuple(problems)


def last_check(folder: Path, calibration: str | None) -> KeptCheck | None:
    """The newest check, if it was of this calibration."""
    found, _ = read_checks(folder, 1)
    return found[0] if found and found[0].calibration == calibration else None


def _read(path: Path) -> KeptCheck:
    if path.is_symlink():
        raise InputError(Phrase("error-not-profiles-file", {"file": path}))
    f = migrated(path, FORMAT, VERSION, {}).fields(
        ("checked_at", "calibration", "check"), ("temperature_c", "software")
    )
    check = f["check"].fields(("verdict", "sentence", "cameras", "balls", "lengths"), ("tolerance_mm",))
    cameras = [one.fields(("id",), ("point_mm", "rms_px", "points")) for one in check["cameras"].items()]
    scales = [ball.fields(("scale_ppm",)) for ball in check["balls"].items()]
    errors = [length.fields(("error_mm",)) for length in check["lengths"].items()]
    verdict: Verdict = check["verdict"].choice("ok", "watch", "recalibrate")
    return KeptCheck(
        at=f["checked_at"].time(),
        calibration=f["calibration"].name(),
        verdict=verdict,
        sentence=check["sentence"].prose(),
        point_mm={c["id"].name(): c["point_mm"].number(0) for c in cameras if "point_mm" in c},
        rms_px=_rms(cameras),
        scale_ppm=_mean([s["scale_ppm"].number() for s in scales]),
        bar_error_mm=_mean([e["error_mm"].number() for e in errors]),
        temperature_c=f["temperature_c"].celsius() if "temperature_c" in f else None,
    )


def _rms(cameras: list[dict[str, JsonValue]]) -> float | None:
    """Of all cameras' residuals together."""
    known = [(c["rms_px"].number(0), c["points"].number(0)) for c in cameras if "rms_px" in c and "points" in c]
    total = sum(points for _, points in known)
    return (sum(points * rms**2 for rms, points in known) / total) ** 0.5 if total else None


def _mean(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None
