"""`spherecal verify`, and `override`: a failed verification used all the same."""

import argparse
from contextlib import suppress
from pathlib import Path

from rich.markup import escape

from spherecal.base.errors import SpherecalError
from spherecal.base.messages.catalogue import phrase
from spherecal.data.findings import counted
from spherecal.detect.session_images import observed
from spherecal_app.cli.console import (
    answer,
    check_output_folder,
    figures,
    log_findings,
    number,
    out,
    say,
    show_findings,
    shown_progress,
)
from spherecal_app.cli.exit_codes import BOTH, CANNOT_TELL, DONE, LIMIT_EXCEEDED, NOT_VALID
from spherecal_files.atomic import RESULT
from spherecal_files.findings_file import FINDING
from spherecal_files.json_file import plain_fields
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig
from spherecal_files.write_verification import write_verification
from spherecal_rigs.result_folder import answer_for
from spherecal_rigs.rig_source import corners_beside
from spherecal_verify.limit import parse_limit
from spherecal_verify.verification import Verification
from spherecal_verify.verify_bars import VerifySettings
from spherecal_verify.verify_bars import verify as run


def verify(options: argparse.Namespace) -> int:
    """`spherecal verify`."""
    limit = None if options.limit is None else parse_limit(options.limit)
    check_output_folder(options.output, RESULT)
    with shown_progress() as context:
        context.report("reading the session", 0.0)
        rig = read_rig(options.rig)
        session = observed(read_session(options.session), context, bar_poses_only=True)
        verification = run(session, rig, context, VerifySettings(limit, None, corners_beside(options.rig)))
        write_verification(verification, options.output, options.rig)
        known = not verification.failed or _beside_the_rig(verification, options)
    log_findings(verification.findings)
    answer(
        options,
        {
            "verdict": verification.decision.verdict,
            "failed": verification.failed,
            **plain_fields(verification.decision, "chi_square most_chi_square"),
            **plain_fields(verification.overall, "n mean_error_mm sd_mm max_abs_error_mm"),
            "acceptance": _accepted(verification),
            "cameras": {c.id: c.state for c in verification.cameras},
            "findings": [FINDING.entry(finding) for finding in verification.findings],
        },
    )
    show_verification(verification, options.output)
    if not known:
        say(f"It failed, and {options.rig.parent} has other files: exports and profiles of that rig do not know it.")
    # 3: not as the rig states; 4: beyond its limit; 5: both; 6: neither, and nothing proves the limit
    judged = _accepted(verification)
    own = any(f.severity == "error" and f.code != "limit-exceeded" for f in verification.findings)
    wrong = own or verification.decision.verdict == "inconsistent"
    if judged == "fail":
        return BOTH if wrong else LIMIT_EXCEEDED
    if wrong:
        return NOT_VALID
    has_limit = verification.procedure is not None and verification.procedure.acceptance is not None
    return CANNOT_TELL if has_limit and judged != "pass" else DONE


def _beside_the_rig(verification: Verification, options: argparse.Namespace) -> bool:
    """Write a failed verification beside the rig too, where putting to use and exports look for it, if that may be."""
    home = options.rig.parent
    if home.resolve() == options.output.resolve():
        return True
    with suppress(SpherecalError):
        write_verification(verification, home, options.rig)
        return True
    return False


def override(options: argparse.Namespace) -> int:
    """`spherecal override`."""
    answer_for(options.result, options.by, options.reason)
    answer(options, {"result": options.result, "by": options.by, "reason": options.reason})
    say(f"{options.result}: its verification failed, and it is used all the same by {options.by}: {options.reason}")
    return DONE


def show_verification(verification: Verification, folder: Path) -> None:
    """Print the verification in words and a table, verdict first."""
    word = {"consistent": "[bold green]CONSISTENT[/]", "inconsistent": "[bold red]INCONSISTENT[/]"}
    out.print(
        f"{word.get(verification.decision.verdict, '[bold yellow]NO DATA[/]')}: {phrase(verification.decision.rule)}"
    )
    table = figures("length", "n", "mean error mm", "sd mm", "max mm", "U mm", "k")
    for length in verification.lengths:
        table.add_row(
            escape(f"{length.bar} {length.from_mark}-{length.to_mark}"), str(length.n),
            number(length.mean_error_mm, 4), number(length.sd_mm, 4), number(length.max_abs_error_mm, 4),
            number(length.expanded_uncertainty_mm, 4), number(length.coverage_factor, 2),
        )  # fmt: skip
    out.print(table)
    overall = verification.overall
    mean, u = number(overall.mean_error_mm, 4), number(overall.expanded_uncertainty_mm, 4)
    sd, largest = number(overall.sd_mm, 4), number(overall.max_abs_error_mm, 4)
    out.print(f"{counted(overall.n, 'length')}: mean error {mean} mm (U {u} mm), sd {sd} mm, largest {largest} mm.")
    show_cameras_verified(verification)
    show_procedure(verification)
    show_findings(verification.findings)
    out.print(f"Result in {escape(str(folder))}.")


def show_cameras_verified(verification: Verification) -> None:
    """How many views of the marks each camera had, and how they fit."""
    if not verification.cameras or not verification.measured:
        return
    table = figures("camera", "views of marks", "used", "rms px", "")
    colour = {"verified": "green", "not seen": "yellow", "rejected": "bold red"}
    for c in verification.cameras:
        rms = number(c.rms_px, 4)
        table.add_row(escape(c.id), str(c.seen), str(c.used), rms, f"[{colour[c.state]}]{c.state}[/]")
    out.print(table)


def show_procedure(verification: Verification) -> None:
    """The decision against the user's limit, the largest contributions, and the departures from the guideline."""
    procedure = verification.procedure
    if procedure is None or not procedure.budgets:
        return
    acceptance = procedure.acceptance
    if acceptance is not None:
        colour = {"pass": "bold green", "fail": "bold red"}.get(acceptance.verdict or "", "bold yellow")
        word = (acceptance.verdict or "no data").upper()
        out.print(f"[{colour}]{word}[/] against {escape(acceptance.limit.words())} (ISO 14253-1:2017)")
        if acceptance.doubts:
            out.print(f"  not a pass because of: {', '.join(acceptance.doubts)}")
        for x in acceptance.lengths:
            name = escape(f"{x.bar} {x.from_mark}-{x.to_mark}")
            out.print(
                f"  {name}: largest error {x.worst_error_mm:+.4f} mm ({escape(x.worst_pose)}), "
                f"U {x.expanded_uncertainty_mm:.4f} mm, limit {x.limit_mm:.4f} mm: {x.verdict}"
            )
    budget = max(procedure.budgets, key=lambda one: one.expanded_mm)
    shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in budget.shares()[:4])
    remedy = budget.remedy()
    out.print(
        f"Test value uncertainty U of {escape(budget.bar)} {budget.from_mark}-{budget.to_mark}: "
        f"{budget.expanded_mm:.4f} mm (k = {budget.coverage_factor:.2f}): {shares}. "
        f"To lessen it: {'' if remedy is None else phrase(remedy)}."
    )
    out.print(f"{procedure.title}. Departures:")
    for departure in procedure.departures:
        say(f"  - {phrase(departure)}")


def _accepted(verification: Verification) -> str | None:
    acceptance = None if verification.procedure is None else verification.procedure.acceptance
    return None if acceptance is None else acceptance.verdict
