"""bundle.json: a session stands for a recording, its input_sha256 included, while its three files are unchanged."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_files.codec import FileFormat, Kind, digest, field, record, software, text, unread
from spherecal_files.json_file import JsonValue

BUNDLE_FILE = "bundle.json"
_MOST_FILES = 100_000


@dataclass(frozen=True)
class _Original:
    """The original's fingerprint, and the SHA-256 of each file of the session by name."""

    input_sha256: str
    files_sha256: dict[str, str]


def _read_files(value: JsonValue) -> dict[str, str]:
    if not isinstance(value.value, dict) or len(value.value) > _MOST_FILES:
        raise InputError(Phrase("error-bundle-files", {"file": value.file}))
    return {str(name): replace(value, value=own).text() for name, own in value.value.items()}


_FILES = {
    "description": "SHA-256 of the session's files by name.",
    "type": "object",
    "additionalProperties": text("").schema,
}
BUNDLE = FileFormat(
    "spherecal/bundle",
    BUNDLE_FILE,
    "The original of a session in a support bundle, whose images were left out.",
    record(
        "",
        _Original,
        field(
            "input_sha256",
            digest("`input_sha256` of the original session.").that(bool, Phrase("problem-sha256"), minLength=64),
        ),
        field("files_sha256", Kind(_FILES, _read_files, dict)),
        unread("images", "Whether the images are in it: `all`, `none` ...", lambda _: None),
        software(),
    ),
)


def bundle_bytes(original_sha256: str, files: Mapping[str, str], details: Mapping[str, Any]) -> bytes:
    """The contents of bundle.json: the original's fingerprint and the SHA-256 of each file of the session by name."""
    return BUNDLE.bytes(_Original(original_sha256, dict(files)), **details)


def original_sha256(folder: Path, files: Mapping[str, str]) -> str | None:
    """The fingerprint of the recording that a bundle represents; None for other sessions, or if changed since."""
    path = folder / BUNDLE_FILE
    if not path.is_file():
        return None
    original = BUNDLE.read(path)
    there = {name: own for name, own in files.items() if own != "missing"}
    same = all(original.files_sha256.get(name) == own for name, own in there.items())
    return original.input_sha256 if same else None
