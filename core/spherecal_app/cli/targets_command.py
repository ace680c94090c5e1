"""`spherecal targets export|sheet` and `spherecal detect`."""

import argparse
import os
import sys
from pathlib import Path

from rich.markup import escape

from spherecal.base.messages.catalogue import phrase
from spherecal.data.findings import counted
from spherecal.targets.detect_images import detect_images
from spherecal.targets.family import make_target_set
from spherecal.targets.target_set import TargetSet
from spherecal.targets.why_nothing import why_nothing_in
from spherecal_app.cli.compile_kernels import compile_first
from spherecal_app.cli.console import answer, out, output_file, say, shown_progress, to_output
from spherecal_app.cli.exit_codes import DONE
from spherecal_documents.sheets.sticker_sheet import scaled, write_sheet
from spherecal_files.target_set_file import make_marker_set, marker_count, read_target_set, write_target_set


def export(options: argparse.Namespace) -> int:
    """`spherecal targets export`."""
    made = _wanted(options)
    with output_file(options.output) as place:
        write_target_set(place, made)
    return _done(options, made)


def sheet(options: argparse.Namespace) -> int:
    """`spherecal targets sheet`."""
    if options.board is not None:
        from spherecal_app.api import write_board_sheet  # here, since it loads the whole engine

        with output_file(options.output) as place:
            drawn = write_board_sheet(options.board, place, options.page)
        answer(options, {"output": options.output, "board": drawn})
        say(f"Board in {options.output}: --board {drawn}")
        return DONE
    made = _wanted(options)
    with output_file(options.output) as place:
        write_sheet(place, made, options.page)
    return _done(options, made)


def _wanted(options: argparse.Namespace) -> TargetSet:
    """The targets or markers that were asked for, in the size that the printed rulers have."""
    if options.markers is not None:
        first_marker = options.first_id or 0
        many = marker_count(options.markers) - first_marker if options.count is None else options.count
        ids = range(first_marker, first_marker + many)
        made = make_marker_set(options.markers, options.size, ids, options.polarity or "dark-on-light")
    else:
        count = 200 if options.count is None else options.count
        first = 1 if options.first_id is None else options.first_id
        made = make_target_set(count, options.size, options.polarity or "light-on-dark", first)
    return scaled(made, *options.measured) if options.measured else made


def _done(options: argparse.Namespace, made: TargetSet) -> int:
    """Say what was written."""
    record = {"output": options.output, "family": made.family, "size_mm": made.size_mm, "ids": list(made.layouts)}
    answer(options, record)
    out.print(f"{counted(len(made.layouts), 'target')} in {escape(str(options.output))}.")
    return DONE


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
