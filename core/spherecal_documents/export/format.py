"""What every export format states about itself, and formats that installed packages add (docs/plugins.md)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from spherecal.base.plugins import EXPORTERS, IMPORTERS, load
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Unit


@dataclass(frozen=True)
class Format:
    """An export format: how it is called, what it carries, how it is written and read back.

    Its cameras are read back with lens and pose. What has no lenses is a `SceneFormat` (scene_formats.py).

    `coefficients`: how many of OpenCV's distortion numbers it keeps at most; `fisheye, fields`: whether it holds
    lenses of the fisheye model, and fields of lenses. `units`: those it may be written in, the usual one first.

    `write` returns the files' texts by name ("" for the one file of a format without a folder). `read` returns the
    cameras of such a file or folder. `ids` returns the ids under which the rig's cameras are found there.
    """

    name: str
    title: str
    coefficients: int
    units: tuple[Unit, ...]
    write: Callable[[FileRig], Mapping[str, str | bytes]]
    read: Callable[[Path], Sequence[FileCamera]]
    folder: bool = False
    ids: Callable[[FileRig], Sequence[str]] = FileRig.ids
    fisheye: bool = False
    fields: bool = False


@dataclass(frozen=True)
class ImportFormat:
    """A format that is only read: `read` gives the cameras of a file or folder, lengths in the first of `units`."""

    name: str
    title: str
    units: tuple[Unit, ...]
    read: Callable[[Path], Sequence[FileCamera]]


def exporter(name: str) -> Format | None:
    """The export format of an installed package; None where no package has this name."""
    return load(EXPORTERS, name, Format)


def importer(name: str) -> Format | ImportFormat | None:
    """The format of an installed package that can be read: an importer, else an exporter that reads back, or None."""
    found = load(IMPORTERS, name, (Format, ImportFormat))
    return exporter(name) if found is None else found
