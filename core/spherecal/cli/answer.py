"""What a command tells, as JSON for other programs."""

import argparse
import dataclasses
import json
from collections.abc import Mapping
from datetime import date
from math import isfinite
from pathlib import Path
from typing import Any


def answer(options: argparse.Namespace, document: Any) -> None:
    """With `--json`, print the document: all that goes to standard output, or to standard error beside a file there."""
    if options.json:
        from spherecal.cli.commands import out

        print(json.dumps(plain(document), indent=1), file=out.file, flush=True)


def plain(value: Any) -> Any:
    """Dataclasses, arrays, paths and dates as JSON knows them; a number that is not finite is null."""
    if hasattr(value, "tolist"):  # of numpy, which a command's help does not wait for
        value = value.tolist()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Path | date):
        return value.isoformat() if isinstance(value, date) else str(value)
    return None if isinstance(value, float) and not isfinite(value) else value
