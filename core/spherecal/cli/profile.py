"""`spherecal profile save|list|show|apply|restore|compare|trend`."""

import argparse
from collections.abc import Callable
from datetime import datetime
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spherecal.base.messages.values import Phrase
from spherecal.cli.answer import answer, plain
from spherecal.data.findings import counted

if TYPE_CHECKING:
    from spherecal.profile.compare import CameraChange, Comparison
    from spherecal.profile.store import Profile
    from spherecal.profile.trend import Trend, TrendSeries
    from spherecal.profile.validity import Validity, ValidityLimits


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The command's actions and their options."""
    profile = add("profile", "A rig's calibrations over time: which is in use, is it still good, what has changed.")
    actions = profile.add_subparsers(dest="action", required=True, metavar="ACTION")

    def action(name: str, text: str) -> argparse.ArgumentParser:
        return actions.add_parser(name, help=text, description=text)

    save = action("save", "Add a result to a profile's history; the calibration in use stays in use.")
    save.add_argument("result", type=Path, metavar="RESULT", help="the result folder")
    save.add_argument("--to", type=Path, required=True, metavar="PROFILE", help="made where it is missing")
    save.add_argument("--session", type=Path, metavar="SESSION", help="for camera models, ball, targets, scale")
    save.add_argument("--settings", type=Path, metavar="FILE", help="the cameras.json with the cameras' settings")
    save.add_argument("--temperature", type=float, metavar="C", help="of the rig; else the mean of the bar poses")
    save.add_argument("--calibrated-at", type=datetime.fromisoformat, metavar="TIME", help="else rig.json's own time")
    save.add_argument("--note", default="", metavar="TEXT", help="what is to be remembered of it")
    save.add_argument("--name", help="of a new profile (default: the folder's)")
    save.add_argument("--apply", action="store_true", help="put it to use at once")
    _add_anyway(save)
    for name in ("ageing-hours", "stale-hours", "ageing-kelvin", "stale-kelvin"):
        save.add_argument(f"--{name}", type=float, metavar="N", help="when it counts as such (this profile's)")

    listing = action("list", "The profiles in a folder with their state.")
    listing.add_argument(
        "folder", type=Path, nargs="?", default=Path("."), metavar="FOLDER", help="where to look (default: here)"
    )
    show = action("show", "A profile's state and history.")
    for one in (listing, show):
        one.add_argument("--temperature", type=float, metavar="C", help="of the rig now")
    show.add_argument("profile", type=Path, metavar="PROFILE", help="the profile's folder")

    apply = action("apply", "Put a calibration of the history to use.")
    apply.add_argument("profile", type=Path, metavar="PROFILE", help="the profile's folder")
    apply.add_argument("calibration", nargs="?", metavar="ID", help="default: the newest")
    _add_anyway(apply)
    restore = action("restore", "Put the last good calibration, or the one named, back to use.")
    restore.add_argument("profile", type=Path, metavar="PROFILE", help="the profile's folder")
    restore.add_argument("calibration", nargs="?", metavar="ID", help="default: the last good one")
    for one in (apply, restore):
        one.add_argument("--note", default="", metavar="TEXT", help="why, for the history")

    compare = action("compare", "What has changed from calibration A to B, in millimetres in the volume.")
    for name in ("a", "b"):
        compare.add_argument(name, type=Path, metavar=name.upper(), help="profile, result, history folder or rig.json")
    trend = action("trend", "Changes over a profile's history, with control limits.")
    trend.add_argument("--checks", action="store_true", help="of the quick checks instead of the calibrations")
    trend.add_argument("profile", type=Path, metavar="PROFILE", help="the profile's folder")
    trend.add_argument("-o", "--output", type=Path, metavar="CHART", help="a chart, .pdf or .svg")
    trend.add_argument("--csv", type=Path, metavar="FILE", help="the figures")


