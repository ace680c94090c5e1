"""Random faults put into the code, one at a time: which ones do the tests notice? `mutants.py 30 --seed 1 PACKAGE...`.

Works on a copy of the repository. A mutant is tried by the test files that import its module or name its functions,
the quickest first; kernels run as plain Python. Not mutmut or cosmic-ray: one command for all mutants, no kernels.
"""

import argparse
import ast
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = [
    "core/spherecal", "core/spherecal_verify", "core/spherecal_files", "core/spherecal_boards",
    "core/spherecal_measuring", "spherecal_gui/presenters",
]  # fmt: skip
OTHER = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
         ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.Add: ast.Sub, ast.Sub: ast.Add,
         ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult, ast.And: ast.Or, ast.Or: ast.And}  # fmt: skip
OPPOSITE = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt}
NOT_CODE = ("returns", "annotation", "decorator_list")
COMPILED = re.compile(r"^@(\w+\.)?(njit|kernel|compiled|jit)\b", re.MULTILINE)
LATE = "time is up: it hangs, or the machine is busy"
Mutant = tuple[Any, str, str]  # what is replaced, by what, and the kind of fault


def mutants(node: ast.AST) -> Iterator[Mutant]:
    """Every fault that can be put into a tree, but into annotations, texts and decorators."""
    for name, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and name not in NOT_CODE and not isinstance(child, ast.JoinedStr | ast.Raise):
                yield from faults(child)
                yield from mutants(child)


def changed(node: ast.AST, **parts: object) -> str:
    """The source of a node with other parts."""
    text = ast.unparse(type(node)(**{name: getattr(node, name) for name in node._fields} | parts))
    return f"({text})" if isinstance(node, ast.expr) else text


def faults(node: ast.AST) -> Iterator[Mutant]:
    match node:
        case ast.Compare(ops=[op, *rest]):
            for other in {table[type(op)] for table in (OTHER, OPPOSITE) if type(op) in table}:
                yield node, changed(node, ops=[other(), *rest]), "comparison"
        case ast.BinOp(op=op) | ast.AugAssign(op=op) if type(op) in OTHER:
            yield node, changed(node, op=OTHER[type(op)]()), "arithmetic"
        case ast.BoolOp(op=op, values=values):
            yield node, changed(node, op=OTHER[type(op)]()), "boolean"
            yield node, f"({ast.unparse(values[0])})", "boolean"
        case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert(), operand=operand):
            yield node, f"({ast.unparse(operand)})", "boolean"
        case ast.Constant(value=int() | float() as value):
            for other in {not value} if isinstance(value, bool) else {value + 1, 2 * value} - {value}:
                yield node, f"({other!r})", "constant"
        case ast.Call(args=[first, second, *rest]) if not isinstance(first, ast.Starred | ast.Constant):
            yield node, changed(node, args=[second, first, *rest]), "swapped arguments"
        case ast.Expr(value=ast.Call()) | ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield node, "pass", "deleted statement"


def mutated(source: str, mutant: Mutant) -> str:
    node, text, _ = mutant
    lines = source.encode().splitlines(keepends=True)
    start, end = (sum(map(len, lines[: line - 1])) for line in (node.lineno, node.end_lineno))
    data = source.encode()
    return (data[: start + node.col_offset] + text.encode() + data[end + node.end_col_offset :]).decode()


def tests_of(module: Path, seconds: Counter[str], most_s: float, deeper: bool) -> list[str]:
    """The test files that import a module or name its functions, then the quickest; else those of its importers."""
    room, name = ".".join(module.parts[module.parts[0] == "core" : -1]), module.stem
    imports = re.compile(rf"\b{re.escape(room)}(\.{name}\b| import .*\b{name}\b)")
    tree = ast.parse((ROOT / module).read_text(encoding="utf-8"))
    own = [n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.ClassDef) and len(n.name) > 5]
    mentions = re.compile(rf"\b({'|'.join(own) or '$^'})\b")
    texts = {file.name: file.read_text(encoding="utf-8") for file in (ROOT / "tests").glob("test_*.py")}
    found = {n: not imports.search(text) for n, text in texts.items() if imports.search(text) or mentions.search(text)}
    if not found and deeper:
        users = [f for f in (ROOT / module).parent.glob("*.py") if imports.search(f.read_text(encoding="utf-8"))]
        return sorted({one for user in users for one in tests_of(user.relative_to(ROOT), seconds, most_s, False)})
    order = sorted(found, key=lambda name: (found[name], seconds[name], name))
    fits = [sum(seconds[one] for one in order[: i + 1]) <= most_s for i in range(len(order))]
    return [f"tests/{one}" for one, fit in zip(order, fits, strict=True) if fit or one == order[0]]


