"""Where what can be made again is kept: the user's cache."""

import os
import tempfile
from pathlib import Path


def cache_folder(name: str) -> Path:
    """The folder `name` in the user's cache, else (mode 700) among temporary files, for what can be made again.

    What is in a cache is trusted, so a folder that somebody else has made under that name is not taken.
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
