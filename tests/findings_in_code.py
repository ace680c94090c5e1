"""What findings and phrases the engine makes, read off its source: codes, kinds, severities and values."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path

from tests.conftest import ROOT

ENGINE = ROOT / "core" / "spherecal"
_REPORT = ROOT / "core" / "spherecal_documents" / "report"


@dataclass(frozen=True)
class Made:
    """A `Finding(...)` or `Phrase(...)` in the source; names that are computed there are looked up in its module.

    `values` is None where the names of the values are not written out in the call.
    """

    place: str
    codes: frozenset[str]
    kinds: frozenset[str] = frozenset()
    severities: frozenset[str] = frozenset()
    values: frozenset[str] | None = field(default=None)


@cache
def findings_in_code(*paths: Path) -> list[Made]:
    """Every finding that is made in some files or folders of the engine, all of it by default."""
    return [_finding(module, call) for module, call in _calls("Finding", paths or (ENGINE.parent,))]


@cache
def phrases_in_code() -> list[Made]:
    """Every phrase that is made in the engine and in the window, labels of the report among them."""
    found = []
    for module, call in _calls("Phrase", (ENGINE.parent, ROOT / "spherecal_gui")):
        values = _keys(call.args[1]) if len(call.args) > 1 else frozenset()
        keys = module.strings(call.args[0])
        if module.name != _OF_ANY_KEY or keys != {"*"}:
            found.append(Made(f"{module.name}:{call.lineno}", keys, values=values))
    for module, call in _calls("label", (_REPORT,)):  # a phrase in the report's language
        if module.name == _OF_ANY_KEY:
            continue
        names = [one.arg for one in call.keywords]
        values = None if None in names else frozenset(map(str, names))
        found.append(Made(f"{module.name}:{call.lineno}", module.strings(call.args[0]), values=values))
    for module, call in _calls("columns", (_REPORT,)):  # the labels of a table's headings
        words = [word for text in module.strings(call.args[0]) for word in text.split() if not word.startswith("=")]
        keys = frozenset("*" if word == "*" else f"report-{word}" for word in words)
        found.append(Made(f"{module.name}:{call.lineno}", keys, values=None if call.keywords else frozenset()))
    for module, call in _calls("word", (_REPORT,)):
        found.append(Made(f"{module.name}:{call.lineno}", module.strings(call.args[0]), values=frozenset()))
    return found


@dataclass(frozen=True)
class _Module:
    name: str
    tree: ast.Module

    def strings(self, node: ast.expr | None) -> frozenset[str]:
        """The strings that an expression may be: itself, branches, or what is assigned to the names in it."""
        if node is None:
            return frozenset()
        if isinstance(node, ast.Constant):
            return frozenset([node.value]) if isinstance(node.value, str) else frozenset()
        if isinstance(node, ast.IfExp):
            return self.strings(node.body) | self.strings(node.orelse)
        found, names, known = _constants(node), _names(node), set[str]()
        while names - known:  # what is assigned to them, and to the names in that
            name = (names - known).pop()
            known.add(name)
            for value in self.assigned.get(name, ()):
                found |= _constants(value)
                names |= _names(value)
        return frozenset(found) or frozenset(["*"])

    @cached_property
    def assigned(self) -> dict[str, list[ast.expr]]:
        """What is assigned to each name, anywhere in the module."""
        found: dict[str, list[ast.expr]] = {}
        for one in ast.walk(self.tree):
            if isinstance(one, ast.Assign):
                targets, value = one.targets, one.value
            elif isinstance(one, ast.AnnAssign) and one.value is not None:
                targets, value = [one.target], one.value
            elif isinstance(one, ast.For):
                targets, value = [one.target], one.iter
            else:
                continue
            for name in set[str]().union(*map(_names, targets)):
                found.setdefault(name, []).append(value)
        return found

    @cached_property
    def calls(self) -> dict[str, list[ast.Call]]:
        """The calls of each function that is named, anywhere in the module."""
        found: dict[str, list[ast.Call]] = {}
        for one in ast.walk(self.tree):
            if isinstance(one, ast.Call) and isinstance(one.func, ast.Name):
                found.setdefault(one.func.id, []).append(one)
        return found


# These make findings and phrases out of files and other phrases.
_READERS = (
    "core/spherecal/data/findings.py", "core/spherecal_files/findings_file.py",
    "core/spherecal/base/messages/catalogue.py", "core/spherecal_files/findings_file.py",
)  # fmt: skip


# This makes phrases of the keys that the report's labels name.
_OF_ANY_KEY = "core/spherecal_documents/report/language.py"


def _names(node: ast.AST) -> set[str]:
    return {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}


def _constants(node: ast.AST) -> set[str]:
    """The strings in an expression; `*` for one that is put together there."""
    if isinstance(node, ast.JoinedStr):
        return {"*"}
    if isinstance(node, ast.Constant):
        return {node.value} if isinstance(node.value, str) else set()
    return set[str]().union(*(_constants(one) for one in ast.iter_child_nodes(node)))


def _calls(name: str, paths: tuple[Path, ...]) -> Iterator[tuple[_Module, ast.Call]]:
    files = [file for path in paths for file in (sorted(path.rglob("*.py")) if path.is_dir() else [path])]
    for module in map(_module, files):
        if module.name not in _READERS:
            yield from ((module, call) for call in module.calls.get(name, ()))


@cache
def _module(file: Path) -> _Module:
    return _Module(file.relative_to(ROOT).as_posix(), ast.parse(file.read_text(encoding="utf-8")))


_PARAMETERS = ("code", "severity", "values", "where", "repairs", "kind")


def _finding(module: _Module, call: ast.Call) -> Made:
    given = dict(zip(_PARAMETERS, call.args, strict=False)) | {k.arg: k.value for k in call.keywords if k.arg}
    values = _keys(given["values"]) if "values" in given else frozenset[str]()
    return Made(
        f"{module.name}:{call.lineno}",
        module.strings(given["code"]),
        module.strings(given.get("kind")),
        module.strings(given["severity"]),
        values,
    )


def _keys(node: ast.expr) -> frozenset[str] | None:
    if not isinstance(node, ast.Dict):
        return None
    keys = [key.value if isinstance(key, ast.Constant) else None for key in node.keys]
    return None if None in keys else frozenset(str(key) for key in keys)


_ERRORS = {
    "SpherecalError", "InputError", "OutputError", "InUse", "CameraError", "CamerasNotInstalled", "MissingPackage",
}  # fmt: skip


def errors_in_words() -> dict[str, list[int]]:
    """Where an error of ours is made of text instead of phrases: the lines, by module of the engine and the window."""
    found: dict[str, list[int]] = {}
    for folder in (ENGINE.parent, ROOT / "spherecal_gui"):
        for file in sorted(folder.rglob("*.py")):
            for node in ast.walk(_module(file).tree):
                if isinstance(node, ast.Call) and _is_error(node.func) and any(map(_is_text, node.args)):
                    found.setdefault(file.relative_to(ROOT).as_posix(), []).append(node.lineno)
    return found


def _is_error(function: ast.expr) -> bool:
    if isinstance(function, ast.Name):
        return function.id in _ERRORS
    logged = isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name) and function.value.id == "log"
    return isinstance(function, ast.Attribute) and function.attr in ("error", "_wrong") and not logged


def _is_text(node: ast.expr) -> bool:
    """Whether an expression is text that is written out; the names of columns and fields have no spaces."""
    if isinstance(node, ast.IfExp):
        return _is_text(node.body) or _is_text(node.orelse)
    if isinstance(node, ast.BinOp):
        return _is_text(node.left) or _is_text(node.right)
    if isinstance(node, ast.JoinedStr):
        return True
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip()
