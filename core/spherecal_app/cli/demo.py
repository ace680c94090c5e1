"""`spherecal demo` and `simulate`."""

import argparse
import csv
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from rich.markup import escape

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.data.verdict_words import WORDS
from spherecal_app.cli.compile_kernels import demo_kernels
from spherecal_app.cli.console import answer, check_output_folder, out, say, shown_progress
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.main import main
from spherecal_app.cli.parsing import is_standard_output
from spherecal_files.atomic import SESSION
from spherecal_files.rig_file import read_rig
from spherecal_rigs.result_folder import read_bar_report
from spherecal_sim.render_session import demo_session, render_session
from spherecal_sim.simulate_session import simulate_session, write_session


def demo(options: argparse.Namespace) -> int:
    """`spherecal demo`: five lines on what was found, one more without a report; all that is said with --verbose."""
    folder: Path = options.output
    if is_standard_output(folder):
        raise InputError(Phrase("error-folder-to-output"))
    result = folder / "result"
    out.print("A simulated rig: six cameras, a ball at four places, two bars. The first run renders the images.")
    with shown_progress() as context, demo_kernels(context):
        session = demo_session(context)
    quiet = out.quiet
    steps = [["calibrate", session, "-o", result], ["verify", session, "--rig", result / "rig.json", "-o", result]]
    report = folder / "report.pdf" if find_spec("matplotlib") and find_spec("typst") else None
    if report is not None:
        steps.append(["report", result, "-o", report, "--session", session])
    for arguments in steps:
        line = [str(a) for a in arguments]
        if options.verbose:
            out.print(f"\n[bold]$ spherecal {escape(' '.join(line))}[/]")
        out.quiet = quiet or not options.verbose
        try:
            code = main(line)
        finally:
            out.quiet = quiet
        if code != DONE:
            return code
    record, lines = _found(result, folder, report)
    answer(options, record)
    for line in lines:
        say(line)
    return DONE


def _found(result: Path, folder: Path, report: Path | None) -> tuple[dict[str, object], list[str]]:
    """What the demo found: for programs, and in five lines; in one more why there is no report."""
    rig, bars = read_rig(result / "rig.json"), read_bar_report(result)
    quality = rig.quality
    sigmas = [np.linalg.norm(camera.sigma.centre_mm) for camera in rig.cameras if camera.sigma is not None]
    with (result / "spheres.csv").open(encoding="utf-8") as file:
        spheres = list(csv.DictReader(file))
    radius, out_of_round = (np.mean([float(one[key]) for one in spheres]) for key in ("radius_mm", "radial_sd_mm"))
    record = {
        "verdict": quality.verdict,
        "cameras": len(rig.cameras),
        "rms_px": quality.rms_px,
        "largest_centre_sd_mm": max(sigmas, default=None),
        "ball": {"radius_mm": radius, "radial_sd_mm": out_of_round},
        "bars": bars and {"verdict": bars.verdict, "n": bars.n, "max_abs_error_mm": bars.max_abs_error_mm},
        "folder": folder,
        "report": report,
    }
    lines = [f"{WORDS[quality.verdict]}: {counted(len(rig.cameras), 'camera')} placed, rms {quality.rms_px:.4f} px."]
    if sigmas:
        lines.append(f"Cameras: standard deviation of their centres at most {max(sigmas):.3f} mm.")
    lines.append(f"Ball: radius {radius:.3f} mm, out of round by {out_of_round:.3f} mm.")
    if bars is not None and bars.max_abs_error_mm is not None:
        largest = f"largest error {bars.max_abs_error_mm:.4f} mm"
        lines.append(f"{bars.verdict.upper()}: {counted(bars.n, 'length')} of a bar, {largest}.")
    if report is None:
        lines.append("The report was left out, since it needs matplotlib and typst: pip install matplotlib typst")
    made = "Result" if report is None else "Report and result"
    return record, [*lines, f"{made} in {folder}. Details: spherecal demo --verbose."]


def simulate(options: argparse.Namespace) -> int:
    """`spherecal simulate`."""
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
