"""`spherecal profile save|list|show|apply|restore|compare|trend` and `spherecal limits show`."""

import argparse
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.data.verdict_words import WORDS
from spherecal_app.cli.console import answer, say
from spherecal_app.cli.exit_codes import DONE
from spherecal_files.json_file import finite, plain_fields
from spherecal_rigs.calibration_age import Validity, ValidityLimits
from spherecal_rigs.compare_rigs import CameraChange, Comparison
from spherecal_rigs.compare_rigs import compare as run
from spherecal_rigs.kept_checks import read_checks
from spherecal_rigs.limits_file import NAMES, Limits, limits_in_use, limits_path, read_limits
from spherecal_rigs.rig_source import read_source, volume_of
from spherecal_rigs.save_entry import SaveOptions, prepare
from spherecal_rigs.store import Profile, add_entry, copy_is_right, create_profile, is_profile, open_profile, set_limits
from spherecal_rigs.store import apply as put_to_use
from spherecal_rigs.store import restore as put_back
from spherecal_rigs.trend import Trend, TrendSeries, make_check_trend, make_trend


def save(options: argparse.Namespace) -> int:
    """`spherecal profile save`."""
    at = None if options.calibrated_at is None else options.calibrated_at.astimezone()
    known = SaveOptions(options.session, options.settings, options.temperature, options.note, at)
    prepared = prepare(options.result, known)  # before a folder is made for it
    profile = create_profile(options.to, options.name, _machine_limits(options.to))
    names = ("ageing_hours", "stale_hours", "ageing_kelvin", "stale_kelvin")
    if given := {name: value for name in names if (value := getattr(options, name)) is not None}:
        profile = set_limits(options.to, **given)
    saved = add_entry(profile, *prepared)
    say(f"Saved as calibration {saved} of {options.to}.")
    profile = open_profile(options.to)
    if options.apply:
        put_to_use(profile, saved, options.note, options.anyway)
        profile = open_profile(options.to)
    answer(options, {"profile": options.to, "calibration": saved, "active": profile.active_id})
    if options.apply:
        say(f"Calibration {saved} is in use.")
    elif profile.active_id is None:
        say(f"None is in use yet: spherecal profile apply {options.to} {saved}")
    else:
        say(f"Calibration {profile.active_id} stays in use: spherecal profile apply {options.to} {saved}")
    return DONE


def _machine_limits(folder: Path) -> ValidityLimits | None:
    """What this machine's responsible person has set, for a new profile; one that is there keeps its own."""
    if is_profile(folder):
        return None
    limits, problem = limits_in_use()
    if problem:
        say(problem)
    return limits.validity


def list_profiles(options: argparse.Namespace) -> int:
    """`spherecal profile list`."""
    if not options.folder.is_dir():
        raise InputError(Phrase("error-no-folder", {"folder": options.folder}))
    folders = [options.folder, *sorted(path for path in options.folder.iterdir() if path.is_dir())]
    found = [folder for folder in folders if is_profile(folder)]
    if not found:
        say(f"There are no profiles in {options.folder.resolve()}.")
    record: list[dict[str, object]] = []
    for folder in found:
        try:
            profile = open_profile(folder)
            state = profile.validity(options.temperature)
            record.append({"folder": str(folder), **_summary(profile, state)})
            line = f"{profile.name}: {_chip(state)}; {folder}"
        except InputError as error:  # one broken profile must not hide the others
            record.append({"folder": str(folder), "error": str(error)})
            line = f"{folder.name}: cannot be read. {error}"
        say(line)
    answer(options, record)
    return DONE


def _chip(state: Validity) -> str:
    return f"{state.state.upper()} ({'; '.join(state.reasons)})"


