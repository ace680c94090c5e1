"""Where a command writes its file or folder: in place, or to standard output."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import Marker, check_folder, write_file_whole
from spherecal_app.cli.parsing import is_standard_output


def check_output_folder(path: Path, marker: Marker) -> None:
    """Check that a folder may be written, as `check_folder` does."""
    if is_standard_output(path):
        raise InputError(Phrase("error-folder-to-output"))
    check_folder(path, marker)


def to_output(path: Path, data: bytes) -> None:
    """Write a single file whole."""
    with output_file(path) as place:
        write_file_whole(place, data)


@contextmanager
def output_file(path: Path) -> Iterator[Path]:
    """Where to write a command's one file: `path`, or for "-" a temporary file that then goes to standard output."""
    if not is_standard_output(path):
        yield path
        return
    with TemporaryDirectory() as folder:
        place = Path(folder) / "output"
        yield place
        if place.is_dir():
            raise InputError(Phrase("error-folder-to-output"))
        sys.stdout.flush()
        sys.stdout.buffer.write(place.read_bytes())
        sys.stdout.buffer.flush()
