"""SphereCal's own driver, for GigE Vision and USB3 Vision cameras of any maker, on libaravis (Linux).

found = state()
if found.kind in ("installed", "can-be-built"):
prepare(context)                 # allowed and in use: the next search for cameras loads it
else:
show(found.install)              # the line that brings what it lacks
"""

import ctypes.util
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.filesystem import write_whole
from spherecal.base.messages.values import Phrase
from spherecal_cameras.genicam.trust import TrustStore
from spherecal_cameras.makers import ANY_MAKER, own_folder
from spherecal_gentl.producer.build_producer import ARAVIS_CTI_FILE, aravis_flags, build_producer, cxx_compiler

Lack = Literal["linux", "libaravis", "libaravis-dev", "compiler"]
_PACKAGES = {"libaravis": "libaravis-0.8-0", "libaravis-dev": "libaravis-dev pkg-config", "compiler": "g++"}


@dataclass(frozen=True)
class BuiltinDriver:
    """Whether the built-in driver can be used: its file where there is one, what it lacks where not.

    `installed`: a file is there that came with SphereCal or that `prepare` built, and searches for cameras find it.
    `install` is the command line that brings what is lacking (Debian, Ubuntu); empty where nothing can.
    """

    kind: Literal["installed", "can-be-built", "lacking"]
    file: Path | None = None
    lacks: tuple[Lack, ...] = ()
    install: str = ""


def state() -> BuiltinDriver:
    """What there is of the built-in driver on this machine; looks only, in some milliseconds."""
    if not sys.platform.startswith("linux"):
        return BuiltinDriver("lacking", lacks=("linux",))
    shipped = [Path(folder) / ARAVIS_CTI_FILE for folder in ANY_MAKER.linux]
    file = next((file for file in (*shipped, own_folder() / ARAVIS_CTI_FILE) if file.is_file()), None)
    lacks = _lacks_to_run() if file is not None else (*_lacks_to_run(), *_lacks_to_build())
    if lacks:
        packages = " ".join(dict.fromkeys(_PACKAGES[one] for one in lacks))
        return BuiltinDriver("lacking", file, lacks=lacks, install=f"sudo apt install {packages}")
    return BuiltinDriver("can-be-built") if file is None else BuiltinDriver("installed", file)


def _lacks_to_run() -> tuple[Lack, ...]:
    return () if ctypes.util.find_library("aravis-0.8") else ("libaravis",)


def _lacks_to_build() -> tuple[Lack, ...]:
    lacks: list[Lack] = []
    try:
        aravis_flags()
    except InputError:
        lacks.append("libaravis-dev")
    try:
        cxx_compiler()
    except InputError:
        lacks.append("compiler")
    return tuple(lacks)


def prepare(context: Context | None = None) -> Path:
    """Bring the built-in driver into use, built where it was not shipped; its file. Takes some seconds the first time.

    It is allowed like a driver that somebody has said yes to: calling this is that yes.
    """
    found = state()
    if found.kind == "lacking":
        raise InputError(Phrase("error-builtin-driver", {"packages": found.install or "Linux"}))
    if context is not None:
        context.report("building the camera driver", 0.0)
    file = found.file
    if file is None or file.parent == own_folder():  # an update of SphereCal may have brought newer sources
        file = own_folder() / ARAVIS_CTI_FILE
        if not _lacks_to_build():
            made = build_producer(aravis=True)
            file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_whole(file, made.read_bytes())
    store = TrustStore()
    driver = store.look(str(file))
    if driver.state in ("new", "changed"):
        store.allow(driver)
    return file
