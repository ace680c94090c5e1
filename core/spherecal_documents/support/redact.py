"""Names taken out of what is sent away: users, hosts, operators, serial numbers; one name always by one stand-in."""

import getpass
import json
import re
import socket
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

# What a field of our files holds, by its name; nothing else in them names a person or a device.
_KIND_OF_FIELD = {
    "serial": "serial", "serials": "serial", "serial_number": "serial", "operator": "person", "user": "person",
    "user_name": "person", "by": "person", "author": "person", "host": "host", "hostname": "host", "computer": "host",
}  # fmt: skip
# Accounts that name nobody.
_NOBODY = {"", "root", "user", "users", "admin", "administrator", "public", "shared", "default", "home", "guest"}
# Of tables: placement,camera,target,point,...
_ID_COLUMNS = {"camera", "placement", "bar", "pose", "from", "to"}
_HOMES = re.compile(r"((?:/home|/Users|/var/home|[A-Za-z]:[\\/]+Users)[\\/]+)([^\\/\s\"'<>|:*?]+)")
_SHARES = re.compile(r"((?:^|[\s\"'=(\[])(?:\\\\(?:\\\\)?|//))([\w.-]+)(?=[\\/])")
_SAID = re.compile(
    r"\b(user(?:name)?|operator|login|host(?:name)?|computer|machine|serial(?: number)?)"
    r"(\s*[:=]\s*\"?|\s+is\s+\"?|\s+(?=[\w.@-]*\d))([\w.@-]+)",
    re.IGNORECASE,
)
_ADDRESS = re.compile(r"\b([\w.+-]+)@([\w-]+(?:\.[\w-]+)*)\b")
_LOCAL = re.compile(r"\b[\w-]+(?:\.[\w-]+)*\.(?:local|lan|corp|internal|intranet|intra|home\.arpa|localdomain)\b", re.I)
_SHORTEST = 4  # shorter names would be found inside words and numbers