def _add_anyway(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--anyway", action="store_true", help="also if the calibration is marked as not valid")


def profile(options: argparse.Namespace) -> int:
    """`spherecal profile`."""
    from spherecal.cli.main import DONE

    {
        "save": _save,
        "list": _list,
        "show": _show,
        "apply": _apply,
        "restore": _restore,
        "compare": _compare,
        "trend": _trend,
    }[options.action](options)
    return DONE


def _say(*lines: str) -> None:
    from spherecal.cli.commands import out

    for line in lines:
        out.print(line, markup=False)


def _save(options: argparse.Namespace) -> None:
    from spherecal.profile.save import SaveOptions, prepare
    from spherecal.profile.store import add_entry, apply, create_profile, open_profile, set_limits

    at = None if options.calibrated_at is None else options.calibrated_at.astimezone()
    known = SaveOptions(options.session, options.settings, options.temperature, options.note, at)
    prepared = prepare(options.result, known)  # before a folder is made for it
    profile = create_profile(options.to, options.name, _machine_limits(options.to))
    names = ("ageing_hours", "stale_hours", "ageing_kelvin", "stale_kelvin")
    if given := {name: value for name in names if (value := getattr(options, name)) is not None}:
        profile = set_limits(options.to, **given)
    saved = add_entry(profile, *prepared)
    _say(f"Saved as calibration {saved} of {options.to}.")
    profile = open_profile(options.to)
    if options.apply:
        apply(profile, saved, options.note, options.anyway)
        profile = open_profile(options.to)
    answer(options, {"profile": options.to, "calibration": saved, "active": profile.active_id})
    if options.apply:
        _say(f"Calibration {saved} is in use.")
    elif profile.active_id is None:
        _say(f"None is in use yet: spherecal profile apply {options.to} {saved}")
    else:
        _say(f"Calibration {profile.active_id} stays in use: spherecal profile apply {options.to} {saved}")


def _machine_limits(folder: Path) -> "ValidityLimits | None":
    """What this machine's responsible person has set, for a new profile; one that is there keeps its own."""
    from spherecal.profile.limits_file import limits_in_use
    from spherecal.profile.store import is_profile

    if is_profile(folder):
        return None
    limits, problem = limits_in_use()
    if problem:
        _say(problem)
    return limits.validity


def _list(options: argparse.Namespace) -> None:
    from spherecal.base.errors import InputError
    from spherecal.profile.store import is_profile, open_profile

    if not options.folder.is_dir():
        raise InputError(Phrase("error-no-folder", {"folder": options.folder}))
    folders = [options.folder, *sorted(path for path in options.folder.iterdir() if path.is_dir())]
    found = [folder for folder in folders if is_profile(folder)]
    if not found:
        _say(f"There are no profiles in {options.folder.resolve()}.")
    record: list[dict[str, Any]] = []
    for folder in found:
        try:
            profile = open_profile(folder)
            state = profile.validity(options.temperature)
            record.append({"folder": str(folder), **_summary(profile, state)})
            line = f"{profile.name}: {_chip(state)}; {folder}"
        except InputError as error:  # one broken profile must not hide the others
            record.append({"folder": str(folder), "error": str(error)})
            line = f"{folder.name}: cannot be read. {error}"
        _say(line)
    answer(options, record)


def _chip(state: "Validity") -> str:
    return f"{state.state.upper()} ({'; '.join(state.reasons)})"


def _show(options: argparse.Namespace) -> None:
    from spherecal.data.verdict import WORDS
    from spherecal.profile.checks import read_checks
    from spherecal.profile.store import copy_is_right, open_profile

    profile = open_profile(options.profile)
    state = profile.validity(options.temperature)
    answer(options, _summary(profile, state))
    _say(f"{profile.name}: {_chip(state)}", f"In use: {profile.active_id or 'none'}")
    if not copy_is_right(profile):
        _say(
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
        _say(
            f"{mark} {key}  {entry.calibrated_at:%Y-%m-%d %H:%M} UTC  {counted(len(entry.cameras), 'camera')}, "
            f"rms {rms}{bars}{warm}{valid}  {entry.note}".rstrip()
        )
    checks, broken = read_checks(profile.folder)
    if checks:
        last = checks[-1]
        _say(
            f"Quick checks: {len(checks)}, the last on {last.at:%Y-%m-%d %H:%M} UTC of calibration {last.calibration}: "
            f"{last.verdict.upper()}. {last.sentence}"
        )
    _say(*(f"Cannot be read: {problem}" for problem in (*profile.problems, *broken)))


def _summary(profile: "Profile", state: "Validity") -> dict[str, Any]:
    from spherecal.profile.checks import read_checks

    return {
        "name": profile.name,
        "state": state.state,
        "reasons": list(state.reasons),
        "age_hours": state.age_hours,
        "temperature_change_kelvin": state.change_kelvin,
        "active": profile.active_id,
        "last_good": profile.last_good_id,
        "calibrations": [
            {
                "id": key,
                "calibrated_at": entry.calibrated_at.isoformat(),
                "valid": entry.valid,
                "calibration_verdict": entry.calibration_verdict,
                "care": entry.care,
                "rms_px": entry.rms_px,
                "temperature_c": entry.temperature_c,
                "verdict": entry.verdict,
                "note": entry.note,
            }
            for key, entry in profile.entries.items()
        ],
        "checks": [
            {"checked_at": one.at.isoformat(), "calibration": one.calibration, "verdict": one.verdict}
            for one in read_checks(profile.folder)[0]
        ],
        "problems": list(profile.problems),
    }


def _apply(options: argparse.Namespace) -> None:
    from spherecal.base.errors import InputError
    from spherecal.profile.store import apply, open_profile

    profile = open_profile(options.profile)
    chosen = options.calibration or next(reversed(profile.entries), None)
    if chosen is None:
        raise InputError(Phrase("error-empty-profile", {"folder": options.profile}))
    apply(profile, chosen, options.note, options.anyway)
    answer(options, {"profile": options.profile, "active": chosen})
    _say(f"Calibration {chosen} is in use; its rig is {options.profile / 'rig.json'}.")


def _restore(options: argparse.Namespace) -> None:
    from spherecal.profile.store import open_profile, restore

    changed = restore(open_profile(options.profile), options.calibration, options.note)
    answer(options, {"profile": options.profile, "active": changed.active_id})
    _say(f"Calibration {changed.active_id} is in use again; its rig is {options.profile / 'rig.json'}.")


def _compare(options: argparse.Namespace) -> None:
    from spherecal.profile.compare import compare
    from spherecal.profile.source import read_source, volume_of

    a, b = read_source(options.a), read_source(options.b)
    free, metric = compare(a.rig, b.rig, volume_of(a))
    answer(options, {"similarity": _compared(free), "metric": _compared(metric)})
    for comparison, title in ((free, "After the best similarity"), (metric, "Metric, without a change of scale")):
        _say(f"{title}:", *_lines(comparison), "")
    if free.only_in_a or free.only_in_b:
        _say(f"Only in A: {', '.join(free.only_in_a) or 'none'}; only in B: {', '.join(free.only_in_b) or 'none'}.")


def _lines(c: "Comparison") -> list[str]:
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


def _row(x: "CameraChange") -> str:
    length = "-" if x.length_mm is None else f"{x.length_mm:.4f}"
    return (
        f"  {x.id:<14} {_norm(x.centre_mm):9.4f} {_norm(x.rotation_deg):9.4f} {x.focal_px:+10.3f} {x.ray_rms_mm:12.4f} "
        f"{x.ray_max_mm:8.4f} {x.ray_max_px:8.3f} {length:>10}{'  another serial number' if x.replaced else ''}"
    )


def _norm(vector: Any) -> float:
    import numpy as np

    return float(np.linalg.norm(vector))


def _mm(value: float | None, digits: int = 3, sign: str = "") -> str:
    return "-" if value is None else f"{value:{sign}.{digits}f} mm"


def _compared(c: "Comparison") -> dict[str, Any]:
    from spherecal.files.json_file import finite

    return {
        "scale_ppm": finite(c.scale_ppm),
        "volume_mm": [finite(c.volume.low_mm), finite(c.volume.high_mm)],
        "point_mm": finite(c.point_mm),
        "length_mm": finite(c.length_mm),
        "of_length_mm": finite(c.of_length_mm),
        "cameras": [
            {
                "id": x.id,
                "moved": x.moved,
                "replaced": x.replaced,
                "centre_mm": finite(x.centre_mm),
                "rotation_deg": finite(x.rotation_deg),
                "focal_px": finite(x.focal_px),
                "ray_rms_mm": finite(x.ray_rms_mm),
                "ray_max_mm": finite(x.ray_max_mm),
                "ray_max_px": finite(x.ray_max_px),
                "point_mm": finite(x.point_mm),
                "length_mm": finite(x.length_mm),
            }
            for x in c.cameras
        ],
        "only_in_a": list(c.only_in_a),
        "only_in_b": list(c.only_in_b),
    }


def _trend_entry(trend: "Trend") -> dict[str, Any]:
    def entry(series: "TrendSeries") -> dict[str, Any]:
        outside = [trend.ids[i] for i in series.outside]
        return {**plain(series), "outside": outside}

    return {
        "kind": trend.kind,
        "ids": trend.ids,
        "times": trend.times,
        "verdicts": trend.verdicts,
        "series": [entry(one) for one in trend.series],
        "cameras": [entry(one) for one in trend.cameras],
    }


def _trend(options: argparse.Namespace) -> None:
    from spherecal.cli.parsing import to_output
    from spherecal.profile.store import open_profile
    from spherecal.profile.trend import make_check_trend, make_trend, trend_table

    trend = (make_check_trend if options.checks else make_trend)(open_profile(options.profile))
    if options.output is not None:
        from spherecal.profile.trend_chart import write_trend_chart

        write_trend_chart(trend, options.output)
    if options.csv is not None:
        to_output(options.csv, trend_table(trend).encode())
    answer(options, _trend_entry(trend))
    if trend.verdicts:
        counts = ", ".join(f"{trend.verdicts.count(word)} {word}" for word in dict.fromkeys(trend.verdicts))
        _say(f"{len(trend.verdicts)} checks: {counts}")
    for series in trend.series:
        last = next((value for value in reversed(series.values.tolist()) if isfinite(value)), None)
        limits = (
            "too few for limits" if series.limits is None else f"{series.limits.low:.4g} to {series.limits.high:.4g}"
        )
        beyond = f"; outside: {', '.join(trend.ids[i] for i in series.outside)}" if series.outside else ""
        shown = "-" if last is None else f"{last:.4g}"
        _say(f"{series.name}: last {shown} {series.unit}, limits {limits}{beyond}")
    for camera in trend.cameras:
        if camera.outside:
            values = ", ".join(f"{trend.ids[i]} ({camera.values[i]:.3f} mm)" for i in camera.outside)
            what = "its rays are" if trend.kind == "calibration" else "its move is"
            _say(f"camera {camera.name}: {what} outside the control limits in {values}")
