"""What every export format states about itself."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from spherecal_documents.export.file_cameras import FileCamera, FileRig, Unit


@dataclass(frozen=True)
class Format:
    """An export format: how it is called, what it carries, how it is written and read back.

    Its cameras are read back with lens and pose. What has no lenses is a `SceneFormat` (scene.py).

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
