"""bundle.json in a session folder: it represents a recording whose images were left out, or whose bars were filled in.

As long as session.json, observations.csv and targets.json are those that were bundled, the session counts as the
original one: calibrating it gives the same rig.json, its fingerprint of the input included.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.json_file import JsonValue, json_bytes, read_json

FORMAT = "spherecal/bundle"
VERSION = 1
BUNDLE_FILE = "bundle.json"
_HEX = frozenset("0123456789abcdef")


def bundle_bytes(original_sha256: str, files: Mapping[str, str], details: Mapping[str, Any]) -> bytes:
    """The contents of bundle.json: the original's fingerprint and the SHA-256 of each file of the session by name."""
    return json_bytes(
        {
            "format": FORMAT,
            "version": VERSION,
            "input_sha256": original_sha256,
            "files_sha256": dict(files),
            **details,
        }
    )


def original_sha256(folder: Path, files: Mapping[str, str]) -> str | None:
    """The fingerprint of the recording that a bundle represents; None for any other session, or a bundle changed since.

    `files`: SHA-256 by relative path of the session's files, "missing" for images that are not there.
    """
    path = folder / BUNDLE_FILE
    if not path.is_file():
        return None
    f = read_json(path, FORMAT, VERSION).fields(("input_sha256", "files_sha256"))
    listed = {name: value.text() for name, value in _listed(f["files_sha256"].value, path).items()}
    sha = f["input_sha256"].text()
    if len(sha) != 64 or not set(sha) <= _HEX:
        raise f["input_sha256"].error(Phrase("problem-sha256"))
    there = {name: own for name, own in files.items() if own != "missing"}
    return sha if all(listed.get(name) == own for name, own in there.items()) else None


def _listed(value: object, path: Path) -> dict[str, JsonValue]:
    if not isinstance(value, dict) or len(value) > 100_000:
        raise InputError(Phrase("error-bundle-files", {"file": path}))
    return {str(name): JsonValue(own, path, "files_sha256") for name, own in value.items()}