class Redactor:
    """Puts stand-ins such as `serial-1` in the place of names, one for each, throughout a bundle.

    `serials` are known to be serial numbers, and are replaced in free text too. `ids` are those of cameras, placements
    and so on: where one holds a name it is replaced as a field's key and in tables as it is in texts.
    """

    def __init__(self, serials: Iterable[str] = (), ids: Iterable[str] = ()) -> None:
        self._ids = set(ids)
        self._known: dict[str, dict[str, str]] = {}
        self.counts: Counter[str] = Counter()
        self._serials = sorted(one for one in serials if one)
        for one in self._serials:
            self._stand_in("serial", one)
        self._home = str(Path.home())
        self._host = socket.gethostname()
        try:
            self._user = getpass.getuser()
        except (OSError, KeyError):
            self._user = ""

    def _stand_in(self, kind: str, name: str) -> str:
        names = self._known.setdefault(kind, {})
        if name in names.values():
            return name  # it is one already
        return names.setdefault(name, f"{kind}-{len(names) + 1}")

    def _counted(self, kind: str, name: str) -> str:
        if kind == "person" and name.lower() in _NOBODY:
            return name
        self.counts[kind] += 1
        return self._stand_in(kind, name)

    def text(self, text: str) -> str:
        """A text without names; a stand-in takes the place of each."""
        if len(self._home) > 1:
            self.counts["person"] += text.count(self._home)
            text = text.replace(self._home, "~")
        text = _HOMES.sub(lambda m: m[1] + self._counted("person", m[2]), text)
        text = _SHARES.sub(lambda m: m[1] + self._counted("host", m[2]), text)
        text = _ADDRESS.sub(lambda m: f"{self._counted('person', m[1])}@{self._counted('host', m[2])}", text)
        text = _LOCAL.sub(lambda m: self._counted("host", m[0]), text)
        text = _SAID.sub(lambda m: m[1] + m[2] + self._counted(_kind_said(m[1]), m[3]), text)
        known = [("host", self._host), ("person", self._user), *(("serial", one) for one in self._serials)]
        for kind, name in sorted(known, key=lambda one: -len(one[1])):
            if len(name) >= _SHORTEST and name.lower() not in _NOBODY and name in text:
                whole = re.compile(rf"(?<![\w-]){re.escape(name)}(?![\w-])")
                text = whole.sub(lambda m, kind=kind: self._counted(kind, m[0]), text)
        return text

    def document(self, value: Any, field: str = "") -> Any:
        """A JSON document without names: fields that hold one by their name, all texts as `text` does."""
        if isinstance(value, dict):
            return {self._key(str(key)): self.document(one, str(key)) for key, one in value.items()}
        if isinstance(value, list):
            return [self.document(one, field) for one in value]
        kind = _KIND_OF_FIELD.get(field)
        if kind == "serial" and _is_number(value):
            return self._counted(kind, str(value))
        if isinstance(value, str) and value:
            return self._counted(kind, value) if kind else self.text(value)
        return value

    def _key(self, key: str) -> str:
        return self.text(key) if key in self._ids else key

    def _table(self, data: bytes) -> bytes:
        """A table as `observations_file` reads it, with its ids as `text` has them; one that is no text as it was."""
        try:
            lines = data.decode("utf-8-sig").split("\n")
        except UnicodeDecodeError:
            return data
        ids = {one: self.text(one) for one in self._ids}
        changed = {one: new for one, new in ids.items() if one != new}
        columns = [i for i, name in enumerate(lines[0].split(",")) if _bare(name) in _ID_COLUMNS]
        if not changed or not columns:
            return data
        last = columns[-1] + 1
        for number, line in enumerate(lines[1:], 1):
            fields = line.split(",", last)
            for i in columns:
                if i < len(fields) and (own := _bare(fields[i])) in changed:
                    fields[i] = fields[i].replace(own, changed[own])
            lines[number] = ",".join(fields)
        return "\n".join(lines).encode()

    def file(self, name: str, data: bytes) -> bytes:
        """The contents of a file without names: of tables the ids; binary files are as they were."""
        suffix = Path(name).suffix.lower()
        if suffix == ".csv":
            return self._table(data)
        if suffix == ".json":
            try:
                document = json.loads(data.decode("utf-8-sig"))
                redacted = self.document(document)
            except (ValueError, RecursionError):
                return self.text(data.decode(errors="replace")).encode()
            if redacted == document:
                return data
            return (json.dumps(redacted, indent=1, ensure_ascii=False) + "\n").encode(errors="backslashreplace")
        if suffix in (".log", ".txt", ".xml", ".html"):
            return self.text(data.decode(errors="replace")).encode()
        return data

    def summary(self) -> list[str]:
        """How many of what were replaced, in words."""
        words = {"person": "names of people", "host": "names of computers", "serial": "serial numbers"}
        said = [f"{self.counts[kind]} {what} (as {kind}-1, ...)" for kind, what in words.items() if self.counts[kind]]
        return said or ["nothing: no name was found"]


def _kind_said(word: str) -> str:
    word = word.lower()
    return "serial" if word.startswith("serial") else "host" if word[0] in "hcm" else "person"


def _bare(field: str) -> str:
    """A field of a table without the quotation marks and the carriage return that may be around it."""
    return field.removesuffix("\r").strip('"')


def _is_number(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def serials_in(document: Any) -> set[str]:
    """All serial numbers that a JSON document names in fields of that name, or in wizard.json's lists of cameras."""
    found = _values_of("serial", document)
    if isinstance(document, dict) and document.get("format") == "spherecal/wizard":
        for key in ("cameras", "looked"):
            listed = document.get(key)
            found |= {one for one in listed if isinstance(one, str) and one} if isinstance(listed, list) else set()
    return found


def ids_in(document: Any) -> set[str]:
    """All ids that a JSON document gives."""
    return _values_of("id", document)


def _values_of(field: str, document: Any) -> set[str]:
    found: set[str] = set()
    level = [document]
    while level:  # no recursion: what comes from outside may be nested deeply
        value = level.pop()
        if isinstance(value, dict):
            own = value.get(field)
            own = str(own) if _is_number(own) else own
            found |= {own} if isinstance(own, str) and own else set()
            level.extend(value.values())
        elif isinstance(value, list):
            level.extend(value)
    return found
