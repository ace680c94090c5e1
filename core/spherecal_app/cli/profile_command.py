"""`spherecal profile save|list|show|apply|restore`."""

import argparse
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.data.verdict import WORDS
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE
from spherecal_rigs.calibration_age import Validity, ValidityLimits
from spherecal_rigs.kept_checks import read_checks
from spherecal_rigs.limits_file import limits_in_use
from spherecal_rigs.save_entry import SaveOptions, prepare
from spherecal_rigs.store import (
    Profile,
    add_entry,
    copy_is_right,
    create_profile,
    is_profile,
    open_profile,
    set_limits,
)
from spherecal_rigs.store import apply as put_to_use
from spherecal_rigs.store import restore as put_back


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


def _summary(profile: Profile, state: Validity) -> dict[str, object]:
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
