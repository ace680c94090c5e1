"""What a command tells, as JSON for other programs."""

import argparse
import dataclasses
import json
from collections.abc import Mapping
from datetime import date
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spherecal_app.cli.console import out

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def answer(options: argparse.Namespace, document: object) -> None:
    """With `--json`, print the document: all that goes to standard output, or to standard error beside a file there."""
    if options.json:
        try:
            print(json.dumps(plain(document), indent=1), file=out.file, flush=True)
        except BrokenPipeError:
            raise
        except OSError as error:
            out.lose(error)


def plain(value: object) -> object:
    """Dataclasses, arrays, paths and dates as JSON knows them; a number that is not finite is null."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return plain_fields(value)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Path | date):
        return value.isoformat() if isinstance(value, date) else str(value)
    return None if isinstance(value, float) and not isfinite(value) else value


def plain_fields(record: "DataclassInstance") -> dict[str, object]:
    """The fields of a dataclass by name, each as `plain` makes it."""
    return {field.name: plain(getattr(record, field.name)) for field in dataclasses.fields(record)}
