"""A support bundle: what somebody needs to help, without a single image."""

import io
import zipfile
from pathlib import Path

from spherecal.errors import OutputError
from spherecal.session.atomic import write_file_whole

_SUFFIXES = {".json", ".csv", ".log", ".txt"}
_MOST_BYTES = 50 << 20


def make_bundle(output: Path, project: Path | None, log_text: str, about: str) -> int:
    """Write a zip of the project's tables and settings, the log and the versions; how many files.

    Images are left out; so is any single file beyond 50 MB. OutputError where it cannot be written.
    """
    files = sorted(_tables(project)) if project is not None else []
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as bundle:
        bundle.writestr("about.txt", about)
        bundle.writestr("log.txt", log_text)
        for path in files:
            assert project is not None
            bundle.write(path, f"project/{path.relative_to(project).as_posix()}")
    try:
        output.parent.mkdir(parents=True, exist_ok=True)  # nobody has begun anything here yet
    except OSError as error:
        raise OutputError(f"{output.parent}: cannot be made: {error.strerror}.", "Choose another folder.") from error
    write_file_whole(output, data.getvalue())
    return len(files) + 2


def _tables(folder: Path) -> list[Path]:
    found = (path for path in folder.rglob("*") if path.suffix in _SUFFIXES and path.is_file())
    return [path for path in found if path.stat().st_size <= _MOST_BYTES]
