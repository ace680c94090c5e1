"""The support bundle: a session's observations, settings, result, log and versions in one file to rerun."""

import hashlib
import json
import platform
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePosixPath
from typing import Any

from spherecal import __version__
from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.calibrate import calibrate
from spherecal.data.session import Session
from spherecal.detect.redetection import Located, with_missed_targets
from spherecal.detect.session_images import observed
from spherecal.steps.settings import CalibrationSettings
from spherecal_documents.support.redact import Redactor
from spherecal_files.bar_registry import figures_entry
from spherecal_files.bundle_file import BUNDLE_FILE, bundle_bytes
from spherecal_files.capture_file import CAPTURE_FILE
from spherecal_files.filesystem import as_id, new_file, read_below, write_whole
from spherecal_files.json_file import json_bytes, read_bytes, read_json
from spherecal_files.read_session import FORMAT as SESSION_FORMAT
from spherecal_files.read_session import OBSERVATIONS_FILE, SESSION_FILE, VERSION, read_session
from spherecal_files.table_file import observations_bytes
from spherecal_rigs.result_folder import RESULT_FILES

SESSION_FOLDER = "session"
_PACKAGES = ("numpy", "scipy", "numba", "opencv-python-headless", "matplotlib", "typst", "PySide6-Essentials")
_MOST_BYTES = 1 << 30
# Of a bundle that is opened: 1 GB of a hundred cameras' observations, a few thousand images.
_MOST_UNPACKED, _MOST_FILES = 4 << 30, 20_000
_LOG_BYTES = 8 << 20
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip file knows: when it was packed does not matter


@dataclass(frozen=True)
class BundleOptions:
    """What to add: a result folder, the cameras.json, logs, the images too; and how the session was calibrated."""

    result: Path | None = None
    camera_settings: Path | None = None
    logs: tuple[Path, ...] = ()
    images: bool = False
    settings: CalibrationSettings = field(default_factory=CalibrationSettings)  # for images without observations
    names: bool = False  # users, hosts and serial numbers stay as they are


@dataclass(frozen=True)
class BundleContents:
    """A bundle's files with their sizes in bytes, what was taken out, and the names replaced, never written."""

    files: Mapping[str, int]
    redacted: tuple[str, ...]
    names: tuple[str, ...] = ()


def write_bundle(
    folder: Path,
    output: Path,
    options: BundleOptions | None = None,
    context: Context | None = None,
    announce: Callable[[BundleContents], None] | None = None,
) -> tuple[str, ...]:
    """Write a session's bundle (zip) whole: `calibrate` of it gives the same rig.json; the names of its files."""
    options, context = options or BundleOptions(), context or Context()
    session = read_session(folder)
    data = _session_files(folder, session, options, context) | _rest(options)
    redacted: tuple[str, ...] = ("nothing: names were asked for",)
    names: tuple[str, ...] = ()
    images = {name: (name, size) for name, size in (_images(folder, context) if options.images else {}).items()}
    if not options.names:
        redactor = Redactor(data)
        data = {redactor.path(name): redactor.file(name, one) for name, one in data.items()}
        images = {redactor.text(name): one for name, one in images.items()}  # as session.json has them then
        redacted, names = redactor.summary(), redactor.replaced()
    own = {name.partition("/")[2]: one for name, one in data.items() if name.startswith(f"{SESSION_FOLDER}/")}
    hashes = {name: hashlib.sha256(one).hexdigest() for name, one in own.items()}
    for name, (file, _) in images.items():
        hashes[name] = hashlib.sha256(read_below(folder, file, _MOST_BYTES)).hexdigest()
    details = {"software": {"name": "SphereCal", "version": __version__}, "images": options.images}
    data[f"{SESSION_FOLDER}/{BUNDLE_FILE}"] = bundle_bytes(session.input_sha256, hashes, details)
    sizes = {name: len(one) for name, one in data.items()}
    sizes |= {f"{SESSION_FOLDER}/{name}": size for name, (_, size) in images.items()}
    contents = BundleContents(dict(sorted(sizes.items())), redacted, names)
    data["README.txt"] = _readme(contents).encode()
    if announce is not None:
        announce(contents)
    files: dict[str, Callable[[], bytes]] = {name: partial(data.__getitem__, name) for name in data}
    for name, (file, _) in images.items():
        files[f"{SESSION_FOLDER}/{name}"] = partial(read_below, folder, file, _MOST_BYTES)
    write_zip(output, files, context)
    return tuple(sorted(files))


