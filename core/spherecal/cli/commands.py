"""What each command does: read, call the engine's one entry point, write, say what came out."""

import argparse
import os
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import language, phrase
from spherecal.base.messages.values import Phrase
from spherecal.cli.about import completion, licences, manual  # noqa: F401
from spherecal.cli.answer import answer
from spherecal.cli.ball import ball  # noqa: F401
from spherecal.cli.bars import bars  # noqa: F401
from spherecal.cli.batch import batch  # noqa: F401
from spherecal.cli.bundle import support_bundle  # noqa: F401
from spherecal.cli.check import check  # noqa: F401
from spherecal.cli.compile_kernels import compile_kernels  # noqa: F401
from spherecal.cli.demo import demo  # noqa: F401
from spherecal.cli.export import export, import_priors, import_rig  # noqa: F401 (the command line finds them here)
from spherecal.cli.frame import frame  # noqa: F401
from spherecal.cli.limits import limits  # noqa: F401
from spherecal.cli.main import DONE, NOT_VALID
from spherecal.cli.measure import measure  # noqa: F401
from spherecal.cli.network_commands import cross_validate, guide, recalibrate  # noqa: F401
from spherecal.cli.parsing import check_output_folder, output_file, to_output
from spherecal.cli.profile import profile  # noqa: F401
from spherecal.cli.progress import log, shown_progress
from spherecal.cli.search import search_of
from spherecal.cli.session import session  # noqa: F401
from spherecal.cli.study import study  # noqa: F401
from spherecal.data.findings import Finding, counted
from spherecal.data.rig import Calibration
from spherecal.data.verdict import WORDS, named
from spherecal.files.atomic import RESULT, SESSION
from spherecal.files.findings_file import FINDING
from spherecal.files.read_session import read_session
from spherecal.files.rig_file import affected_entries, read_rig
from spherecal.targets.target_set import TargetSet
from spherecal.verify.verification import Verification


# a pipe has no width of its own: tables in a log file are not folded at 80 columns
class _Output(Console):
    """Standard output as a console; where whoever read it has had enough, the command goes on and its code is true."""

    def on_broken_pipe(self) -> None:
        self.quiet = True
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


out = _Output(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 140)


def calibrate(options: argparse.Namespace) -> int:
    """`spherecal calibrate`."""
    from spherecal.calibrate import calibrate as run
    from spherecal.data.edits import Repairs
    from spherecal.files.ball_file import read_ball
    from spherecal.files.write_result import write_result
    from spherecal.initialise.view_graph import EdgeWeights
    from spherecal.methods.settings import CalibrationSettings
    from spherecal.support.bundle import session_of

    _check_forms(options)
    check_output_folder(options.output, RESULT)
    settings = CalibrationSettings(
        method=options.method,
        search=search_of(options),
        spherical_projection=not options.no_spo,
        joint=not options.no_joint,
        weights=EdgeWeights(options.path_weights[0], options.path_weights[1], options.path_error),
        base=options.path_base,
        intrinsics=options.intrinsics,
        own_intrinsics=options.own_intrinsics,
        lens=options.lens,
        seed=options.seed,
        reference=options.reference,
        repairs=Repairs(tuple(options.leave_out), tuple(options.split), tuple(options.swap)),
        shape_sd_mm=options.shape_sd,
        ball=None if options.ball is None else read_ball(options.ball),
        repair_by_itself=not options.no_repair,
    )
    began = time.perf_counter()
    with shown_progress() as context:
        context.report("reading the session", 0.0)
        with session_of(options.session) as folder:
            calibration = run(read_session(folder), settings, context)
        context.report("writing the result", 0.0)
        write_result(calibration, options.output, {"method": calibration.method, "seed": options.seed})
    _log_findings(calibration.rig.quality.findings)
    answer(options, calibration_summary(calibration))
    show_calibration(calibration, options.output, time.perf_counter() - began)
    return DONE if calibration.rig.quality.valid else NOT_VALID


def _check_forms(options: argparse.Namespace) -> None:
    """Raise InputError for options that do not go with the method."""
    if options.ball is not None and options.method not in ("auto", "rigid"):
        raise InputError(Phrase("error-ball-method", {"method": options.method}))
    if options.shape_sd is not None and (options.method != "soft" or not 0 < options.shape_sd < 10):
        key = "error-shape-sd-method" if options.method != "soft" else "error-shape-sd-range"
        raise InputError(Phrase(key, {"value": options.shape_sd}))


