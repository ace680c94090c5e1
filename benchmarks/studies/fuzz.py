"""Hostile files: every reader is given broken, absurd and malicious files for ten minutes; no traceback may come out.

A reader may answer with a value or with a SpherecalError, nothing else. Hypothesis makes the files: valid ones with
parts exchanged, cut, repeated and blown up, and bytes out of nowhere. What fails is shrunk and printed.
"""

import copy
import io
import json
import tempfile
import time
import traceback
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.database import InMemoryExampleDatabase
from PIL import Image

from benchmarks.studies.report import Report
from spherecal.base.errors import SpherecalError

MINUTES = 10.0
_BATCH = 40  # examples between two looks at the clock

_ODD = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**70), 2**70), st.floats(), st.text(max_size=40),
    st.sampled_from([
        "", " ", "../../etc/passwd", "/etc/passwd", "C:\\x", "a" * 5000, "\x00", "\ud800", "NaN", "1e999", [], {}, [[]],
        [1] * 50, {"a": {"b": {}}}, 10**400, -0.0, 1e308, 5e-324, "2026-13-45", "9" * 400,
    ]),
)  # fmt: skip


@dataclass
class Reader:
    """A reader: its valid file as JSON or text, and what reads a file with such contents."""

    name: str
    read: Callable[[Path, bytes], object]
    valid: Any
    tries: int = 0
    refused: int = 0
    read_well: int = 0
    slowest_s: float = 0.0
    failures: Counter[str] = field(default_factory=Counter)
    examples: dict[str, str] = field(default_factory=dict)

    def once(self, folder: Path, data: bytes) -> None:
        """One file; failures are counted by their last line of code."""
        self.tries += 1
        began = time.monotonic()
        self._once(folder, data)
        self.slowest_s = max(self.slowest_s, time.monotonic() - began)

    def _once(self, folder: Path, data: bytes) -> None:
        try:
            self.read(folder, data)
            self.read_well += 1
        except SpherecalError:
            self.refused += 1
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            key = f"{type(error).__name__}: {str(error)[:100]} ({Path(place.filename).name}:{place.lineno})"
            self.failures[key] += 1
            self.examples.setdefault(key, repr(data[:400]))


