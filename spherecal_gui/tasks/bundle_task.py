"""A support bundle: what somebody needs to help, without a single image and without names."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from spherecal.base.errors import InputError, OutputError, reason
from spherecal.base.messages.values import Phrase
from spherecal_documents.support.redact import Redactor
from spherecal_documents.support.support_bundle import BundleContents, write_zip
from spherecal_files.filesystem import plain_files, read_below

_SUFFIXES = {".json", ".csv", ".log", ".txt"}
_MOST_BYTES = 50 << 20
_MOST_FILES = 5000  # a project of a hundred sets holds a few hundred


def bundle_files(project: Path | None, log_text: str, about: str) -> tuple[dict[str, bytes], BundleContents]:
    """The project's tables and settings, log and versions; no names, images, links, files of 50 MB; what that is."""
    found: dict[str, bytes] = {}
    for name in plain_files(project, _MOST_FILES) if project is not None else ():
        if Path(name).suffix in _SUFFIXES and project is not None:
            try:
                found[f"project/{name}"] = read_below(project, name, _MOST_BYTES)
            except InputError:  # too large, or gone
                continue
    found |= {"about.txt": about.encode(), "log.txt": log_text.encode(errors="replace")}
    redactor = Redactor(found)
    found = {redactor.path(name): redactor.file(name, data) for name, data in found.items()}
    sizes = {name: len(one) for name, one in sorted(found.items())}
    return found, BundleContents(sizes, redactor.summary(), redactor.replaced())


def contents_text(contents: BundleContents, names: bool = False) -> str:
    """What is in a bundle and what was replaced, a line each; `names`: which names, for who sends it alone."""
    lines = [f"{name}  {size} bytes" for name, size in contents.files.items()]
    replaced = [f"Replaced: {'; '.join(contents.redacted)}.", *(contents.names if names else ())]
    return "\n".join([*replaced, "", *lines]) + "\n"


def make_bundle(output: Path, project: Path | None, log_text: str, about: str) -> int:
    """Write the zip of `bundle_files` with its table of contents; how many files. `project` None: none is open."""
    found, contents = bundle_files(project, log_text, about)
    found["contents.txt"] = contents_text(contents).encode()
    try:
        output.parent.mkdir(parents=True, exist_ok=True)  # nobody has begun anything here yet
    except OSError as error:
        what = Phrase("error-cannot-write", {"file": output.parent, "why": reason(error)})
        raise OutputError(what, Phrase("error-choose-folder")) from error
    files: dict[str, Callable[[], bytes]] = {name: partial(found.__getitem__, name) for name in found}
    write_zip(output, files)
    return len(found)
