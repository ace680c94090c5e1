"""Files and folders written whole or not at all."""

import ctypes
import json
import os
import secrets
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from spherecal.base.errors import InputError, OutputError, reason
from spherecal.base.interrupts import uninterrupted
from spherecal.base.messages.values import Phrase
from spherecal_files import filesystem as files
from spherecal_files.lock import locked, short_name

WRITTEN_FILE = "written.json"  # lists the files of a folder whose names do not follow from its kind
WRITTEN_FORMAT = "spherecal/written"
_IMAGES = {".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".pgm", ".pnm"}
_MOST_MARKER_BYTES = 64 << 20
_ASIDE = ".spherecal-old"


@dataclass(frozen=True)
class Marker:
    """A kind of folder by its file, `format` and names; `proof`: must be there too; `listed`: a field naming more."""

    file: str
    format: str
    names: frozenset[str] = frozenset()
    image_folders: frozenset[str] = frozenset()
    proof: str = ""
    listed: str = ""


RESULT = Marker(
    "rig.json", "spherecal/rig",
    frozenset({
        "rig.json", "findings.json", "covariance.npy", "ball.json", "points.csv", "residuals.csv", "spheres.csv",
        "observations.csv", "bars.csv", "verification.json", "report.pdf", "report.html", "report.json", "report.xml",
        "frame.json", "image_motions.csv",
    }),
)  # fmt: skip
SESSION = Marker(
    "session.json",
    "spherecal/session",
    frozenset({"session.json", "targets.json", "observations.csv", "truth.json", "truth_dots.csv"}),
    frozenset({"placements", "bars"}),
    proof="truth.json",
)


def write_file_whole(path: Path, data: bytes) -> None:
    """Write a file that the user named: at every moment there is the old one or the whole new one."""
    files.write_whole(path, data)


def write_folder_whole(folder: Path, build: Callable[[Path], None], marker: Marker) -> None:
    """Let `build` fill a new folder beside `folder`, then put it in its place, in one step where the system can.

    A missing or empty folder is filled, an older result (by its marker, with no other files) replaced whole. After a
    crash the next `check_folder` restores. Two programs that write one folder do it one after the other.
    """
    resolved = check_folder(folder, marker)
    with _plain_errors(folder):
        parent = resolved.parent
        made = [one for one in (parent, *parent.parents) if not one.exists()]  # the innermost first
        parent.mkdir(parents=True, exist_ok=True)
    try:
        with locked(resolved), _plain_errors(folder):
            _refuse_others(folder, resolved, marker)  # again: it may have been written since
            # what a writer left half done when it was killed; whoever holds the lock is the only one
            for path in resolved.parent.glob(f".{short_name(resolved)}-*{files.PARTIAL}"):
                if not path.is_symlink():
                    files.remove_own_folder(path)
            partial = resolved.with_name(f".{short_name(resolved)}-{secrets.token_hex(4)}{files.PARTIAL}")
            try:
                partial.mkdir()
                build(partial)
                _keep_modes(resolved, partial)
                for inner, _, names in os.walk(partial):
                    for name in names:
                        files.sync(Path(inner, name))
                    files.sync(Path(inner))
                with uninterrupted(commit=True):
                    _put_in_place(partial, resolved, marker)
            finally:
                with uninterrupted():
                    files.remove_own_folder(partial)
    except BaseException:
        for one in made:
            with suppress(OSError):
                one.rmdir()
        raise


def check_folder(folder: Path, marker: Marker) -> Path:
    """The folder with links resolved, if it may be written (see write_folder_whole).

    To be asked before long work, so that it is not done in vain. Undoes what a crash left of an earlier writing.
    """
    try:
        resolved = Path(os.path.realpath(folder))  # a link's goal is replaced and not the link
    except ValueError:
        raise OutputError(Phrase("error-null-in-path")) from None
    if not resolved.name:
        raise OutputError(Phrase("error-not-writable", {"file": folder}))
    with _plain_errors(folder):
        if _aside(resolved).is_dir():
            with locked(resolved):
                _recover(resolved, marker)
        _refuse_others(folder, resolved, marker)
        base = next(p for p in resolved.parents if p.exists())
        trial = base / f".{secrets.token_hex(6)}{files.PARTIAL}"
        with uninterrupted():
            trial.mkdir()
            trial.rmdir()
    return resolved


def _refuse_others(folder: Path, resolved: Path, marker: Marker) -> None:
    if resolved.exists() and not resolved.is_dir():
        raise OutputError(Phrase("error-is-file", {"folder": folder}))
    if resolved.is_dir() and not os.access(resolved, os.W_OK | os.X_OK):
        what = Phrase("error-cannot-write", {"file": str(folder), "why": Phrase("no-permission")})
        raise OutputError(what, Phrase("error-name-output"))
    if not resolved.is_dir() or not any(resolved.iterdir()):
        return
    if not _is_older_result(resolved, marker):
        raise OutputError(Phrase("error-holds-other", {"folder": folder}))
    if others := files.strangers(resolved, _known(resolved, marker)):
        values = {"folder": folder, "files": [files.shown_name(one) for one in others]}
        raise OutputError(Phrase("error-holds-strangers", values))


def make_parent(path: Path, hint: Phrase) -> None:
    """Make the folder for a file of the user's settings."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(Phrase("error-cannot-write", {"file": path, "why": reason(error)}), hint) from error


def _is_older_result(folder: Path, marker: Marker) -> bool:
    """Whether the marker's file is there and ours. A recording is never taken for an older result of something else."""
    if marker != SESSION and (folder / SESSION.file).exists():
        return False
    if marker.proof and not (folder / marker.proof).exists() and not (folder / WRITTEN_FILE).exists():
        return False
    return _document(folder, marker.file).get("format") == marker.format


def _document(folder: Path, name: str) -> dict[str, object]:
    try:
        document = json.loads(files.read_below(folder, name, _MOST_MARKER_BYTES))
    except (InputError, ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}


def _known(folder: Path, marker: Marker) -> files.Known:
    """Which files in a folder of this kind we wrote."""
    listed: set[str] = set()
    written = _document(folder, WRITTEN_FILE)
    if written.get("format") == WRITTEN_FORMAT and isinstance(written.get("files"), list):
        listed |= {WRITTEN_FILE, *(one for one in written["files"] if isinstance(one, str))}  # type: ignore[union-attr]
    if marker.listed and isinstance(named := _document(folder, marker.file).get(marker.listed), dict):
        listed |= set(named)

    def known(relative: str) -> bool:
        path = PurePosixPath(relative)
        image = path.suffix.lower() in _IMAGES or relative.endswith("/")
        if relative in marker.names or relative == marker.file or relative in listed:
            return True
        top = relative.split("/", 1)[0]
        return len(path.parts) <= 3 and top in marker.image_folders and image

    return known


def written_bytes(names: list[str]) -> bytes:
    """written.json: the files of a folder that may be replaced as a whole."""
    document = {"format": WRITTEN_FORMAT, "version": 1, "files": sorted(names)}
    return (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode()


def _aside(folder: Path) -> Path:
    return folder.with_name(f".{short_name(folder)}{_ASIDE}")


def _recover(folder: Path, marker: Marker) -> None:
    """Undo what a crash left: the old folder moved aside comes back, or goes if the new one is in place."""
    aside = _aside(folder)
    if not aside.is_dir():
        return
    if folder.exists():
        files.remove_folder_below(aside.parent, aside.name, _known(aside, marker))
    else:
        files.move_below(aside.parent, aside.name, folder.name)


def _put_in_place(partial: Path, folder: Path, marker: Marker) -> None:
    parent, aside = folder.parent, _aside(folder)
    if folder.exists():
        known = _known(folder, marker)
        if _exchange(partial, folder):  # the old one has the partial one's name now
            with files.confirming(folder):
                files.sync(parent)
            gone = False
            with suppress(OutputError):  # the new one is in its place: that the old one does not go is no failure
                gone = files.remove_folder_below(parent, partial.name, known)
            if not gone:
                # what somebody else put into the old folder at the last moment is kept, beside the new one
                files.move_below(parent, partial.name, partial.name.removesuffix(files.PARTIAL) + "-kept")
            return
        files.move_below(parent, folder.name, aside.name)
    try:
        files.move_below(parent, partial.name, folder.name)
    except BaseException:
        _recover(folder, marker)
        raise
    with files.confirming(folder):
        files.sync(parent)
    if aside.is_dir():
        with suppress(OutputError):  # as above
            files.remove_folder_below(parent, aside.name, _known(aside, marker))


def _exchange(a: Path, b: Path) -> bool:
    """Exchange two folders in one step, so that no moment has neither; False where the system cannot do it."""
    if sys.platform != "linux" or a.parent != b.parent:
        return False
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    at_here, exchange = -100, 2
    return rename(at_here, os.fsencode(a), at_here, os.fsencode(b), exchange) == 0


def _keep_modes(old: Path, new: Path) -> None:
    """Give the new files the modes of the old ones of the same name: what was private stays so."""
    if os.name == "nt" or not old.is_dir():
        return
    new.chmod(stat.S_IMODE(old.stat().st_mode))
    for path in new.rglob("*"):
        with suppress(FileNotFoundError):
            before = (old / path.relative_to(new)).lstat()
            if not files.is_link(before):
                path.chmod(stat.S_IMODE(before.st_mode))


@contextmanager
def _plain_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        what = Phrase("error-cannot-write", {"file": str(path), "why": reason(error)})
        raise OutputError(what, Phrase("error-name-place")) from error
