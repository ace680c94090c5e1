"""The source of images by its name: `genicam`, `replay:FOLDER`, `simulated[:PRESET]`, or an installed package's."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.base.plugins import CAMERA_SOURCES, load, names
from spherecal_cameras.protocol import CameraSource

if TYPE_CHECKING:
    from spherecal_cameras.genicam.trust import Ask

_OWN = ("genicam", "replay", "simulated")


def open_source(
    name: str = "genicam", producers: Sequence[str] = (), faults: Sequence[str] = (), ask: "Ask | None" = None
) -> CameraSource:
    """The source of images of this name."""
    kind, _, what = name.partition(":")
    if faults and kind != "simulated":
        raise InputError(Phrase("error-faults-simulated"))
    if kind == "genicam" and not what:
        from spherecal_cameras.genicam.genicam_source import GenicamSource

        return GenicamSource(producers, ask=ask)
    if kind == "replay" and what:
        from spherecal_cameras.replay import ReplaySource

        return ReplaySource(Path(what))
    if kind == "simulated":
        from spherecal_cameras.simulated.camera_faults import parse_fault
        from spherecal_cameras.simulated.simulated_source import SimulatedSource

        return SimulatedSource(what or "demo", faults=[parse_fault(text) for text in faults])
    made = load(CAMERA_SOURCES, kind) if kind not in _OWN else None
    if made is not None:
        source = made(what)
        if not isinstance(source, CameraSource):
            raise InputError(Phrase("error-source-protocol", {"kind": repr(kind)}))
        return source
    others = ", ".join(one for one in names(CAMERA_SOURCES) if one not in _OWN)
    raise InputError(
        Phrase("error-no-source", {"name": repr(name)}),
        Phrase("error-sources-installed", {"others": others}) if others else Phrase("error-sources"),
    )