def verify(options: argparse.Namespace) -> int:
    """`spherecal verify`."""
    from spherecal.detect.session_images import observed
    from spherecal.profile.source import corners_beside
    from spherecal.verify.bars import VerifySettings
    from spherecal.verify.bars import verify as run
    from spherecal.verify.limit import parse_limit
    from spherecal.verify.write_verification import write_verification

    limit = None if options.limit is None else parse_limit(options.limit)
    check_output_folder(options.output, RESULT)
    with shown_progress() as context:
        context.report("reading the session", 0.0)
        rig = read_rig(options.rig)
        session = observed(read_session(options.session), context, bar_poses_only=True)
        verification = run(session, rig, context, VerifySettings(limit, None, corners_beside(options.rig)))
        write_verification(verification, options.output, options.rig)
    _log_findings(verification.findings)
    answer(options, _verification_summary(verification))
    show_verification(verification, options.output)
    return NOT_VALID if verification.failed else DONE


def simulate(options: argparse.Namespace) -> int:
    """`spherecal simulate`."""
    from spherecal_sim.render_session import render_session
    from spherecal_sim.session import simulate_session
    from spherecal_sim.session_folder import write_session

    check_output_folder(options.output, SESSION)
    with shown_progress() as context:
        if options.observations_only:
            context.report("simulating", 0.0)
            session, truth = simulate_session(options.preset, options.seed)
            write_session(session, truth, options.output)
        else:
            truth = render_session(options.preset, options.seed, options.output, context)
    record = {
        "session": options.output,
        "preset": options.preset,
        "cameras": [camera.id for camera in truth.cameras],
        "placements": truth.placements,
        "bar_poses": [pose.id for pose in truth.bar_poses],
    }
    answer(options, record)
    out.print(
        f"Simulated {options.preset}: {counted(len(truth.cameras), 'camera')}, "
        f"{counted(len(truth.placements), 'placement')}, {counted(len(truth.bar_poses), 'bar pose')}, in "
        f"{escape(str(options.output))}."
    )
    return DONE


def detect(options: argparse.Namespace) -> int:
    """`spherecal detect`."""
    from spherecal.files.target_set_file import read_target_set
    from spherecal.targets.detect_images import detect_images
    from spherecal.targets.why_nothing import why_nothing_in

    paths, target_set = [Path(image) for image in options.images], read_target_set(options.targets)
    with shown_progress() as context:
        found = detect_images(paths, target_set, context, os.cpu_count() or 1)
    lines = ["image,target,point,u,v"]
    for image, dots in zip(options.images, found, strict=True):
        name = '"' + image.replace('"', '""') + '"' if any(c in image for c in ',"\n\r') else image
        lines += [
            f"{name},{target},{dots.points[point]},{u:.5f},{v:.5f}"
            for target, point, (u, v) in zip(dots.target, dots.point, dots.uv, strict=True)
        ]
    to_output(options.csv, ("\n".join(lines) + "\n").encode())
    targets_found = sum(len(dots.target_ids) for dots in found)
    out.print(
        f"{counted(targets_found, 'target')} in {counted(len(found), 'image')}, {counted(len(lines) - 1, 'dot')} in "
        f"{escape(str(options.csv))}."
    )
    record = [
        {"image": image, "targets": len(dots.target_ids), "dots": len(dots.target)}
        for image, dots in zip(options.images, found, strict=True)
    ]
    answer(options, {"output": options.csv, "images": record})
    if not targets_found:
        cause = why_nothing_in(paths, target_set)
        seen, remedy = phrase(cause.seen), phrase(cause.remedy)
        print(f"No target was found. Of one image looked at: {seen}. {remedy}", file=sys.stderr)
    return DONE


def targets(options: argparse.Namespace) -> int:
    """`spherecal targets export` and `spherecal targets sheet`."""
    from spherecal.targets.family import make_target_set
    from spherecal.targets.sheet import scaled, write_sheet

    if options.kind == "sheet" and options.board is not None:
        from spherecal.uses.use_cases import write_board_sheet

        with output_file(options.output) as place:
            drawn = write_board_sheet(options.board, place, options.page)
        answer(options, {"output": options.output, "board": drawn})
        out.print(f"Board in {options.output}: --board {drawn}", markup=False)
        return DONE
    if options.markers is not None:
        made = _markers(options)
    else:
        count = 200 if options.count is None else options.count
        first = 1 if options.first_id is None else options.first_id
        made = make_target_set(count, options.size, options.polarity or "light-on-dark", first)
    if options.measured:
        made = scaled(made, *options.measured)
    with output_file(options.output) as place:
        if options.kind == "sheet":
            write_sheet(place, made, options.page)
        else:
            from spherecal.files.target_set_file import write_target_set

            write_target_set(place, made)
    answer(
        options, {"output": options.output, "family": made.family, "size_mm": made.size_mm, "ids": list(made.layouts)}
    )
    out.print(f"{counted(len(made.layouts), 'target')} in {escape(str(options.output))}.")
    return DONE


