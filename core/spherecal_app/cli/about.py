"""`spherecal licences` and `spherecal manual`."""

import argparse
import webbrowser

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.resources import manual_page
from spherecal_app.cli.answer import answer
from spherecal_app.cli.console import say
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.output import to_output
from spherecal_documents.support.licences import bill_of_materials, licence_text, parts


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
