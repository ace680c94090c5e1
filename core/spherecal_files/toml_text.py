"""TOML of other programs, with limits."""

import re
import tomllib
from typing import Any

_MOST_PARTS = 50  # of a key; the files that we read have two
_PART = r"""(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{_MOST_PARTS}}}")


def toml_of(text: str) -> dict[str, Any]:
    """What a text of TOML holds."""
    if _LONG_KEY.search(text):
        raise ValueError(f"a key has more than {_MOST_PARTS} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("its lists and tables are nested too deeply") from None
