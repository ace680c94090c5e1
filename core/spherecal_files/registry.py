"""What a user keeps by name on this machine, such as bars and balls: one JSON file in the user's settings."""

import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Generic, TypeVar

from spherecal.base.messages.values import Phrase
from spherecal_files.atomic import make_parent, write_file_whole
from spherecal_files.codec import FileFormat
from spherecal_files.lock import locked

T = TypeVar("T")


def settings_path(variable: str, name: str) -> Path:
    """The file that an environment variable names, else the one of this name in the user's settings."""
    from platformdirs import user_config_path

    named = os.environ.get(variable)
    return Path(named) if named else user_config_path("spherecal", appauthor=False) / name


@dataclass(frozen=True)
class Registry(Generic[T]):
    """A file of things by name: its format, the variable that names another file, their `key`, the hint of its errors.

    Where no path is given, the file is that of `path()`.
    """

    form: FileFormat[tuple[T, ...]]
    variable: str
    key: str
    hint: Phrase

    def path(self) -> Path:
        """The file where it is not named otherwise."""
        return settings_path(self.variable, self.form.file)

    def read(self, path: Path | None = None) -> dict[str, T]:
        """The things by name, in the file's order; none where there is no file, InputError where it is broken."""
        path = path or self.path()
        return {attrgetter(self.key)(one): one for one in self.form.read(path)} if path.exists() else {}

    def changing(self, path: Path | None = None) -> AbstractContextManager[None]:
        """Hold the file from reading to writing, so that no other program's change is lost; errors as `locked`."""
        path = path or self.path()
        make_parent(path, self.hint)
        return locked(path)

    def write(self, things: Mapping[str, T], path: Path | None = None) -> None:
        """Write the file whole; OutputError where it cannot be written."""
        path = path or self.path()
        make_parent(path, self.hint)
        write_file_whole(path, self.form.bytes(things.values()))
