"""`spherecal ball export|show`: the shape of a ball, kept for later calibrations."""

import argparse
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import counted
from spherecal.data.rig import BallProfile
from spherecal.geometry.sphere import fit_sphere
from spherecal_app.cli.console import answer, say, to_output
from spherecal_app.cli.exit_codes import DONE
from spherecal_files.ball_file import BALL, BALL_FILE, read_ball
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig


def export(options: argparse.Namespace) -> int:
    """`spherecal ball export`."""
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
    to_output(options.output, BALL.bytes(profile))
    _say(options, profile, options.output)
    return DONE


def show(options: argparse.Namespace) -> int:
    """`spherecal ball show`."""
    _say(options, read_ball(options.ball), options.ball)
    return DONE


def _say(options: argparse.Namespace, profile: BallProfile, path: Path) -> None:
    shape = profile.shape
    sd = np.sqrt(np.einsum("dii->d", shape.covariance_mm2) / 3)
    sphere = fit_sphere(shape.places_mm)
    name = profile.name or "The ball"
    size_ppm = 1e6 * (shape.scale.relative_uncertainty or 0.0)
    day = "" if profile.calibrated is None else f", calibrated on {profile.calibrated.isoformat()}"
    record = {
        "file": path, "name": profile.name, "calibrated": profile.calibrated, "dots": len(sd),
        "targets": len(np.unique(shape.target)), "sd_mm": np.median(sd), "scale": shape.scale,
        "radius_mm": sphere and sphere.radius, "radial_sd_mm": sphere and sphere.radial_sd,
    }  # fmt: skip
    answer(options, record)
    say(
        f"{name}: {counted(len(sd), 'dot')} of {counted(len(np.unique(shape.target)), 'target')}{day}; "
        f"standard uncertainty of a dot {np.median(sd):.4f} mm per coordinate (median), of the size "
        f"{size_ppm:.0f} ppm, from {shape.scale.source}."
    )
    if sphere is not None:
        say(f"Radius {sphere.radius:.3f} mm, out of round by {sphere.radial_sd:.3f} mm.")
    say(f"Ball profile in {path}.")