def write_zip(output: Path, files: Mapping[str, Callable[[], bytes]], context: Context | None = None) -> None:
    """Write a zip file whole, one file after the other. Nobody else can read it before it is in its place."""
    with tempfile.TemporaryFile() as archive:
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as bundle:
            for done, (name, read) in enumerate(sorted(files.items())):
                if context is not None:
                    context.report("packing", done / len(files), name)
                bundle.writestr(zipfile.ZipInfo(name, _ZIP_TIME), read(), zipfile.ZIP_DEFLATED)
        archive.seek(0)
        write_whole(output, archive)


def _session_files(folder: Path, session: Session, options: BundleOptions, context: Context) -> dict[str, bytes]:
    """session.json with bars of the registry filled in, observations, targets, images if asked; no link is followed."""
    document: dict[str, Any] = json.loads(read_below(folder, SESSION_FILE, _MOST_BYTES).decode("utf-8-sig"))
    for entry, bar in zip(document.get("bars") or [], session.bars, strict=True):
        if "lengths" not in entry:  # whoever opens the bundle has no registry of ours
            entry.update(figures_entry(bar))
    own = {SESSION_FILE: json_bytes(document)}
    if document.get("target_set") is not None:
        own[_plain(document["target_set"])] = read_below(folder, _plain(document["target_set"]), _MOST_BYTES)
    if (folder / OBSERVATIONS_FILE).exists():
        own[OBSERVATIONS_FILE] = read_below(folder, OBSERVATIONS_FILE, _MOST_BYTES)
    else:
        found = with_observations(session, options.settings, context).observations
        assert found is not None
        own[OBSERVATIONS_FILE] = observations_bytes(found)
    if (folder / CAPTURE_FILE).exists():
        own[CAPTURE_FILE] = read_below(folder, CAPTURE_FILE, _MOST_BYTES)
    return {f"{SESSION_FOLDER}/{name}": one for name, one in own.items()}


def _plain(name: str) -> str:
    """A path as session.json may have it (`./a//b`), as the bundle has it."""
    return PurePosixPath(name).as_posix()


def with_observations(session: Session, settings: CalibrationSettings, context: Context) -> Session:
    """A session of images with the very observations that `calibrate` would use."""
    seen = observed(session, context)
    if settings.method in ("board", "bar"):
        return seen
    return with_missed_targets(seen, Located.of(calibrate(seen, settings, context)), context)


def _images(folder: Path, context: Context) -> dict[str, int]:
    """The images that session.json names and that are there: size in bytes by name."""
    document: dict[str, Any] = json.loads(read_below(folder, SESSION_FILE, _MOST_BYTES).decode("utf-8-sig"))
    places = [*(document.get("placements") or []), *(document.get("bar_poses") or [])]
    names = [_plain(name) for place in places for name in (place.get("images") or {}).values()]
    found: dict[str, int] = {}
    for done, name in enumerate(names):
        context.report("looking at images", done / len(names), name)
        if (folder / name).exists():
            found[name] = (folder / name).stat().st_size
    if sum(found.values()) > _MOST_UNPACKED:
        raise InputError(Phrase("error-bundle-images", {"folder": folder, "gigabytes": _MOST_UNPACKED >> 30}))
    return found