def hostile_files() -> dict[str, bytes]:
    """Files made to break readers, by what they are."""
    bomb = b"".join(b'<!ENTITY l%d "%s">' % (i, b"&l%d;" % (i - 1) * 10) for i in range(1, 12))
    image = io.BytesIO()
    Image.new("1", (80, 90)).save(image, "PNG")
    size = (60_000).to_bytes(4, "big")
    head = b"IHDR" + size * 2 + image.getvalue()[24:29]
    claims = image.getvalue()[:12] + head + zlib.crc32(head).to_bytes(4, "big") + image.getvalue()[33:]
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 1000000000), }"
    objects = io.BytesIO()
    np.save(objects, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    return {
        "nested 100 000 deep": b"[" * 100_000,
        "nested objects": b'{"format":' * 50_000,
        "closed nest": b"[" * 3000 + b"]" * 3000,
        "a list of 300 000": b"[" + b"0," * 300_000 + b"0]",
        "one line of 2 MB": b"a" * (2 << 20),
        "a number of 100 000 digits": b'{"version": ' + b"9" * 100_000 + b"}",
        "XML entity bomb": b'<?xml version="1.0"?><!DOCTYPE d [<!ENTITY l0 "lol">' + bomb + b"]><d>&l11;</d>",
        "XML that names a file": b'<!DOCTYPE d [<!ENTITY x SYSTEM "file:///etc/passwd">]><document>&x;</document>',
        "YAML alias bomb": b"a: &a [x,x,x,x,x,x,x,x,x]\n"
        + b"".join(b"%c: &%c [%s]\n" % (98 + i, 98 + i, b",".join([b"*%c" % (97 + i)] * 9)) for i in range(8)),
        "YAML that calls Python": b"!!python/object/apply:os.system ['true']",
        "numpy of 10^18 numbers": b"\x93NUMPY\x01\x00" + len(header + b"\n").to_bytes(2, "little") + header + b"\n",
        "numpy with objects": objects.getvalue(),
        "image that claims 3600 megapixels": claims,
        "zip with a path out of it": zipped({"../../evil.json": b"{}", "session/session.json": b"{}"}),
        "zip that unpacks to 64 MB": zipped({"session/session.json": b"[" + b" " * (64 << 20) + b"]"}),
        "nothing": b"",
        "zeros": bytes(1000),
        "UTF-16": '{"format": "spherecal/rig"}'.encode("utf-16"),
    }


def later_version(valid: Any) -> bytes | None:
    """The valid file as a later version of the program would mark it; None where files have no version."""
    if not (isinstance(valid, dict) and "version" in valid):
        return None
    return json.dumps({**valid, "version": valid["version"] + 1}).encode()


def places_in(document: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place in a document."""
    found = [path]
    items = (
        document.items() if isinstance(document, dict) else enumerate(document) if isinstance(document, list) else ()
    )
    for key, value in items:
        found += places_in(value, (*path, key))
    return found


def put(document: Any, path: tuple[Any, ...], value: Any) -> Any:
    """The document with one place exchanged; `...` takes the place out."""
    if not path:
        return value
    changed = copy.deepcopy(document)
    inner = changed
    for key in path[:-1]:
        inner = inner[key]
    if value is ...:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return changed


def spoilt(valid: Any) -> st.SearchStrategy[bytes]:
    """Files made of a valid one."""
    if isinstance(valid, bytes):
        return _spoilt_bytes(valid)
    places = places_in(valid)

    @st.composite
    def document(draw: st.DrawFn) -> bytes:
        changed = valid
        for _ in range(draw(st.integers(1, 3))):
            path = draw(st.sampled_from(places))
            try:
                changed = put(changed, path, draw(st.one_of(_ODD, st.just(...))))
            except (KeyError, IndexError, TypeError):  # the place went with an earlier change
                continue
        if changed is ...:
            return b""
        data = json.dumps(changed, ensure_ascii=draw(st.booleans())).encode("utf-8", "surrogatepass")
        cut = draw(st.one_of(st.none(), st.integers(0, len(data))))
        return data[:cut]

    return document()


@st.composite
def _spoilt_bytes(draw: st.DrawFn, valid: bytes) -> bytes:
    """A text or binary file with pieces exchanged."""
    data = bytearray(valid)
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, max(len(data) - 1, 0)))
        length = draw(st.integers(0, 40))
        piece = draw(
            st.one_of(
                st.binary(max_size=20),
                st.sampled_from([b",", b"\n", b'"', b"1e400", b"nan", b"-1", b"\x00", b"\xff\xfe", b""]),
                st.integers(0, max(len(valid) - 40, 0)).map(lambda at: valid[at : at + 40]),
            )
        )
        data[start : start + length] = piece
    return bytes(data)


def readers(folder: Path) -> list[Reader]:
    """Every reader of files that come from others, each with a valid file."""
    from benchmarks.studies.fuzz_readers import all_readers

    return all_readers(folder)


def fuzz(seconds: float, folder: Path, only: str | None = None) -> list[Reader]:
    """Give every reader files in turn until the time is over; every reader gets one round at least."""
    found = [reader for reader in readers(folder) if only in (None, reader.name)]
    seed = 0
    fixed = list(hostile_files().values())
    for reader in found:
        for data in (*fixed, later_version(reader.valid)):
            if data is not None:
                reader.once(folder, data)
        if later_version(reader.valid) is not None:
            assert reader.refused, f"{reader.name}: reads a later version"
    end = time.monotonic() + seconds
    while True:
        for reader in found:
            _round(reader, folder, seed)
            if seed and time.monotonic() > end:
                return found
        seed += 1


def _round(reader: Reader, folder: Path, seed: int) -> None:
    """A batch of files; Hypothesis draws new ones in every round."""
    from hypothesis import seed as seeded

    strategy = st.one_of(spoilt(reader.valid), st.binary(max_size=300))

    @seeded(1000 * seed + len(reader.name))
    @settings(
        max_examples=_BATCH,
        deadline=None,
        database=InMemoryExampleDatabase(),
        phases=(Phase.generate,),
        suppress_health_check=[*HealthCheck],  # type: ignore[arg-type]
    )
    @given(strategy)
    def run(data: bytes) -> None:
        reader.once(folder, data)

    run()


def zipped(files: dict[str, bytes]) -> bytes:
    """A zip file."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()


def npy(array: np.ndarray) -> bytes:
    """numpy's own format."""
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def report(runs: int | None = None) -> Report:
    """Ten minutes; `runs` counts minutes."""
    page = Report("Hostile files", "python3 dev.py studies fuzz")
    minutes = float(runs) if runs is not None else MINUTES
    with tempfile.TemporaryDirectory() as folder:
        found = fuzz(60 * minutes, Path(folder))
    page.text(
        f"{minutes:g} minutes of files made by Hypothesis: valid ones with up to three places exchanged by absurd "
        "values, cut off, with pieces exchanged, random bytes. Every reader gets these first: "
        f"{', '.join(hostile_files())}; and its own file marked as of a later version. A reader may read a file or "
        "refuse it with a message; any other exception counts as a failure."
    )
    page.table(
        ("reader", "files", "read", "refused", "failures", "slowest s"),
        [(one.name, one.tries, one.read_well, one.refused, sum(one.failures.values()), one.slowest_s) for one in found],
    )
    for one in found:
        for failure, count in one.failures.most_common():
            page.text(f"- {one.name}: {failure}, {count} times; such as `{one.examples[failure][:200]}`")
    total = sum(one.tries for one in found)
    failed = sum(sum(one.failures.values()) for one in found)
    page.verdict("no traceback", failed == 0, f"{failed} of {total} files")
    return page
