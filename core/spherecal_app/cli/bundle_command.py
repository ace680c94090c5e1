"""`spherecal support-bundle`: what to send when something is wrong."""

import argparse

from spherecal.data.findings import counted
from spherecal.steps.settings import CalibrationSettings
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import out, say
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.output import output_file
from spherecal_app.cli.progress import shown_progress
from spherecal_documents.support.support_bundle import BundleContents, BundleOptions, write_bundle


def support_bundle(options: argparse.Namespace) -> int:
    """`spherecal support-bundle`."""
    wanted = BundleOptions(
        options.result,
        options.settings,
        tuple(options.log_file),
        options.images,
        CalibrationSettings(method=options.method),
        options.names,
    )

    def announce(contents: BundleContents) -> None:
        answer(
            options,
            {"output": options.output, "files": contents.files, "replaced": contents.redacted, "names": contents.names},
        )
        say(f"{counted(len(contents.files), 'file goes', 'files go')} into {options.output}:")
        for name, size in contents.files.items():
            say(f"  {name}  {size} bytes")
        say(f"Replaced in them: {'; '.join(contents.redacted)}.", *(f"  {name}" for name in contents.names))

    with shown_progress() as context, output_file(options.output) as place:
        write_bundle(options.session, place, wanted, context, announce)
    say(f"Written: {options.output}")
    if not options.images:
        out.print("It holds no images.")
    return DONE
