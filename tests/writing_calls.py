"""Which calls in a source file write, rename or remove files: only `spherecal.files` may."""

import ast
from pathlib import Path

# Methods of paths and functions of os and shutil, whatever they are called on.
_CALLS = {
    "rmtree", "unlink", "rename", "renames", "rmdir", "removedirs", "write_bytes", "write_text", "touch", "symlink_to",
    "hardlink_to", "copyfile", "copy2", "copytree", "copyfileobj", "truncate",
}  # fmt: skip
_OF_MODULES = {"os": {"remove", "replace", "link", "symlink", "mkfifo", "fdopen"}, "shutil": {"move", "copy"}}


def writing_calls(source: str) -> list[tuple[int, str]]:
    """Line and name of every call that writes, renames or removes a file."""
    return [(node.lineno, name) for node in ast.walk(ast.parse(source))
            if isinstance(node, ast.Call) and (name := _name(node))]  # fmt: skip


def _name(call: ast.Call) -> str:
    function = call.func
    if isinstance(function, ast.Name):
        writes = function.id in _CALLS or (function.id == "open" and _writes(call, 1))
        return function.id if writes else ""
    return _method(call, function) if isinstance(function, ast.Attribute) else ""


def _method(call: ast.Call, function: ast.Attribute) -> str:
    module = function.value.id if isinstance(function.value, ast.Name) else ""
    # Path.replace takes one argument, str.replace two, dataclasses.replace names
    alone = len(call.args) == 1 and not call.keywords and not isinstance(call.args[0], ast.Starred)
    opened = (
        any(word in ast.unparse(call) for word in ("O_WRONLY", "O_RDWR", "O_CREAT"))
        if module == "os"
        else (_writes(call, 0))
    )
    writes = (
        function.attr in _CALLS
        or function.attr in _OF_MODULES.get(module, ())
        or (function.attr == "open" and opened)
        or (function.attr == "replace" and alone)
    )
    return function.attr if writes else ""


def _writes(call: ast.Call, place: int) -> bool:
    modes = [keyword.value for keyword in call.keywords if keyword.arg == "mode"]
    if len(call.args) > place:
        modes.append(call.args[place])
    return any(isinstance(mode, ast.Constant) and isinstance(mode.value, str) and set(mode.value) & set("wax+")
               for mode in modes)  # fmt: skip


def files_that_write(root: Path) -> dict[str, list[tuple[int, str]]]:
    """The writing calls by source file of the program, those of `files.py` left out."""
    found = {}
    for folder in ("core/spherecal", "spherecal_gui"):
        for path in sorted((root / folder).rglob("*.py")):
            if calls := writing_calls(path.read_text(encoding="utf-8")):
                found[path.relative_to(root).as_posix()] = calls
    found.pop("core/spherecal/files.py", None)
    return found