def show(options: argparse.Namespace) -> int:
    """`spherecal profile show`."""
    profile = open_profile(options.profile)
    state = profile.validity(options.temperature)
    answer(options, _summary(profile, state))
    say(f"{profile.name}: {_chip(state)}", f"In use: {profile.active_id or 'none'}")
    if not copy_is_right(profile):
        say(
            f"{profile.folder / 'rig.json'} is not the rig in use. Put it right: "
            f"spherecal profile apply {profile.folder} {profile.active_id}"
        )
    for key, entry in profile.entries.items():
        mark = "*" if key == profile.active_id else " "
        rms = "-" if entry.rms_px is None else f"{entry.rms_px:.4f} px"
        bars = "" if entry.bar_mean_error_mm is None else f", bars {entry.bar_mean_error_mm:+.4f} mm ({entry.verdict})"
        warm = "" if entry.temperature_c is None else f", {entry.temperature_c:.1f} °C"
        verdict = entry.calibration_verdict
        valid = "" if verdict == "valid" else f", {WORDS[verdict]}{f' ({entry.care})' if entry.care else ''}"
        if entry.contradicted:
            by = (
                "" if entry.override is None else f", used all the same by {entry.override.by}: {entry.override.reason}"
            )
            valid += f", VERIFICATION FAILED{by}"
        say(
            f"{mark} {key}  {entry.calibrated_at:%Y-%m-%d %H:%M} UTC  {counted(len(entry.cameras), 'camera')}, "
            f"rms {rms}{bars}{warm}{valid}  {entry.note}".rstrip()
        )
    checks, broken = read_checks(profile.folder)
    if checks:
        last = checks[-1]
        say(
            f"Quick checks: {len(checks)}, the last on {last.at:%Y-%m-%d %H:%M} UTC of calibration {last.calibration}: "
            f"{last.verdict.upper()}. {last.sentence}"
        )
    say(*(f"Cannot be read: {problem}" for problem in (*profile.problems, *broken)))
    return DONE


_OF_ENTRY = "calibrated_at valid calibration_verdict care rms_px temperature_c verdict note"


def _summary(profile: Profile, state: Validity) -> dict[str, object]:
    return {
        "name": profile.name,
        "state": state.state,
        "reasons": list(state.reasons),
        "age_hours": state.age_hours,
        "temperature_change_kelvin": state.change_kelvin,
        "active": profile.active_id,
        "last_good": profile.last_good_id,
        "calibrations": [{"id": key, **plain_fields(entry, _OF_ENTRY)} for key, entry in profile.entries.items()],
        "checks": [
            {"checked_at": one.at.isoformat(), "calibration": one.calibration, "verdict": one.verdict}
            for one in read_checks(profile.folder)[0]
        ],
        "problems": list(profile.problems),
    }


def apply(options: argparse.Namespace) -> int:
    """`spherecal profile apply`."""
    profile = open_profile(options.profile)
    chosen = options.calibration or next(reversed(profile.entries), None)
    if chosen is None:
        raise InputError(Phrase("error-empty-profile", {"folder": options.profile}))
    put_to_use(profile, chosen, options.note, options.anyway)
    answer(options, {"profile": options.profile, "active": chosen})
    say(f"Calibration {chosen} is in use; its rig is {options.profile / 'rig.json'}.")
    return DONE


def restore(options: argparse.Namespace) -> int:
    """`spherecal profile restore`."""
    changed = put_back(open_profile(options.profile), options.calibration, options.note)
    answer(options, {"profile": options.profile, "active": changed.active_id})
    say(f"Calibration {changed.active_id} is in use again; its rig is {options.profile / 'rig.json'}.")
    return DONE


def compare(options: argparse.Namespace) -> int:
    """`spherecal profile compare`."""
    a, b = read_source(options.a), read_source(options.b)
    free, metric = run(a.rig, b.rig, volume_of(a))
    answer(options, {"similarity": _compared(free), "metric": _compared(metric)})
    for comparison, title in ((free, "After the best similarity"), (metric, "Metric, without a change of scale")):
        say(f"{title}:", *_lines(comparison), "")
    if free.only_in_a or free.only_in_b:
        say(f"Only in A: {', '.join(free.only_in_a) or 'none'}; only in B: {', '.join(free.only_in_b) or 'none'}.")
    return DONE


def _lines(c: Comparison) -> list[str]:
    lines = [] if c.metric else [f"  scale: B measures {c.scale_ppm:+.1f} ppm against A"]
    lines.append(
        f"  a point at the volume's edge moves by up to {_mm(c.point_mm)}, a length of {_mm(c.of_length_mm, 0)} by "
        f"{_mm(c.length_mm, 4, '+')}"
    )
    moved = [camera for camera in c.cameras if camera.moved]
    if not moved:
        lines.append("  no camera stands out from the others")
    for camera in moved:
        lines.append(
            f"  camera {camera.id} moved by {_norm(camera.centre_mm):.3f} mm and {_norm(camera.rotation_deg):.4f} deg: "
            f"up to {camera.ray_max_mm:.3f} mm ({camera.ray_max_px:.2f} px) in the volume, up to "
            f"{_mm(camera.length_mm)} on a length at its edge"
        )
    if not c.metric:
        lines.append("  camera          shift mm  turn deg   focal px  rays rms mm   max mm   max px  length mm")
        lines += [_row(camera) for camera in c.cameras]
    return lines


