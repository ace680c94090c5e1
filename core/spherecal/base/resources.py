"""Where the files that ship with the program are: target sets, icons, translations, templates."""

import os
import tempfile
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


def cache_folder(name: str) -> Path:
    """A folder for what can be made again, `name` in the user's cache; it may not exist yet.

    Where nothing can be written there, it is one of the user's own (mode 700) among the temporary files. What is in a
    cache is trusted, so a folder that somebody else has made under that name is not taken.
    """
    from platformdirs import user_cache_path

    kept = user_cache_path("spherecal", appauthor=False)
    # os.path, since Path.exists raises where a folder on the way is another user's
    there = next(folder for folder in (kept, *kept.parents) if os.path.exists(folder))
    if os.access(there, os.W_OK) or os.name == "nt":
        return kept / name
    own = Path(tempfile.gettempdir()) / f"spherecal-cache-{os.getuid()}"
    try:
        own.mkdir(mode=0o700, exist_ok=True)
        state = own.lstat()
    except OSError:
        return kept / name  # whoever writes there says what is wrong
    if own.is_symlink() or state.st_uid != os.getuid() or state.st_mode & 0o077:
        own = Path(tempfile.mkdtemp(prefix="spherecal-cache-"))
    return own / name


def manual_page(language: str = "en") -> Path | None:
    """The manual's first page in a language (en, de, zh), offline; None in a checkout before `dev.py docs`."""
    page = "index.html" if language == "en" else f"guide/{language}/index.html"
    for folder in (_IN_WHEEL / "manual", _IN_SOURCE_TREE.parent / "build" / "site"):
        if (folder / page).is_file():
            return folder / page
    return None
