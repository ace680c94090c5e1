"""The source of images by its name: `genicam`, `replay:FOLDER` or `simulated[:PRESET]`."""

from collections.abc import Sequence
from pathlib import Path

from spherecal.cameras.protocol import CameraSource
from spherecal.errors import InputError


def open_source(name: str = "genicam", producers: Sequence[str] = (), faults: Sequence[str] = ()) -> CameraSource:
    """The source of this name; `producers` are .cti files or folders for genicam, `faults` those of a simulated rig.

    InputError for a name that is not known, a folder that is no session, a fault that is not understood.
    """
    kind, _, what = name.partition(":")
    if faults and kind != "simulated":
        raise InputError("Faults can only be simulated.", "Take the source `simulated`.")
    if kind == "genicam" and not what:
        from spherecal.cameras.gentl.source import GenicamSource

        return GenicamSource(producers)
    if kind == "replay" and what:
        from spherecal.cameras.replay import ReplaySource

        return ReplaySource(Path(what))
    if kind == "simulated":
        from spherecal.cameras.simulated.faults import parse_fault
        from spherecal.cameras.simulated.source import SimulatedSource

        return SimulatedSource(what or "demo", faults=[parse_fault(text) for text in faults])
    raise InputError(
        f"There is no camera source {name!r}.", "Sources are genicam, replay:FOLDER and simulated[:PRESET]."
    )
