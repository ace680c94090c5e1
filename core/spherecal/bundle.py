"""The support bundle: a session's observations, settings, result, log and versions in one file to rerun."""

import hashlib
import json
import platform
import re
import shutil
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePosixPath
from typing import Any

from spherecal import __version__
from spherecal.calibrate import CalibrationSettings, calibrate
from spherecal.context import Context
from spherecal.errors import InputError
from spherecal.observe import observed
from spherecal.search import with_missed_targets
from spherecal.session.atomic import write_file_whole
from spherecal.session.bar_registry import certificate_entry, length_entry
from spherecal.session.bundle_file import BUNDLE_FILE, bundle_bytes
from spherecal.session.capture_file import CAPTURE_FILE
from spherecal.session.json_file import read_bytes, read_json
from spherecal.session.model import Session
from spherecal.session.observations_file import write_observations
from spherecal.session.read_session import FORMAT as SESSION_FORMAT
from spherecal.session.read_session import OBSERVATIONS_FILE, SESSION_FILE, VERSION, read_session
from spherecal.session.rig_file import json_bytes

SESSION_FOLDER = "session"
_RESULT_FILES = (
    "rig.json", "covariance.npy", "points.csv", "residuals.csv", "spheres.csv", "bars.csv", "verification.json",
)  # fmt: skip
_PACKAGES = ("numpy", "scipy", "numba", "opencv-python-headless", "matplotlib", "reportlab", "PySide6-Essentials")
_MOST_BYTES = 1 << 30
# Of a bundle that is opened: 1 GB of a hundred cameras' observations, a few thousand images.
_MOST_UNPACKED, _MOST_FILES = 4 << 30, 20_000
_LOG_BYTES = 8 << 20


@dataclass(frozen=True)
class BundleOptions:
    """What to add: a result folder, the cameras.json, logs, the images too; and how the session was calibrated.

    `settings` matter only where the session has images and no observations: they are then made as `calibrate` makes
    them.
    """

    result: Path | None = None
    camera_settings: Path | None = None
    logs: tuple[Path, ...] = ()
    images: bool = False
    settings: CalibrationSettings = field(default_factory=CalibrationSettings)


def write_bundle(
    folder: Path, output: Path, options: BundleOptions | None = None, context: Context | None = None
) -> tuple[str, ...]:
    """Write a session's bundle, a zip file, whole or not at all; the names of the files in it.

    It holds no images unless asked. `calibrate` of the bundle gives the same rig.json as of the session, byte for byte
    where program and packages are the same. InputError where the session cannot be read.
    """
    options, context = options or BundleOptions(), context or Context()
    session = read_session(folder)
    with tempfile.TemporaryDirectory(prefix="spherecal-bundle-") as made:
        root = Path(made)
        own = root / SESSION_FOLDER
        own.mkdir()
        _write_session(folder, session, own, options, context)
        _write_rest(folder, root, options)
        files = sorted(path for path in root.rglob("*") if path.is_file())
        archive = root.with_name(root.name + ".zip")
        try:
            with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as bundle:
                for done, path in enumerate(files):
                    context.report("packing", done / len(files), path.name)
                    bundle.write(path, path.relative_to(root).as_posix())
            write_file_whole(output, archive.read_bytes())
        finally:
            archive.unlink(missing_ok=True)
        return tuple(path.relative_to(root).as_posix() for path in files)


def _write_session(folder: Path, session: Session, own: Path, options: BundleOptions, context: Context) -> None:
    """session.json with bars of the registry filled in, observations, targets, images if asked, bundle.json."""
    document: dict[str, Any] = json.loads(read_bytes(folder / SESSION_FILE, _MOST_BYTES).decode("utf-8-sig"))
    _fill_in_bars(document, session)
    named = document.get("target_set")
    if named is not None:
        target = own / str(named)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(folder / str(named), target)
    if (folder / OBSERVATIONS_FILE).is_file():
        shutil.copyfile(folder / OBSERVATIONS_FILE, own / OBSERVATIONS_FILE)
    else:
        found = with_observations(session, options.settings, context).observations
        assert found is not None
        write_observations(own / OBSERVATIONS_FILE, found)
    if options.images:
        _copy_images(folder, document, own, context)
    (own / SESSION_FILE).write_bytes(json_bytes(document))
    if (folder / CAPTURE_FILE).is_file():
        shutil.copyfile(folder / CAPTURE_FILE, own / CAPTURE_FILE)
    hashes = {path.relative_to(own).as_posix(): _sha256(path) for path in own.rglob("*") if path.is_file()}
    details = {"software": {"name": "SphereCal", "version": __version__}, "images": options.images}
    (own / BUNDLE_FILE).write_bytes(bundle_bytes(session.input_sha256, hashes, details))


def with_observations(session: Session, settings: CalibrationSettings, context: Context) -> Session:
    """A session of images with the very observations that `calibrate` would use."""
    seen = observed(session, context)
    if settings.method in ("board", "bar"):
        return seen
    return with_missed_targets(seen, calibrate(seen, settings, context), context)


def _fill_in_bars(document: dict[str, Any], session: Session) -> None:
    """Whoever opens the bundle has no registry of ours."""
    for entry, bar in zip(document.get("bars") or [], session.bars, strict=True):
        if "lengths" in entry:
            continue
        entry["marks"] = {name: {"target": mark.target, "point": mark.point} for name, mark in bar.marks.items()}
        entry["lengths"] = [length_entry(length) for length in bar.lengths]
        entry["expansion_per_kelvin"] = bar.expansion_per_kelvin
        entry["reference_temperature_c"] = bar.reference_temperature_c
        if bar.certificate is not None:
            entry["certificate"] = certificate_entry(bar.certificate)


