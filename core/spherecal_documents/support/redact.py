"""Names (people, computers, serials, addresses, passwords) collected from all files, then replaced in all of them."""

import getpass
import json
import re
import socket
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from spherecal.base.resources import resource_path

KINDS = {
    "person": "names of people", "host": "names of computers", "serial": "serial numbers",
    "address": "addresses of devices", "token": "passwords",
}  # fmt: skip
_KNOWN: dict[str, Any] = tomllib.loads(resource_path("redaction.toml").read_text(encoding="utf-8"))
_NOBODY, _COMMON, _ID_COLUMNS = (set(_KNOWN[key].split()) | {""} for key in ("nobody", "common", "id_columns"))
WORDS = set(_KNOWN["words"])
_KIND_OF_FIELD = {field: kind for kind, fields in _KNOWN["fields"].items() for field in fields.split()}
_STAND_IN = re.compile(rf"(?:{'|'.join(KINDS)})-\d+")
_BLANK = re.compile(r"(?:[\s_.·]|%20)+")
_ADDRESS = re.compile(r"[0-9a-f]{2}([:-]?)[0-9a-f]{2}(\1[0-9a-f]{2}){4}|([0-9a-f]{4}\.?){3}", re.IGNORECASE)
_SHORTEST = 4  # shorter names would be found inside words and numbers; but three letters, and two of Chinese
_FORMAT = re.compile("spherecal/[a-z-]+")
_DEEPEST = 100  # our own documents are a tenth of that


def _said(kind: str) -> str:
    """The pattern of the words before a name of this kind."""
    return rf"(?i:(?<![^\W_])(?:{'|'.join(_KNOWN['said'][kind])}))"


_WORD = r"[^\s\\/\"'<>|:*?,;()\[\]{}=\uff1a\uff0c\uff1b]+"
_CAPITAL = rf"(?: (?=[A-ZÀ-ÖØ-Þ]){_WORD})"
# With blanks where the text ends or is divided after it, else as long as words begin with a capital.
_FOLDER = rf"{_WORD}(?: {_WORD}){{1,3}}(?=[\\/\"'])|{_WORD}{_CAPITAL}{{0,2}}"
_PERSON = rf"{_WORD}(?: {_WORD}){{0,2}}(?=[ \t]*(?:$|[,;|)\]}}\"'\r<\uff0c\uff1b]))|{_WORD}{_CAPITAL}{{0,3}}"
_COLON = r"[\"']?[ \t]*[:=\uff1a][ \t]*[\"']?"
_IS = rf"(?:{_COLON}|[ \t]+(?:is[ \t]+)?(?=[\w.-]*\d))"
_PIECES = {
    **{kind: _said(kind) for kind in ("token", "serial", "host", "person")},
    **{name: "|".join(_KNOWN["said"][name]) for name in ("tokens", "folders")},
    **{"folder": _FOLDER, "name": _PERSON, "colon": _COLON, "is": _IS},
}
_RULES = tuple((re.compile(pattern % _PIECES, re.MULTILINE), kinds) for pattern, *kinds in _KNOWN["rules"])


