"""Files read, and names that become files; what writes, or walks below a folder, is spherecal_files.filesystem."""

import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase

LONGEST_ID = 64
# Common file systems allow 255 bytes a name; an id is followed by an ending of up to 20.
_LONGEST_NAME_BYTES = 235
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(10))}
NO_WAIT = getattr(os, "O_NONBLOCK", 0)
TO_READ = os.O_RDONLY | NO_WAIT | getattr(os, "O_BINARY", 0)


def id_problem(text: str) -> Phrase | None:
    """Why a text cannot be an id, which becomes a file name; None if it can."""
    if not text:
        return Phrase("problem-name-empty")
    if len(text) > LONGEST_ID:
        return Phrase("problem-name-long", {"most": LONGEST_ID})
    if text.startswith("."):
        return Phrase("problem-id-dot")
    if not all(c.isalnum() or c in "-_." for c in text):
        return Phrase("problem-id-characters")
    return file_name_problem(text)


def file_name_problem(name: str) -> Phrase | None:
    """Why a text cannot be the name of a file; None if it can."""
    if name in ("", ".", ".."):
        return Phrase("problem-path-part")
    if not name.isprintable():
        return Phrase("problem-control-characters")
    if len(name.encode(errors="surrogatepass")) > _LONGEST_NAME_BYTES:
        return Phrase("problem-file-name-long")
    if os.name == "nt" and (
        name.split(".", maxsplit=1)[0].rstrip().lower() in _DEVICES or name[-1] in ". " or ":" in name
    ):
        return Phrase("problem-file-name-windows")
    return None


Fits = Callable[[BinaryIO, Path, int], None]


def read_file(path: Path, most: int, fits: Fits | None = None) -> bytes:
    """The contents of a regular file of at most `most` bytes, if it fits."""
    with plain_reading(path):
        return read_opened(os.open(path, TO_READ), path, most, fits)


def read_opened(descriptor: int, path: Path, most: int, fits: Fits | None = None) -> bytes:
    """As `read_file`, of an open file."""
    with open(descriptor, "rb") as file:
        size = check_size(file, path, most)
        if fits is not None:
            fits(file, path, size)
            file.seek(0)
        data = file.read(most + 1)
        if len(data) > most:
            raise _too_large(path, most)
        return data


def check_size(file: BinaryIO, path: Path, most: int) -> int:
    """The size of an open regular file of at most `most` bytes."""
    state = os.fstat(file.fileno())
    if not stat.S_ISREG(state.st_mode):
        raise InputError(Phrase("error-not-a-file", {"file": path}))
    if state.st_size > most:
        raise _too_large(path, most)
    return state.st_size


def _too_large(path: Path, most: int) -> InputError:
    size = f"{most >> 20} MB" if most >= 1 << 20 else f"{most >> 10} kB"
    return InputError(Phrase("error-too-large", {"file": path, "size": size}))


@contextmanager
def plain_reading(path: Path) -> Iterator[None]:
    """A block that reads a file: what the system refuses is an InputError."""
    try:
        yield
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(Phrase("error-no-file", {"file": path})) from None
    except IsADirectoryError:
        raise InputError(Phrase("error-not-a-file", {"file": path})) from None
    except (OSError, ValueError) as error:
        why = str(getattr(error, "strerror", None) or error)
        raise InputError(Phrase("error-cannot-read", {"file": str(path), "why": why})) from error
