"""`spherecal ball export|show`: the shape of a ball, kept for later calibrations."""

import argparse
from collections.abc import Callable
from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted

if TYPE_CHECKING:
    from spherecal.files.ball_file import BallProfile


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The command's actions and their options."""
    ball = add("ball", "Ball profiles: the shape of your ball, so that later calibrations need fewer placements.")
    actions = ball.add_subparsers(dest="action", required=True, metavar="ACTION")
    text = "Keep the ball's shape that a calibration found (form rigid), for `calibrate --ball`."
    export = actions.add_parser("export", help=text, description=text)
    export.add_argument("result", type=Path, metavar="RESULT", help="the result folder")
    export.add_argument(
        "-o", "--output", type=Path, required=True, metavar="ball.json", help="the ball profile to write"
    )
    export.add_argument("--name", default="", help="such as the ball's serial number")
    export.add_argument("--date", type=_date, metavar="YYYY-MM-DD", help="of the calibration (default: rig.json's own)")
    export.add_argument("--session", type=Path, metavar="SESSION", help="its targets are then checked at every use")
    text = "What a ball profile holds."
    show = actions.add_parser("show", help=text, description=text)
    show.add_argument("ball", type=Path, metavar="ball.json", help="the ball profile, or a result folder")


def _date(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError("a date is written as 2026-05-31") from None


def ball(options: argparse.Namespace) -> int:
    """`spherecal ball`."""
    from spherecal.cli.main import DONE

    {"export": _export, "show": _show}[options.action](options)
    return DONE


def _export(options: argparse.Namespace) -> None:
    from dataclasses import replace

    from spherecal.base.errors import InputError
    from spherecal.cli.parsing import to_output
    from spherecal.files.ball_file import BALL_FILE, ball_bytes, read_ball
    from spherecal.files.read_session import read_session
    from spherecal.files.rig_file import read_rig

    rig_path = options.result / "rig.json"
    rig = read_rig(rig_path)
    if not rig.quality.valid:
        raise InputError(Phrase("error-ball-not-valid", {"folder": options.result}))
    if not (options.result / BALL_FILE).is_file():
        if rig.form is None:
            raise InputError(Phrase("error-no-ball-shape", {"folder": options.result}))
        values = {"folder": options.result, "form": rig.form.name, "scale": rig.scale.source}
        raise InputError(Phrase("error-no-ball-shape-form", values))
    profile = read_ball(options.result)
    if profile.input_sha256 != rig.input_sha256:
        raise InputError(Phrase("error-other-ball", {"folder": options.result, "file": BALL_FILE}))
    made = datetime.fromtimestamp(rig_path.stat().st_mtime, UTC).date()
    profile = replace(profile, name=options.name, calibrated=options.date or made)
    if options.session is not None:
        targets = read_session(options.session).target_set
        if targets is not None:
            profile = replace(profile, family=targets.family, target_size_mm=targets.size_mm)
    to_output(options.output, ball_bytes(profile))
    _say(options, profile, options.output)


def _show(options: argparse.Namespace) -> None:
    from spherecal.files.ball_file import read_ball

    _say(options, read_ball(options.ball), options.ball)


def _say(options: argparse.Namespace, profile: "BallProfile", path: Path) -> None:
    import numpy as np

    from spherecal.cli.answer import answer
    from spherecal.cli.commands import out
    from spherecal.geometry.sphere import fit_sphere

    shape = profile.shape
    sd = np.sqrt(np.einsum("dii->d", shape.covariance_mm2) / 3)
    sphere = fit_sphere(shape.places_mm)
    name = profile.name or "The ball"
    size_ppm = 1e6 * (shape.scale.relative_uncertainty or 0.0)
    day = "" if profile.calibrated is None else f", calibrated on {profile.calibrated.isoformat()}"
    record = {
        "file": path,
        "name": profile.name,
        "calibrated": profile.calibrated,
        "dots": len(sd),
        "targets": len(np.unique(shape.target)),
        "sd_mm": np.median(sd),
        "scale": shape.scale,
        "radius_mm": sphere and sphere.radius,
        "radial_sd_mm": sphere and sphere.radial_sd,
    }
    answer(options, record)
    out.print(
        f"{name}: {counted(len(sd), 'dot')} of {counted(len(np.unique(shape.target)), 'target')}{day}; "
        f"standard uncertainty of a dot {np.median(sd):.4f} mm per coordinate (median), of the size "
        f"{size_ppm:.0f} ppm, from {shape.scale.source}.",
        markup=False,
    )
    if sphere is not None:
        out.print(f"Radius {sphere.radius:.3f} mm, out of round by {sphere.radial_sd:.3f} mm.", markup=False)
    out.print(f"Ball profile in {path}.", markup=False)