def _markers(options: argparse.Namespace) -> TargetSet:
    """The markers that `--markers` names: from the first id, as many as asked for."""
    from spherecal.targets.marker_set import make_marker_set, marker_count

    first = options.first_id or 0
    count = marker_count(options.markers) - first if options.count is None else options.count
    ids = range(first, first + count)
    return make_marker_set(options.markers, options.size, ids, options.polarity or "dark-on-light")


def report(options: argparse.Namespace) -> int:
    """`spherecal report`."""
    from spherecal.report.write_report import write_report
    from spherecal_scene.picture import scene_picture

    o = options
    with shown_progress() as context:
        context.report("drawing the report", 0.0)
        write_report(o.result, o.output, o.session, o.page, o.issuer, o.language, render=scene_picture)
    answer(options, {"output": options.output})
    out.print(f"Report in {options.output}.", markup=False)
    return DONE


def doctor(options: argparse.Namespace) -> int:
    """`spherecal doctor`: 3 where something is missing that the program needs."""
    from spherecal.cli.doctor import examine

    table, found = Table("", "what", "found", box=None), tuple(examine())
    code = NOT_VALID if any(one.state == "missing" for one in found) else DONE
    answer(options, [{"what": one.name, "state": one.state, "found": one.found} for one in found])
    for one in found:
        mark = {"ok": "[green]ok[/]", "missing": "[red]missing[/]", "optional": "[yellow]optional[/]"}[one.state]
        table.add_row(mark, one.name, escape(one.found))
    out.print(table)
    return code


def show_calibration(calibration: Calibration, folder: Path, seconds: float) -> None:
    """The result in words and a table, verdict first."""
    rig = calibration.rig
    quality = rig.quality
    colour = {"valid": "bold green", "use-with-care": "bold yellow", "not-valid": "bold red"}[quality.verdict]
    word, cameras = f"[{colour}]{WORDS[quality.verdict]}[/]", len(calibration.observations.cameras)
    out.print(f"{word}: {len(rig.cameras)} of {counted(cameras, 'camera')} placed", end="")
    out.print("" if quality.rms_px is None else f", rms {quality.rms_px:.4f} px, {seconds:.1f} s.")
    if quality.verdict == "use-with-care":
        out.print(f"With care: {named(quality.affected)}.", markup=False)
    if rig.cameras:
        table = Table("camera", box=None)
        for heading in ("points", "rms px", "f px", "sd f px", "sd centre mm", "sd rotation deg"):
            table.add_column(heading, justify="right")
        for c in rig.cameras:
            sd = (
                ("-", "-", "-")
                if c.sigma is None
                else (
                    f"{c.sigma.intrinsics[0]:.2f}",
                    f"{np.linalg.norm(c.sigma.centre_mm):.3f}",
                    f"{np.linalg.norm(c.sigma.rotation_deg):.4f}",
                )
            )
            name = f"{c.id} (reference)" if c.id == rig.reference_camera else c.id
            table.add_row(escape(name), str(c.observations), _number(c.rms_px, 4), f"{c.intrinsics[0]:.2f}", *sd)
        out.print(table)
    for sphere in calibration.spheres:
        out.print(
            f"  ball at {escape(sphere.placement)}: radius {sphere.radius_mm:.3f} mm, "
            f"out of round by {sphere.radial_sd_mm:.3f} mm"
        )
    show_findings(quality.findings)
    out.print(f"Result in {escape(str(folder))}.")


