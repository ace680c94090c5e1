"""What docstrings lack: parameters that nobody describes, and sentences that are too long."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

LONGEST = 30  # words of a sentence
_PARAMETERS = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w+\n-{3,}|\Z)", re.DOTALL | re.MULTILINE)
_Function = ast.FunctionDef | ast.AsyncFunctionDef


def lacking(path: Path) -> list[str]:
    """What the docstrings of a module lack, a line each."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [f"{path}:{line} {name}: {what}" for line, name, what in _of(tree, public=True)]


def _of(node: ast.Module | ast.ClassDef, public: bool) -> Iterator[tuple[int, str, str]]:
    line, name = (1, "module") if isinstance(node, ast.Module) else (node.lineno, node.name)
    yield from ((line, name, what) for what in _long_sentences(node))
    for inner in ast.walk(node) if isinstance(node, ast.Module) else node.body:
        if isinstance(inner, ast.ClassDef) and isinstance(node, ast.Module):
            yield from _of(inner, public and not inner.name.startswith("_"))
    for inner in node.body:
        if isinstance(inner, _Function):
            yield from ((inner.lineno, inner.name, what) for what in _long_sentences(inner))
            if public and not inner.name.startswith("_"):
                yield from ((inner.lineno, inner.name, what) for what in _undescribed(inner))


def _undescribed(function: _Function) -> Iterator[str]:
    """The arguments of a function with more than one that its docstring does not describe."""
    a = function.args
    names = [one.arg for one in (*a.posonlyargs, *a.args, *a.kwonlyargs) if one.arg not in ("self", "cls")]
    if len(names) < 2 or {"overload", "override"} & {ast.unparse(one) for one in function.decorator_list}:
        return
    section = _PARAMETERS.search(ast.get_docstring(function) or "")
    rows = [row for row in section[1].splitlines() if row and not row.startswith(" ")] if section else []
    described = set(re.findall(r"\w+", " ".join(rows)))
    yield from (f"does not describe {name}" for name in names if name not in described)


def _long_sentences(node: ast.Module | ast.ClassDef | _Function) -> Iterator[str]:
    text = re.sub(r"`[^`]*`", "X", ast.get_docstring(node) or "")
    for paragraph in re.split(r"\n\s*\n|\n(?=- )", text):
        for sentence in re.split(r"(?<=[.!?])\s+", " ".join(paragraph.split())):
            if len(sentence.split()) > LONGEST:
                yield f"{len(sentence.split())} words: {sentence[:60]}"
