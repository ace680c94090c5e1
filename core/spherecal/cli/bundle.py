"""`spherecal support-bundle`: what to send when something is wrong."""

import argparse
from collections.abc import Callable
from pathlib import Path

from spherecal.data.findings import counted


def add_parsers(add: Callable[[str, str], argparse.ArgumentParser]) -> None:
    """The command's options."""
    bundle = add(
        "support-bundle",
        "Pack a session's observations, settings, result, logs and versions into one file; no images unless asked. "
        "Names of people and computers and serial numbers are replaced. `spherecal calibrate BUNDLE.zip` gives "
        "the same numbers, with --names the same bits.",
    )
    bundle.add_argument("session", type=Path, metavar="SESSION", help="the session folder")
    bundle.add_argument("-o", "--output", type=Path, required=True, metavar="BUNDLE.zip", help="the file to write")
    bundle.add_argument("--result", type=Path, metavar="RESULT", help="the result to send along")
    bundle.add_argument("--settings", type=Path, metavar="FILE", help="the cameras.json with the cameras' settings")
    bundle.add_argument(
        "--log-file", type=Path, action="append", default=[], metavar="FILE", help="a log to send along"
    )
    bundle.add_argument("--images", action="store_true", help="the images too")
    bundle.add_argument(
        "--names", action="store_true", help="leave names of people and computers and serial numbers as they are"
    )
    bundle.add_argument(
        "--method",
        choices=("auto", "tao2021", "free", "rigid", "board", "bar"),
        default="auto",
        help="the method that was used, for a session of images (default auto)",
    )


def support_bundle(options: argparse.Namespace) -> int:
    """`spherecal support-bundle`."""
    from spherecal.cli.answer import answer
    from spherecal.cli.commands import out
    from spherecal.cli.main import DONE
    from spherecal.cli.parsing import output_file
    from spherecal.cli.progress import shown_progress
    from spherecal.methods.settings import CalibrationSettings
    from spherecal.support.bundle import BundleContents, BundleOptions, write_bundle

    wanted = BundleOptions(
        options.result,
        options.settings,
        tuple(options.log_file),
        options.images,
        CalibrationSettings(method=options.method),
        options.names,
    )

    def announce(contents: BundleContents) -> None:
        answer(options, {"output": options.output, "files": contents.files, "replaced": contents.redacted})
        out.print(f"{counted(len(contents.files), 'file goes', 'files go')} into {options.output}:", markup=False)
        for name, size in contents.files.items():
            out.print(f"  {name}  {size} bytes", markup=False)
        out.print(f"Replaced in them: {'; '.join(contents.redacted)}.", markup=False)

    with shown_progress() as context, output_file(options.output) as place:
        write_bundle(options.session, place, wanted, context, announce)
    out.print(f"Written: {options.output}", markup=False)
    if not options.images:
        out.print("It holds no images.")
    return DONE
