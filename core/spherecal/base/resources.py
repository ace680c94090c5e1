"""Where the files that ship with the program are: target sets, icons, translations, templates."""

from pathlib import Path

# A wheel carries the folder `resources` inside the package under this name (hatchling's force-include); force-include
# does nothing in an editable install, where the folder is beside core/ in the source tree.
_IN_WHEEL = Path(__file__).resolve().parents[1] / "_resources"
_IN_SOURCE_TREE = Path(__file__).resolve().parents[3] / "resources"


def is_installed() -> bool:
    """Whether this is an installed wheel or bundle, and no checkout."""
    return _IN_WHEEL.is_dir()


def resource_path(*parts: str) -> Path:
    """The path of a shipped file or folder, e.g. `resource_path("target_sets", "dots8.json")`; it may not exist."""
    root = _IN_WHEEL if _IN_WHEEL.is_dir() else _IN_SOURCE_TREE
    return root.joinpath(*parts)
