"""`spherecal check`: whether the rig still measures as it was calibrated."""

import argparse
from dataclasses import replace
from functools import partial

import numpy as np
from rich.markup import escape

from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import language
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig
from spherecal.data.session import Session
from spherecal_app.cli.compile_kernels import compile_first
from spherecal_app.cli.console import (
    answer,
    figures,
    kept_in_profile,
    out,
    say,
    show_findings,
    shown_progress,
    to_output,
)
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_files.atomic import RESULT, check_folder
from spherecal_files.json_file import json_bytes
from spherecal_files.read_session import read_session
from spherecal_files.write_result import write_result
from spherecal_rigs.check_rig import Check, check_json, keep, read_known_ball
from spherecal_rigs.check_rig import check as run
from spherecal_rigs.repose import repose
from spherecal_rigs.rig_source import points_file, read_source
from spherecal_rigs.store import is_profile, open_profile
from spherecal_verify.limit import parse_limit

_COLOURS = {"ok": "bold green", "watch": "bold yellow", "recalibrate": "bold red"}
_WORDS = {"ok": "OK", "watch": "WATCH", "recalibrate": "RECALIBRATE"}


def check(options: argparse.Namespace) -> int:
    """`spherecal check`."""
    limit = None if options.limit is None else parse_limit(options.limit)
    if options.repair is not None:
        check_folder(options.repair, RESULT)
    with shown_progress() as context:
        source = read_source(options.profile)
        session = _only(read_session(options.session), options.only)
        compile_first(context)
        found = run(session, source.rig, read_known_ball(points_file(options.profile)), limit, context)
    document = check_json(found)
    if options.output is not None:
        to_output(options.output, json_bytes(document))
    kept = None
    if not options.not_kept:
        keep_it = partial(keep, options.profile, document, options.temperature)
        kept = kept_in_profile("The check", options.profile, keep_it)
    answer(options, document)
    _show(found, _chip(options))
    if kept is not None:
        say(kept)
    if options.repair is not None:
        _repair(options, session, source.rig, found)
    return NOT_VALID if found.verdict == "recalibrate" else DONE


def _only(session: Session, only: str | None) -> Session:
    if only is None:
        return session
    wanted = [name for name in only.split(",") if name]
    known = [place.id for place in (*session.placements, *session.bar_poses)]
    if unknown := sorted(set(wanted) - set(known)) or not wanted:
        named = ", ".join(unknown) if isinstance(unknown, list) else only
        raise InputError(Phrase("error-no-place-named", {"folder": session.where, "names": named, "known": known}))
    placements = tuple(p for p in session.placements if p.id in wanted)
    poses = tuple(p for p in session.bar_poses if p.id in wanted)
    kept = [p.id for p in (*placements, *poses)]
    o = session.observations
    if o is not None:
        index = np.array([kept.index(name) if name in kept else -1 for name in o.placements])
        o = o.select(index[o.placement] >= 0)
        o = replace(o, placements=tuple(kept), placement=index[o.placement])
    return replace(session, placements=placements, bar_poses=poses, observations=o)


def _chip(options: argparse.Namespace) -> str | None:
    """A profile's validity by age and temperature."""
    if not (options.profile.is_dir() and is_profile(options.profile)):
        return None
    state = open_profile(options.profile).validity(options.temperature)
    return f"{state.state} ({'; '.join(state.reasons)})"


def _show(found: Check, chip: str | None) -> None:
    out.print(f"[{_COLOURS[found.verdict]}]{_WORDS[found.verdict]}[/] {escape(found.words(language()))}")
    if chip is not None:
        say(f"The calibration in use is {chip}.")
    if found.cameras:
        table = figures(
            "camera", "points", "rms px", "at calibration", "move px", "shift mm", "turn deg", "point mm", "chance", ""
        )
        for one in found.cameras:
            t = one.test
            table.add_row(
                escape(t.id), str(t.points), f"{t.rms_px:.4f}",
                "-" if one.before_px is None else f"{one.before_px:.4f}", f"{t.move_px:.3f}",
                f"{np.linalg.norm(t.shift_mm):.3f}", f"{np.degrees(np.linalg.norm(t.turn_rad)):.4f}",
                f"{t.point_mm:.3f}", f"{t.p:.2g}", f"[{_COLOURS[one.verdict]}]{_WORDS[one.verdict]}[/]",
            )  # fmt: skip
        out.print(table)
        if found.tolerance_mm is not None:
            out.print(
                f"point mm: how far a point is measured wrong by this move; above {found.tolerance_mm:.3f} mm (the "
                "rig's uncertainty of 500 mm, k = 2) the camera must be recalibrated."
            )
    for ball in found.balls:
        out.print(
            f"Ball at {escape(ball.placement)}: size {ball.scale_ppm:+.0f} ± {ball.scale_sd_ppm:.0f} ppm against the "
            f"calibration, shape {ball.shape_rms_mm:.3f} mm rms over {ball.dots} dots."
        )
    for m in found.lengths:
        out.print(
            f"{escape(m.pose)} {escape(m.from_mark)}-{escape(m.to_mark)}: {m.error_mm:+.4f} mm "
            f"(u = {m.budget.combined_mm:.4f} mm)"
        )
    show_findings(found.findings)
    if found.to_repair:
        out.print(f"To repair: spherecal check ... --repair RESULT, or recalibrate --only {','.join(found.to_repair)}")


def _repair(options: argparse.Namespace, session: Session, rig: Rig, found: Check) -> None:
    """The cameras that moved resected and adjusted on the ball, all others as they were."""
    if not found.to_repair:
        out.print("No camera has moved: there is nothing to repair.")
        return
    with shown_progress() as context:
        done = repose(session, rig, found.to_repair, context)
        write_result(done, options.repair, {"method": "selected", "only": list(found.to_repair), "estimate": "pose"})
    say(f"Cameras {', '.join(found.to_repair)} recalibrated; the repaired rig is in {options.repair}.")