def failed(copy: Path, tests: list[str], timeout_s: float, compiled: bool) -> str:
    """The first test that fails in the copy; empty where all pass."""
    environment = os.environ | {"PYTHONPATH": f"{copy / 'core'}{os.pathsep}{copy}", "QT_QPA_PLATFORM": "offscreen"}
    environment |= {"CI": "1", "PYTHONDONTWRITEBYTECODE": "1"} | ({"NUMBA_DISABLE_JIT": "1"} if compiled else {})
    words = [sys.executable, "-m", "pytest", "-q", "-x", "--tb=no", "-p", "no:cacheprovider", *tests]
    process = subprocess.Popen(words, cwd=copy, env=environment, stdout=-1, text=True, start_new_session=True)
    try:
        said = process.communicate(timeout=timeout_s)[0]
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return LATE
    found = re.search(r"^(?:FAILED|ERROR) (\S+)", said, re.MULTILINE)
    return "" if process.returncode in (0, 5) else found[1] if found else "the run itself"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int)
    parser.add_argument("packages", nargs="*", default=PACKAGES, help="folders or files, from the repository's root")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=120.0, help="of tests for a mutant, as they take alone")
    options = parser.parse_args()
    seconds, table, suspects = Counter[str](), Counter[tuple[str, str]](), dict[tuple[str, bool], None]()
    for test, taken in json.loads((ROOT / "tests/durations.json").read_text(encoding="utf-8")).items():
        seconds[test.partition("::")[0]] += taken  # type: ignore[assignment]
    paths = [ROOT / one for one in options.packages]
    files = sorted({f for one in paths for f in (one.rglob("*.py") if one.is_dir() else [one]) if f.exists()})
    sites = [(f.relative_to(ROOT), m) for f in files for m in mutants(ast.parse(f.read_text(encoding="utf-8")))]
    chosen = random.Random(options.seed).sample(sites, min(options.count, len(sites)))
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, "copy")
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", ".venv", "__pycache__", "node_modules"))
        for number, (module, mutant) in enumerate(chosen, 1):
            source = (ROOT / module).read_text(encoding="utf-8")
            compiled, tests = bool(COMPILED.search(source)), tests_of(module, seconds, options.seconds, True)
            (copy / module).write_text(mutated(source, mutant), encoding="utf-8")
            by = failed(copy, tests, 120 + 8 * options.seconds, compiled) if tests else ""
            (copy / module).write_text(source, encoding="utf-8")
            suspects |= {(by, compiled): None} if "::" in by else {}
            table[str(module.parent), "late" if by == LATE else "killed" if by else "survived"] += 1
            old = " ".join((ast.get_source_segment(source, mutant[0]) or "").split())[:100]
            print(f"{number} {'killed by ' + by if by else 'SURVIVED ' + ' '.join(tests)}\n  {module}:"
                  f"{mutant[0].lineno} {mutant[2]}: {old} -> {mutant[1][:100]}", flush=True)  # fmt: skip
        for test, compiled in suspects:
            if failed(copy, [test], 120 + 8 * options.seconds, compiled):
                print(f"FAILS WITHOUT A MUTANT TOO: {test}; what it killed is not counted right")
    for package in sorted({one for one, _ in table}):
        print(f"{package:40}", *(f"{table[package, how]:4} {how}" for how in ("killed", "survived", "late")))


if __name__ == "__main__":
    main()
