"""Makers of cameras, their drivers' packages, and where their .cti files are (resources/camera_makers.toml)."""

import os
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spherecal.base.resources import resource_path


@dataclass(frozen=True)
class Maker:
    """A maker, its driver's package, file names and folders (with `*` for versions) on Linux, Windows and macOS."""

    name: str
    driver: str
    files: tuple[str, ...]
    linux: tuple[str, ...] = ()
    windows: tuple[str, ...] = ()
    macos: tuple[str, ...] = ()
    source: str = ""
    variables: tuple[str, ...] = ()  # folders or files below a variable that its installer sets: `{VARIABLE}/cti`
    aliases: tuple[str, ...] = ()  # other words by which its cameras name their maker, in small letters

    def folders(self, system: str) -> tuple[str, ...]:
        """The folders on a system, by Python's name of it (`linux`, `win32`, `darwin`)."""
        return {"linux": self.linux, "win32": self.windows, "darwin": self.macos}.get(system, ())


TABLE: dict[str, Any] = tomllib.loads(resource_path("camera_makers.toml").read_text(encoding="utf-8"))
_ROWS: list[dict[str, Any]] = [
    {key: tuple(one) if isinstance(one, list) else one for key, one in row.items()} for row in TABLE["maker"]
]
MAKERS = tuple(Maker(**row) for row in _ROWS)
# Any maker's GigE Vision and USB3 Vision cameras, on Linux: our own, after the makers' own.
ANY_MAKER = Maker("", "Aravis", ("spherecal_aravis.cti",), ("/opt/spherecal/cti",), source="our own")
_FIRST = {"linux": ("/opt/*/lib/x86_64",)}
_LAST = {"darwin": ("/Library/Application Support/*/cti",)}
# Folders that also hold whatever other programs put there: only a maker's own files are taken from them.
_SHARED = ("/usr/lib",)


def own_folder() -> Path:
    """Where the built-in driver is put for this user (`builtin_driver.prepare`); it may not exist."""
    from platformdirs import user_data_path

    return user_data_path("spherecal", appauthor=False) / "cti"


def driver_folders(system: str) -> tuple[str, ...]:
    """The folders of drivers on a system, with `*`, in the order in which they are tried."""
    own = [folder for maker in (*MAKERS, ANY_MAKER) for folder in maker.folders(system)]
    return (*_FIRST.get(system, ()), *own, *_LAST.get(system, ()))


def driver_patterns(system: str, environment: Mapping[str, str] = os.environ) -> Iterator[str]:
    """Patterns of driver files on a system, in the order in which they are tried: of folders, then of variables."""
    separator = "\\" if system == "win32" else "/"
    files = {folder: maker.files for maker in MAKERS for folder in maker.folders(system) if folder in _SHARED}
    for folder in driver_folders(system):
        yield from (f"{folder}{separator}{file}" for file in files.get(folder, ("*.cti",)))
    for maker in MAKERS:
        for place in maker.variables:
            name = place[1 : place.index("}")]
            if known := environment.get(name, ""):
                named = place.replace(f"{{{name}}}", known.rstrip("/\\"))
                yield named if named.endswith(".cti") else f"{named}{separator}*.cti"


def maker_of(vendor: str) -> Maker | None:
    """The maker that a camera names, whatever it adds (`Basler AG`, `AVT`); None where it is none of these."""
    said = "".join(filter(str.isalnum, vendor)).lower()
    for maker in MAKERS:
        own = "".join(filter(str.isalnum, maker.name)).lower()
        if said and any(said.startswith(word) or word in said for word in (own, *maker.aliases) if len(word) > 3):
            return maker
        if any(said == word for word in (own, *maker.aliases)) or vendor.split()[:1] == [maker.name]:
            return maker
    return None
