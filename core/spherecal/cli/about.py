"""`spherecal licences` and `spherecal manual`."""

import argparse
from collections.abc import Callable
from pathlib import Path

Add = Callable[[str, str], argparse.ArgumentParser]


def add_parsers(add: Add) -> None:
    """Add both commands to the command line."""
    one = add("licences", "The parts of others in this program, and their licences.")
    one.add_argument("--texts", type=Path, metavar="FILE", help="write all licence texts to this file")
    one.add_argument("--sbom", type=Path, metavar="FILE", help="write a bill of materials (CycloneDX JSON)")
    manual = add("manual", "Where the manual is on this computer.")
    manual.add_argument("--language", choices=("en", "de", "zh"), default="en", help="of the manual (default en)")
    manual.add_argument("--open", action="store_true", help="open it in the web browser")
    completion = add("completion", "Print a script that completes commands and options in your shell.")
    completion.add_argument(
        "shell", choices=("bash", "zsh", "fish"), help='for example: eval "$(spherecal completion bash)"'
    )


def licences(options: argparse.Namespace) -> int:
    """`spherecal licences`."""
    from spherecal.cli.answer import answer
    from spherecal.cli.commands import out
    from spherecal.cli.parsing import to_output
    from spherecal.support.licences import bill_of_materials, licence_text, parts

    found = parts()
    answer(options, [{"name": part.name, "version": part.version, "licence": part.licence} for part in found])
    if options.texts is not None:
        to_output(options.texts, licence_text().encode())
        out.print(f"Licence texts in {options.texts}.", markup=False)
    if options.sbom is not None:
        to_output(options.sbom, bill_of_materials())
        out.print(f"Bill of materials in {options.sbom}.", markup=False)
    if options.texts is None and options.sbom is None:
        for part in found:
            out.print(f"{part.name} {part.version}: {part.licence}", markup=False)
    return 0


def manual(options: argparse.Namespace) -> int:
    """`spherecal manual`."""
    import webbrowser

    from spherecal.base.errors import InputError
    from spherecal.base.messages.values import Phrase
    from spherecal.base.resources import manual_page
    from spherecal.cli.answer import answer
    from spherecal.cli.commands import out

    page = manual_page(options.language)
    if page is None:
        raise InputError(Phrase("error-no-manual"))
    answer(options, {"page": page})
    out.print(str(page), markup=False)
    if options.open and not webbrowser.open(page.as_uri()):
        raise InputError(Phrase("error-no-browser", {"page": page}))
    return 0


def completion(options: argparse.Namespace) -> int:
    """`spherecal completion`."""
    from spherecal.cli.completion import script
    from spherecal.cli.main import DONE
    from spherecal.cli.options import make_parser

    print(script(make_parser(), options.shell), end="")
    return DONE