def _row(x: CameraChange) -> str:
    length = "-" if x.length_mm is None else f"{x.length_mm:.4f}"
    return (
        f"  {x.id:<14} {_norm(x.centre_mm):9.4f} {_norm(x.rotation_deg):9.4f} {x.focal_px:+10.3f} {x.ray_rms_mm:12.4f} "
        f"{x.ray_max_mm:8.4f} {x.ray_max_px:8.3f} {length:>10}{'  another serial number' if x.replaced else ''}"
    )


def _norm(vector: ArrayLike) -> float:
    return float(np.linalg.norm(vector))


def _mm(value: float | None, digits: int = 3, sign: str = "") -> str:
    return "-" if value is None else f"{value:{sign}.{digits}f} mm"


_OF_CAMERA = "id moved replaced centre_mm rotation_deg focal_px ray_rms_mm ray_max_mm ray_max_px point_mm length_mm"


def _compared(c: Comparison) -> dict[str, object]:
    return {
        "scale_ppm": finite(c.scale_ppm),
        "volume_mm": [finite(c.volume.low_mm), finite(c.volume.high_mm)],
        **plain_fields(c, "point_mm length_mm of_length_mm"),
        "cameras": [plain_fields(x, _OF_CAMERA) for x in c.cameras],
        **plain_fields(c, "only_in_a only_in_b"),
    }


def trend(options: argparse.Namespace) -> int:
    """`spherecal profile trend`."""
    trend = (make_check_trend if options.checks else make_trend)(open_profile(options.profile))
    if options.output is not None:
        from spherecal_documents.report.trend_chart import write_trend_chart  # here, since it loads matplotlib

        write_trend_chart(trend, options.output)
    answer(options, _trend_entry(trend))
    if trend.verdicts:
        counts = ", ".join(f"{trend.verdicts.count(word)} {word}" for word in dict.fromkeys(trend.verdicts))
        say(f"{len(trend.verdicts)} checks: {counts}")
    for series in trend.series:
        last = next((value for value in reversed(series.values.tolist()) if isfinite(value)), None)
        limits = (
            "too few for limits" if series.limits is None else f"{series.limits.low:.4g} to {series.limits.high:.4g}"
        )
        beyond = f"; outside: {', '.join(trend.ids[i] for i in series.outside)}" if series.outside else ""
        shown = "-" if last is None else f"{last:.4g}"
        say(f"{series.name}: last {shown} {series.unit}, limits {limits}{beyond}")
    for camera in trend.cameras:
        if camera.outside:
            values = ", ".join(f"{trend.ids[i]} ({camera.values[i]:.3f} mm)" for i in camera.outside)
            what = "its rays are" if trend.kind == "calibration" else "its move is"
            say(f"camera {camera.name}: {what} outside the control limits in {values}")
    return DONE


def _trend_entry(trend: Trend) -> dict[str, object]:
    def entry(series: TrendSeries) -> dict[str, object]:
        outside = [trend.ids[i] for i in series.outside]
        return {**plain_fields(series), "outside": outside}

    return {
        **plain_fields(trend, "kind ids times verdicts"),
        "series": [entry(one) for one in trend.series],
        "cameras": [entry(one) for one in trend.cameras],
    }


def show_limits(options: argparse.Namespace) -> int:
    """`spherecal limits show`."""
    path = options.file or limits_path()
    limits = read_limits(path)
    values = {name: getattr(limits, name) for name in NAMES}
    answer(options, {"limits": values})
    say(f"{path}:")
    for name, value in values.items():
        delivered = getattr(Limits(), name)
        say(f"  {name}: {_word(value)}" + ("" if value == delivered else f" (delivered: {_word(delivered)})"))
    return DONE


def _word(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, int | float) else str(value or "-")
