"""`spherecal report`, `support-bundle`, `licences` and `manual`."""

import argparse
import webbrowser
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.resources import resource_path
from spherecal_app.cli.console import answer, out, output_file, say, shown_progress, to_output
from spherecal_app.cli.exit_codes import DONE
from spherecal_documents.scene.renderer import PictureProcess, can_render
from spherecal_documents.support.licences import bill_of_materials, licence_text, parts


def report(options: argparse.Namespace) -> int:
    """`spherecal report`."""
    o = options
    with ExitStack() as end, shown_progress() as context:
        context.report("drawing the report", 0.0)
        shown = can_render() and o.output.suffix.lower() not in (".json", ".xml")
        process = end.enter_context(PictureProcess()) if shown else None
        # not before the process: it loads VTK while we load matplotlib and scipy
        from spherecal_documents.report.write_report import write_report
        from spherecal_documents.scene.picture import scene_picture

        render = partial(scene_picture, process=process)
        write_report(o.result, o.output, o.session, o.page, o.issuer, o.language, render=render)
    answer(options, {"output": options.output})
    say(f"Report in {options.output}.")
    return DONE


def support_bundle(options: argparse.Namespace) -> int:
    """`spherecal support-bundle`."""
    from spherecal.data.findings import counted  # not with a report, which would wait for it
    from spherecal.steps.settings import CalibrationSettings
    from spherecal_documents.support.support_bundle import BundleContents, BundleOptions, write_bundle

    wanted = BundleOptions(
        options.result, options.settings, tuple(options.log_file), options.images,
        CalibrationSettings(method=options.method), options.names,
    )  # fmt: skip

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


def licences(options: argparse.Namespace) -> int:
    """`spherecal licences`."""
    found = parts()
    answer(options, [{"name": part.name, "version": part.version, "licence": part.licence} for part in found])
    if options.texts is not None:
        to_output(options.texts, licence_text().encode())
        say(f"Licence texts in {options.texts}.")
    if options.sbom is not None:
        to_output(options.sbom, bill_of_materials())
        say(f"Bill of materials in {options.sbom}.")
    if options.texts is None and options.sbom is None:
        for part in found:
            say(f"{part.name} {part.version}: {part.licence}")
    return DONE


def manual(options: argparse.Namespace) -> int:
    """`spherecal manual`."""
    page = manual_page(options.language)
    if page is None:
        raise InputError(Phrase("error-no-manual"))
    answer(options, {"page": page})
    say(str(page))
    if options.open and not webbrowser.open(page.as_uri()):
        raise InputError(Phrase("error-no-browser", {"page": page}))
    return DONE


def manual_page(language: str = "en") -> Path | None:
    """The manual's first page in a language (en, de, zh), offline; None in a checkout before `dev.py docs`."""
    page = "index.html" if language == "en" else f"guide/{language}/index.html"
    folders = resource_path("manual"), resource_path().parent / "build" / "site"
    return next((folder / page for folder in folders if (folder / page).is_file()), None)
