"""`spherecal profile compare`: what has changed from one calibration to another."""

import argparse

import numpy as np
from numpy.typing import ArrayLike

from spherecal.files.json_file import finite
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE
from spherecal_rigs.compare_rigs import CameraChange, Comparison
from spherecal_rigs.compare_rigs import compare as run
from spherecal_rigs.rig_source import read_source, volume_of


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


def _compared(c: Comparison) -> dict[str, object]:
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
