"""`spherecal detect`."""

import argparse
import os
import sys
from pathlib import Path

from rich.markup import escape

from spherecal.base.messages.catalogue import phrase
from spherecal.data.findings import counted
from spherecal.files.target_set_file import read_target_set
from spherecal.targets.detect_images import detect_images
from spherecal.targets.why_nothing import why_nothing_in
from spherecal_app.cli.answer import answer
from spherecal_app.cli.compile_kernels import compile_first
from spherecal_app.cli.console import out
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.output import to_output
from spherecal_app.cli.progress import shown_progress


def detect(options: argparse.Namespace) -> int:
    """`spherecal detect`."""
    paths, target_set = [Path(image) for image in options.images], read_target_set(options.targets)
    with shown_progress() as context:
        compile_first(context)
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
