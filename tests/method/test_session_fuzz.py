"""Whatever a session folder holds, its reader gives a session or one of our errors."""

import copy
import json
import random
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from spherecal.base.errors import SpherecalError
from spherecal_files.read_session import read_session
from tests.example_session import OBSERVATIONS, VALID, changed, make_session


def leaves(value: object, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """The paths of all values in a document, inner ones included."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(leaf for key, item in items for leaf in leaves(item, (*path, key)))]


JSON_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=20)
    | st.sampled_from(["C01", "A", "P1"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)


# all places of the valid session, and optional ones that it does without
PLACES = [*leaves(VALID)[1:], ("bars", 0, "lengths", 0, "nominal_mm")]


def read_in_new_folder(text: bytes, lines: bytes | None = None) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = make_session(Path(name))
        (folder / "session.json").write_bytes(text)
        if lines is not None:
            (folder / "observations.csv").write_bytes(lines)
        with suppress(SpherecalError):
            read_session(folder)


@settings(max_examples=300)
@given(st.sampled_from(PLACES), JSON_VALUES, st.sampled_from(leaves(VALID)[1:]), st.booleans())
def test_fuzzed_session(
    path: tuple[str | int, ...], value: object, second: tuple[str | int, ...], remove: bool
) -> None:
    document: Any = changed(*path, to=value)
    try:
        inner = document
        for key in second[:-1]:
            inner = inner[key]
        if remove:
            del inner[second[-1]]
        else:
            inner[second[-1]] = copy.deepcopy(value)
    except (TypeError, KeyError, IndexError):
        pass  # the first change took the second's place away
    read_in_new_folder(json.dumps(document).encode())


@settings(max_examples=200)
@given(st.randoms(use_true_random=False), st.booleans())
def test_fuzzed_bytes(random_source: random.Random, of_table: bool) -> None:
    session, table = json.dumps(VALID).encode(), ("\n".join(OBSERVATIONS) + "\n").encode()
    data = bytearray(table if of_table else session)
    for _ in range(random_source.randint(1, 4)):
        at = random_source.randrange(len(data))
        kind = random_source.randrange(3)
        if kind == 0:
            data[at] = random_source.randrange(256)
        elif kind == 1:
            del data[at : at + random_source.randint(1, 50)]
            data = data or bytearray(b" ")
        else:
            data[at:at] = data[: random_source.randint(1, 30)]
    read_in_new_folder(session if of_table else bytes(data), bytes(data) if of_table else None)
