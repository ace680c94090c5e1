"""`spherecal calibrate`; what a calibration says, which `recalibrate` says too."""

import argparse
import time
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import numpy as np
from rich.markup import escape

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.calibrate import calibrate as run
from spherecal.data.findings import counted
from spherecal.data.rig import Calibration
from spherecal.data.verdict_words import WORDS, named
from spherecal.initialise.view_graph import EdgeWeights
from spherecal.steps.repairs import Repairs
from spherecal.steps.settings import CalibrationSettings
from spherecal_app.cli import console
from spherecal_app.cli.compile_kernels import compile_first
from spherecal_app.cli.console import shown_progress
from spherecal_app.cli.exit_codes import DONE, NOT_VALID
from spherecal_app.cli.options import search_of
from spherecal_files.atomic import RESULT
from spherecal_files.ball_file import read_ball
from spherecal_files.findings_file import FINDING
from spherecal_files.json_file import plain_fields
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import affected_entries
from spherecal_files.write_result import write_result


def calibrate(options: argparse.Namespace) -> int:
    """`spherecal calibrate`."""
    if options.ball is not None and options.method not in ("auto", "rigid"):
        raise InputError(Phrase("error-ball-method", {"method": options.method}))
    if options.shape_sd is not None and (options.method != "soft" or not 0 < options.shape_sd < 10):
        key = "error-shape-sd-method" if options.method != "soft" else "error-shape-sd-range"
        raise InputError(Phrase(key, {"value": options.shape_sd}))
    console.check_output_folder(options.output, RESULT)
    xi1, xi2 = options.path_weights
    settings = CalibrationSettings(
        method=options.method,
        search=search_of(options),
        spherical_projection=not options.no_spo,
        joint=not options.no_joint,
        weights=EdgeWeights(xi1, xi2, options.path_error),
        base=options.path_base,
        th_pt=options.th_pt,
        damping=options.damping,
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
        with _session_of(options.session) as folder:
            session = read_session(folder)
            compile_first(context)
            calibration = run(session, settings, context)
        context.report("writing the result", 0.0)
        write_result(calibration, options.output, {"method": calibration.method, "seed": options.seed})
    console.log_findings(calibration.rig.quality.findings)
    console.answer(options, calibration_summary(calibration))
    show_calibration(calibration, options.output, time.perf_counter() - began)
    return DONE if calibration.rig.quality.valid else NOT_VALID


def _session_of(path: Path) -> AbstractContextManager[Path]:
    """The session folder at `path`, or that inside a support bundle, which few commands need to know of."""
    if path.is_dir() or path.suffix.lower() != ".zip":
        return nullcontext(path)
    from spherecal_documents.support.support_bundle import unpacked_session

    return unpacked_session(path)


def show_calibration(calibration: Calibration, folder: Path, seconds: float) -> None:
    """Print the result in words and a table, verdict first."""
    rig = calibration.rig
    quality = rig.quality
    colour = {"valid": "bold green", "use-with-care": "bold yellow", "not-valid": "bold red"}[quality.verdict]
    word, cameras = f"[{colour}]{WORDS[quality.verdict]}[/]", len(calibration.observations.cameras)
    console.out.print(f"{word}: {len(rig.cameras)} of {counted(cameras, 'camera')} placed", end="")
    console.out.print("" if quality.rms_px is None else f", rms {quality.rms_px:.4f} px, {seconds:.1f} s.")
    if quality.verdict == "use-with-care":
        console.say(f"With care: {named(quality.affected)}.")
    if rig.cameras:
        table = console.figures("camera", "points", "rms px", "f px", "sd f px", "sd centre mm", "sd rotation deg")
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
            table.add_row(escape(name), str(c.observations), console.number(c.rms_px, 4), f"{c.intrinsics[0]:.2f}", *sd)
        console.out.print(table)
    for sphere in calibration.spheres:
        console.out.print(
            f"  ball at {escape(sphere.placement)}: radius {sphere.radius_mm:.3f} mm, "
            f"out of round by {sphere.radial_sd_mm:.3f} mm"
        )
    console.show_findings(quality.findings)
    console.out.print(f"Result in {escape(str(folder))}.")


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
        **plain_fields(rig.quality, "rms_px mean_px sigma0"),
        "form": rig.form and plain_fields(rig.form, "name reason shape_sd_mm stated"),
        "scale": plain_fields(rig.scale, "source relative_uncertainty"),
        "seconds": {stage: round(seconds, 4) for stage, seconds in calibration.seconds.items()},
        "findings": [FINDING.entry(finding) for finding in rig.quality.findings],
    }