def _copy_images(folder: Path, document: dict[str, Any], own: Path, context: Context) -> None:
    places = [*(document.get("placements") or []), *(document.get("bar_poses") or [])]
    names = [name for place in places for name in (place.get("images") or {}).values()]
    for done, name in enumerate(names):
        context.report("copying images", done / len(names), str(name))
        if (folder / name).is_file():
            (own / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(folder / name, own / name)


def _write_rest(folder: Path, root: Path, options: BundleOptions) -> None:
    """Result, settings, logs, and what this machine runs."""
    if options.result is not None:
        _copy_result(options.result, root / "result")
    if options.camera_settings is not None:
        (root / "cameras.json").write_bytes(read_bytes(options.camera_settings, _MOST_BYTES))
    for number, log in enumerate(options.logs, 1):
        text = read_bytes(log, _MOST_BYTES)[-_LOG_BYTES:].decode(errors="replace")
        (root / "logs").mkdir(exist_ok=True)
        (root / "logs" / f"{number}-{re.sub(r'[^A-Za-z0-9._-]', '_', log.name)}").write_text(
            without_home(text), encoding="utf-8"
        )
    (root / "versions.json").write_bytes(json_bytes(versions()))
    (root / "README.txt").write_text(
        "A support bundle of SphereCal.\n\n"
        "session/  the recording: observations, targets, settings; images only if they were asked for\n"
        "result/   what was computed from it, if it was given\n"
        "logs/     log files, if they were given\n\n"
        "Compute it again:  spherecal calibrate BUNDLE.zip -o RESULT\n",
        encoding="utf-8",
    )


def _copy_result(result: Path, to: Path) -> None:
    if not (result / "rig.json").is_file():
        raise InputError(f"{result}: is no result folder, it has no rig.json.", "Name the folder calibrate wrote.")
    to.mkdir()
    for name in _RESULT_FILES:
        if (result / name).is_file():
            shutil.copyfile(result / name, to / name)


def without_home(text: str) -> str:
    """The text with the user's own folder put as ~: a name has no place in a file that is sent away."""
    home = str(Path.home())
    return text.replace(home, "~") if len(home) > 1 else text


def versions() -> dict[str, Any]:
    """Versions: of the program, Python, the system's kind, packages; nothing that names the machine."""
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return {
        "spherecal": __version__, "python": platform.python_version(), "system": platform.system(),
        "machine": platform.machine(), "packages": found,
    }  # fmt: skip


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def session_of(path: Path) -> Iterator[Path]:
    """The session folder at `path`, or that inside a bundle, unpacked for as long as the context lasts.

    InputError for a bundle that is broken, far too large, or names files outside itself.
    """
    if path.is_dir() or path.suffix.lower() != ".zip":
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="spherecal-bundle-") as made:
        unpack(path, Path(made))
        yield Path(made) / SESSION_FOLDER


def unpack(path: Path, to: Path) -> None:
    """Unpack a bundle into an empty folder; InputError as `session_of`."""
    if not path.is_file():
        raise InputError(f"{path}: there is no such file.")
    try:
        with zipfile.ZipFile(path) as bundle:
            members = bundle.infolist()
            _check_members(path, members)
            total = 0
            for member in members:
                if not member.is_dir():
                    total = _unpack_one(path, bundle, member, to, total)
    except (
        zipfile.BadZipFile,
        zipfile.LargeZipFile,
        zlib.error,
        EOFError,
        NotImplementedError,
        RuntimeError,
        OSError,
    ) as error:
        raise InputError(f"{path}: is no bundle that can be unpacked ({error}).", "Have it sent again.") from error
    except ValueError as error:
        raise InputError(f"{path}: is no bundle that can be unpacked ({error}).") from error
    if not (to / SESSION_FOLDER / SESSION_FILE).is_file():
        raise InputError(f"{path}: is no support bundle, it holds no {SESSION_FOLDER}/{SESSION_FILE}.")
    read_json(to / SESSION_FOLDER / SESSION_FILE, SESSION_FORMAT, VERSION)


def _check_members(path: Path, members: list[zipfile.ZipInfo]) -> None:
    if len(members) > _MOST_FILES:
        raise InputError(f"{path}: holds more than {_MOST_FILES} files, which no bundle does.")
    for member in members:
        parts = PurePosixPath(member.filename).parts
        escapes = not parts or ".." in parts or member.filename.startswith("/") or "\\" in member.filename
        if escapes or ":" in parts[0] or "\0" in member.filename or stat.S_ISLNK(member.external_attr >> 16):
            raise InputError(f"{path}: names a file outside itself and is not opened.")
    if sum(member.file_size for member in members) > _MOST_UNPACKED:
        raise InputError(f"{path}: would unpack to more than {_MOST_UNPACKED >> 30} GB.")


def _unpack_one(path: Path, bundle: zipfile.ZipFile, member: zipfile.ZipInfo, to: Path, total: int) -> int:
    """Copy one file, counting what really comes out: a header can lie about it."""
    target = to / member.filename
    target.parent.mkdir(parents=True, exist_ok=True)
    with bundle.open(member) as source, target.open("xb") as file:
        while block := source.read(1 << 20):
            total += len(block)
            if total > _MOST_UNPACKED:
                raise InputError(f"{path}: would unpack to more than {_MOST_UNPACKED >> 30} GB.")
            file.write(block)
    return total