class Redactor:
    """Knows the names in a bundle's files, of this computer and its user; puts stand-ins in their place."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._as: dict[str, str] = {}  # stand-ins by `_key` of a name
        self._shown: dict[str, str] = {}
        self._counts: Counter[str] = Counter()
        self._ids: set[str] = set()
        self._home = str(Path.home())
        self._know("host", socket.gethostname())
        with suppress(OSError, KeyError):
            self._know("person", getpass.getuser())
        for name, data in files.items():
            self._collect(name, data)
        found = map(self._anywhere, sorted(self._as, key=len, reverse=True))
        self._pattern = re.compile("|".join(found) or "(?!)", re.IGNORECASE)
        self._counts.clear()

    def _know(self, kind: str, name: str) -> str:
        """The name as it is to be written; of a name of several words the words stand for the same person."""
        bare = name.strip(" .'")
        key = _key(bare)
        if bare.lower() in _NOBODY or _STAND_IN.fullmatch(bare) or (kind in ("person", "host") and bare.isdigit()):
            return name
        if key not in self._as:
            self._as[key] = f"{kind}-{1 + sum(one.startswith(kind) for one in self._shown)}"
            self._shown[self._as[key]] = bare
            for word in key.split() if kind == "person" else ():
                if word.isalpha() and len(word) > 2 and word not in _COMMON | _NOBODY:
                    self._as.setdefault(word, self._as[key])
        self._counts[self._as[key]] += 1
        return name.replace(bare, self._as[key])

    def _collect(self, name: str, data: bytes) -> None:
        self._ruled(name)
        if name.endswith(".csv"):
            return
        text = data.decode("utf-8-sig", errors="replace")
        document = _parsed(text) if name.endswith(".json") else None
        if document is None:
            self._ruled(text)
            return
        self._ids |= set(_values_of("id", document))
        if isinstance(document, dict) and document.get("format") == "spherecal/wizard":
            for key in ("cameras", "looked"):
                for one in document[key] if isinstance(document.get(key), list) else ():
                    self._know("serial", str(one))
        self._walked(document, self._ruled)

    def _ruled(self, text: str) -> str:
        """A text without the names that are known by where they stand."""

        def put(m: re.Match[str], kinds: Sequence[str]) -> str:
            groups = zip(m.groups(""), kinds, strict=False)
            return "".join(self._know(kind, one) if kind and one else one for one, kind in groups)

        if len(self._home) > 1:
            text = re.sub(re.escape(self._home) + r"(?![\w.-])", "~", text)
        for pattern, kinds in _RULES:
            text = pattern.sub(partial(put, kinds=kinds), text)
        return text

    def _anywhere(self, key: str) -> str:
        """The pattern of a name wherever it stands, in whichever way it is written; it matches nothing if too short."""
        if self._as[key].startswith("address"):
            return r"(?<![0-9a-f])" + r"[:.-]?".join(re.findall("..", key)) + r"(?![0-9a-f])"
        spelt = _BLANK.pattern.join(map(re.escape, key.split(" ")))
        if min(key) > "\u2e80":  # Chinese has no blanks between words
            return spelt if len(key) > 1 else "(?!)"
        if len(key) < _SHORTEST - key.isalpha() or key in _COMMON:
            return "(?!)"
        # a short number is no part of a date, nor of a number with decimals
        before, after = (r"(?<!\d[.:,-])", r"|[.:,-]\d") if re.fullmatch(r"[\d -]{,5}", key) else ("", "")
        return rf"(?<![^\W_]){before}{spelt}(?![^\W_]{after})"

    def text(self, text: str) -> str:
        """A text without names; a stand-in takes the place of each."""
        return self._pattern.sub(self._met, self._ruled(text))

    def _met(self, m: re.Match[str]) -> str:
        known = self._as[_key(m[0])]
        self._counts[known] += 1
        return known

    def _value(self, text: str) -> str:
        return text if text in WORDS or _FORMAT.fullmatch(text) else self.text(text)

    def _walked(self, value: Any, change: Callable[[str], str], field: str = "") -> Any:
        """A document of JSON with every text changed, and those of fields that hold a name replaced."""
        if isinstance(value, dict):
            keys = {key: key if key.isidentifier() and key not in self._ids else change(key) for key in value}
            return {keys[key]: self._walked(one, change, key) for key, one in value.items()}
        if isinstance(value, list):
            return [self._walked(one, change, field) for one in value]
        kind = _KIND_OF_FIELD.get(field)
        if kind and (
            (isinstance(value, str) and value)
            or (kind == "serial" and isinstance(value, int) and not isinstance(value, bool))
        ):
            return self._know(kind, str(value))
        return change(value) if isinstance(value, str) else value

    def _table(self, text: str) -> str:
        """A table as `observations_file` reads it, its quotation marks kept: ids, and what is no number."""
        lines = text.split("\n")
        ids = [_bare(name) in _ID_COLUMNS for name in lines[0].split(",")]
        first = lines[1].split(",") if len(lines) > 1 else []
        texts = [i for i, one in enumerate(first) if (i < len(ids) and ids[i]) or not _is_figure(_bare(one))]
        last = texts[-1] + 1 if texts else 0
        known: dict[tuple[str, bool], str] = {}
        for number, line in enumerate(lines[1:] if last else (), 1):
            cells = line.split(",", -1 if '"' in line else last)
            for i, cell in enumerate(cells):
                key = cell, i < len(ids) and ids[i]
                if key not in known:
                    bare = _bare(cell)
                    named = bare and (key[1] or not _is_figure(bare)) and i < max(last, '"' in line and len(cells))
                    known[key] = cell.replace(bare, self._value(bare)) if named else cell
                cells[i] = known[key]
            lines[number] = ",".join(cells)
        return "\n".join(lines)

    def file(self, name: str, data: bytes) -> bytes:
        """The contents of a file without names; binary files are as they were."""
        kind = Path(name).suffix.lower()
        if kind not in (".csv", ".json", ".log", ".txt", ".xml", ".html"):
            return data
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode(errors="replace")
        document = _parsed(text) if kind == ".json" else None
        if document is not None:
            changed = self._walked(document, self._value)
            same = changed == document
            return data if same else (json.dumps(changed, indent=1, ensure_ascii=False) + "\n").encode(errors="replace")
        changed = self._table(text) if kind == ".csv" else self.text(text)
        return data if changed == text else changed.encode()

    def path(self, path: str) -> str:
        """The path of a file without names."""
        return "/".join(map(self._value, path.split("/")))

    def summary(self) -> tuple[str, ...]:
        """How many of what were replaced, in words; it names none."""
        counts = Counter({kind: sum(n for to, n in self._counts.items() if to.startswith(kind)) for kind in KINDS})
        said = tuple(f"{counts[kind]} {what} (as {kind}-1, ...)" for kind, what in KINDS.items() if counts[kind])
        return said or ("nothing: no name was found",)

    def replaced(self) -> tuple[str, ...]:
        """A line for each name that was replaced, to be shown to who sends it and to nobody else."""
        return tuple(
            f"{to}: {self._shown[to] if not to.startswith('token') else self._shown[to][:2] + '…'} ({self._counts[to]})"
            for to in sorted(self._counts, key=lambda one: (one[0], len(one), one))
        )


def _key(name: str) -> str:
    """A name as it is compared: in small letters, with one kind of blank; addresses of devices without their marks."""
    if _ADDRESS.fullmatch(name):
        return re.sub("[:.-]", "", name).lower()
    return _BLANK.sub(" ", name.lower())


def _bare(cell: str) -> str:
    """A cell of a table without the quotation marks and the carriage return that may be around it."""
    return cell.removesuffix("\r").strip('"')


def _is_figure(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _parsed(text: str) -> Any:
    """A document of JSON; None where it is none, or nested too deeply to be walked."""
    try:
        document = json.loads(text)
        list(_values_of("", document))
    except (ValueError, RecursionError):
        return None
    return document


def _values_of(field: str, value: Any, depth: int = 0) -> Iterator[str]:
    """All texts that a document has in fields of this name; RecursionError where it is nested too deeply."""
    if depth > _DEEPEST:
        raise RecursionError
    if isinstance(value, dict):
        own = value.get(field)
        yield from (own,) if isinstance(own, str) else ()
    for one in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _values_of(field, one, depth + 1)