def _rest(options: BundleOptions) -> dict[str, bytes]:
    """Result, settings, logs, and what this machine runs."""
    found: dict[str, bytes] = {}
    if (result := options.result) is not None:
        if not (result / "rig.json").is_file():
            raise InputError(Phrase("error-no-result", {"folder": result}))
        there = [name for name in RESULT_FILES if (result / name).exists() or (result / name).is_symlink()]
        found |= {f"result/{name}": read_below(result, name, _MOST_BYTES) for name in there}
    if options.camera_settings is not None:
        found["cameras.json"] = read_bytes(options.camera_settings, _MOST_BYTES)
    for number, log in enumerate(options.logs, 1):
        name = f"logs/{number}-{as_id(log.name, 'log')}"
        found[name if name.endswith((".log", ".txt")) else f"{name}.txt"] = read_bytes(log, _MOST_BYTES)[-_LOG_BYTES:]
    found["versions.json"] = json_bytes(versions())
    return found


def _readme(contents: BundleContents) -> str:
    lines = [f"  {name}  {size} bytes" for name, size in contents.files.items()]
    return (
        "A support bundle of SphereCal.\n\n"
        "session/  the recording: observations, targets, settings; images only if they were asked for\n"
        "result/   what was computed from it, if it was given\n"
        "logs/     log files, if they were given\n\n"
        "Compute it again:  spherecal calibrate BUNDLE.zip -o RESULT\n\n"
        f"Replaced in it: {'; '.join(contents.redacted)}.\n\n" + "\n".join(lines) + "\n"
    )


def versions() -> dict[str, Any]:
    """Versions: of the program, Python, the system's kind, packages; nothing that names the machine."""
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return {
        "spherecal": __version__,
        "python": platform.python_version(),
        "system": platform.system(),
        "machine": platform.machine(),
        "packages": found,
    }


@contextmanager
def unpacked_session(path: Path) -> Iterator[Path]:
    """The session folder inside a bundle, unpacked for as long as the context lasts."""
    with tempfile.TemporaryDirectory(prefix="spherecal-bundle-") as made:
        unpack(path, Path(made))
        yield Path(made) / SESSION_FOLDER


def unpack(path: Path, to: Path) -> None:
    """Unpack a bundle into an empty folder."""
    if not path.is_file():
        raise InputError(Phrase("error-no-file", {"file": path}))
    try:
        with zipfile.ZipFile(path) as bundle:
            members = bundle.infolist()
            _check_members(path, members)
            total = 0
            for member in members:
                if not member.is_dir():
                    total = _unpack_one(path, bundle, member, to, total)
    except (zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError) as error:
        raise InputError(Phrase("error-not-unpacked", {"file": path, "why": str(error)})) from error
    if not (to / SESSION_FOLDER / SESSION_FILE).is_file():
        raise InputError(Phrase("error-no-bundle", {"file": path, "name": f"{SESSION_FOLDER}/{SESSION_FILE}"}))
    read_json(to / SESSION_FOLDER / SESSION_FILE, SESSION_FORMAT, VERSION)


def _check_members(path: Path, members: list[zipfile.ZipInfo]) -> None:
    if len(members) > _MOST_FILES:
        raise InputError(Phrase("error-bundle-many", {"file": path, "most": _MOST_FILES}))
    for member in members:
        parts = PurePosixPath(member.filename).parts
        escapes = not parts or ".." in parts or member.filename.startswith("/") or "\\" in member.filename
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):  # others need far more memory
            raise InputError(Phrase("error-not-unpacked", {"file": path, "why": f"compression {member.compress_type}"}))
        if escapes or ":" in parts[0] or "\0" in member.filename or stat.S_ISLNK(member.external_attr >> 16):
            raise InputError(Phrase("error-bundle-escapes", {"file": path}))
    if sum(member.file_size for member in members) > _MOST_UNPACKED:
        raise InputError(Phrase("error-bundle-large", {"file": path, "gigabytes": _MOST_UNPACKED >> 30}))


def _unpack_one(path: Path, bundle: zipfile.ZipFile, member: zipfile.ZipInfo, to: Path, total: int) -> int:
    """Copy one file, counting what really comes out: a header can state another size."""
    with bundle.open(member) as source, new_file(to, member.filename) as file:
        while block := source.read(1 << 20):
            total += len(block)
            if total > _MOST_UNPACKED:
                raise InputError(Phrase("error-bundle-large", {"file": path, "gigabytes": _MOST_UNPACKED >> 30}))
            file.write(block)
    return total