def show_verification(verification: Verification, folder: Path) -> None:
    """The verification in words and a table, verdict first."""
    word = {"consistent": "[bold green]CONSISTENT[/]", "inconsistent": "[bold red]INCONSISTENT[/]"}
    out.print(
        f"{word.get(verification.decision.verdict, '[bold yellow]NO DATA[/]')}: {phrase(verification.decision.rule)}"
    )
    table = Table("length", box=None)
    for heading in ("n", "mean error mm", "sd mm", "max mm", "U mm", "k"):
        table.add_column(heading, justify="right")
    for length in verification.lengths:
        table.add_row(
            escape(f"{length.bar} {length.from_mark}-{length.to_mark}"),
            str(length.n),
            _number(length.mean_error_mm, 4),
            _number(length.sd_mm, 4),
            _number(length.max_abs_error_mm, 4),
            _number(length.expanded_uncertainty_mm, 4),
            _number(length.coverage_factor, 2),
        )
    out.print(table)
    overall = verification.overall
    out.print(
        f"{counted(overall.n, 'length')}: mean error {_number(overall.mean_error_mm, 4)} mm, "
        f"sd {_number(overall.sd_mm, 4)} mm, largest {_number(overall.max_abs_error_mm, 4)} mm."
    )
    show_cameras_verified(verification)
    show_procedure(verification)
    show_findings(verification.findings)
    out.print(f"Result in {escape(str(folder))}.")


def show_cameras_verified(verification: Verification) -> None:
    """How many views of the marks each camera had, and how they fit."""
    if not verification.cameras or not verification.measured:
        return
    table = Table("camera", box=None)
    for heading in ("views of marks", "used", "rms px"):
        table.add_column(heading, justify="right")
    table.add_column("")
    colour = {"verified": "green", "not seen": "yellow", "rejected": "bold red"}
    for c in verification.cameras:
        rms = _number(c.rms_px, 4)
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
        out.print(f"[{colour}]{word}[/] against {escape(acceptance.limit.words())} (ISO 14253-1)")
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
        f"U of one {escape(budget.bar)} {budget.from_mark}-{budget.to_mark}: {budget.expanded_mm:.4f} mm "
        f"(k = {budget.coverage_factor:.2f}): {shares}. To lessen it: {'' if remedy is None else phrase(remedy)}."
    )
    out.print(f"{procedure.title}. Departures:")
    for departure in procedure.departures:
        out.print(f"  - {phrase(departure)}", markup=False)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None or not np.isfinite(value) else f"{value:.{digits}f}"


def show_findings(findings: tuple[Finding, ...]) -> None:
    """Each with its severity in colour."""
    colour = {"error": "red", "warning": "yellow", "info": "blue"}
    for finding in findings:
        out.print(f"[{colour[finding.severity]}]{finding.severity}[/] {finding.code}: ", end="")
        message, hint = (finding.words(part, language()) for part in ("message", "hint"))
        out.print(f"{message} {hint}".strip(), markup=False)


def _log_findings(findings: tuple[Finding, ...]) -> None:
    for finding in findings:
        log.info("finding: %s %s: %s", finding.severity, finding.code, finding.message)


def calibration_summary(calibration: Calibration) -> dict[str, object]:
    """What `--json` tells of a calibration."""
    rig = calibration.rig
    return {
        "valid": rig.quality.valid,
        "verdict": rig.quality.verdict,
        "affected": affected_entries(rig.quality),
        "repairs": [{"option": r.option, "value": r.value, "automatic": r.automatic} for r in rig.repairs],
        "method": calibration.method,
        "cameras": len(rig.cameras),
        "cameras_in_session": len(calibration.observations.cameras),
        "rms_px": rig.quality.rms_px,
        "mean_px": rig.quality.mean_px,
        "sigma0": rig.quality.sigma0,
        "form": rig.form
        and {
            "name": rig.form.name,
            "reason": rig.form.reason,
            "shape_sd_mm": rig.form.shape_sd_mm,
            "stated": rig.form.stated,
        },
        "scale": {"source": rig.scale.source, "relative_uncertainty": rig.scale.relative_uncertainty},
        "seconds": {stage: round(seconds, 4) for stage, seconds in calibration.seconds.items()},
        "findings": [FINDING.entry(finding) for finding in rig.quality.findings],
    }


def _verification_summary(verification: Verification) -> dict[str, object]:
    return {
        "verdict": verification.decision.verdict,
        "n": verification.overall.n,
        "mean_error_mm": verification.overall.mean_error_mm,
        "sd_mm": verification.overall.sd_mm,
        "max_abs_error_mm": verification.overall.max_abs_error_mm,
        "acceptance": _accepted(verification),
        "cameras": {c.id: c.state for c in verification.cameras},
        "findings": [FINDING.entry(finding) for finding in verification.findings],
    }


def _accepted(verification: Verification) -> str | None:
    acceptance = None if verification.procedure is None else verification.procedure.acceptance
    return None if acceptance is None else acceptance.verdict


globals()["import"] = import_rig  # the command's name is a keyword of Python
