"""Which calls in a source file write, rename or remove files: only `spherecal_files.filesystem` may."""

import ast
from pathlib import Path

# Methods of paths and functions of os and shutil, whatever they are called on.
_CALLS = {
    "rmtree", "unlink", "rename", "renames", "rmdir", "removedirs", "write_bytes", "write_text", "touch", "symlink_to",
    "hardlink_to", "copyfile", "copy2", "copytree", "copyfileobj", "truncate", "ftruncate", "chmod", "fchmod", "lchmod",
    "mkstemp", "mkdtemp", "NamedTemporaryFile", "TemporaryDirectory", "basicConfig", "FileHandler", "extractall",
    "unpack_archive", "make_archive",
}  # fmt: skip
# Packages' functions that write into the file, or the buffer in memory, that is their first argument.
_SAVERS = {
    "save", "savez", "savez_compressed", "savetxt", "tofile", "memmap", "imwrite", "imsave", "savefig", "print_figure",
    "PdfPages", "Canvas", "SimpleDocTemplate", "ZipFile",
}  # fmt: skip
_IN_MEMORY = {"BytesIO", "StringIO", "QBuffer", "TemporaryFile", "PdfPages"}
_OF_MODULES = {
    "os": {"remove", "replace", "link", "symlink", "mkfifo", "mknod", "fdopen", "chown"},
    "shutil": {"move", "copy"},
}


def writing_calls(source: str) -> list[tuple[int, str]]:
    """Line and name of every call that writes, renames or removes a file."""
    nodes = list(ast.walk(ast.parse(source)))
    calls = [node for node in nodes if isinstance(node, ast.Call) and _name(node, set())]
    if not calls:
        return []
    functions = [node for node in nodes if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))]
    memory = {id(call): names for f in functions for names in [_in_memory(f)] for call in ast.walk(f)}
    return [(node.lineno, name) for node in calls if (name := _name(node, memory.get(id(node), set())))]


def _in_memory(function: ast.AST) -> set[str]:
    """The names in a function that are buffers in memory, or write into one."""
    made = [
        (target.id, node.value)
        for node in ast.walk(function)
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    ]
    made += [
        (node.optional_vars.id, node.context_expr)
        for node in ast.walk(function)
        if isinstance(node, ast.withitem) and isinstance(node.optional_vars, ast.Name)
    ]
    return {name for name, value in made if isinstance(value, ast.Call) and _last(value.func) in _IN_MEMORY}


def _last(function: ast.expr) -> str:
    return (
        function.attr if isinstance(function, ast.Attribute) else function.id if isinstance(function, ast.Name) else ""
    )


def _name(call: ast.Call, memory: set[str]) -> str:
    function = call.func
    if _last(function) in _SAVERS:
        return _last(function) if _saves(call, memory) else ""
    if isinstance(function, ast.Name):
        writes = function.id in _CALLS or (function.id == "open" and _writes(call, 1))
        return function.id if writes else ""
    return _method(call, function) if isinstance(function, ast.Attribute) else ""


def _saves(call: ast.Call, memory: set[str]) -> bool:
    """Whether a package's function writes a file: not into memory, and a zip file not where it is only read."""
    if _last(call.func) == "ZipFile" and not _writes(call, 1):
        return False
    on = call.func.value if isinstance(call.func, ast.Attribute) else None
    first = call.args[0] if call.args else None
    return bool(call.args) and not any(isinstance(one, ast.Name) and one.id in memory for one in (on, first))


def _method(call: ast.Call, function: ast.Attribute) -> str:
    module = function.value.id if isinstance(function.value, ast.Name) else ""
    # Path.replace takes one argument, str.replace two, dataclasses.replace names
    alone = len(call.args) == 1 and not call.keywords and not isinstance(call.args[0], ast.Starred)
    opened = (
        any(word in ast.unparse(call) for word in ("O_WRONLY", "O_RDWR", "O_CREAT"))
        if module == "os"
        else (_writes(call, 0) or _writes(call, 1))  # Path.open, io.open
    )
    writes = (
        function.attr in _CALLS
        or function.attr in _OF_MODULES.get(module, ())
        or (function.attr in ("open", "fdopen") and opened)
        or (function.attr == "replace" and alone)
    )
    return function.attr if writes else ""


def _writes(call: ast.Call, place: int) -> bool:
    modes = [keyword.value for keyword in call.keywords if keyword.arg == "mode"]
    if len(call.args) > place:
        modes.append(call.args[place])
    return any(
        isinstance(mode, ast.Constant) and isinstance(mode.value, str) and set(mode.value) & set("wax+")
        for mode in modes
    )


def files_that_write(root: Path) -> dict[str, list[tuple[int, str]]]:
    """The writing calls by source file of the program, those of `files.py` left out."""
    found = {}
    for folder in (*sorted((root / "core").glob("spherecal*")), root / "spherecal_gui"):
        if folder.name in ("spherecal_sim", "spherecal_study"):  # they write what people ask them to simulate
            continue
        for path in sorted(folder.rglob("*.py")):
            if calls := writing_calls(path.read_text(encoding="utf-8")):
                found[path.relative_to(root).as_posix()] = calls
    found.pop("core/spherecal_files/filesystem.py", None)
    return found
