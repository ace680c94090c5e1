"""Why no camera is found, in words: what it means and what to do on this system; makers and their drivers."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from spherecal_cameras.builtin_driver import BuiltinDriver, DriverTrouble, state
from spherecal_cameras.camera_network import InterfaceFact
from spherecal_cameras.makers import ANY_MAKER, MAKERS, maker_of
from spherecal_gui import languages
from spherecal_gui.languages import translate
from spherecal_gui.standing import Level

ENVIRONMENT = "GENICAM_GENTL64_PATH"


@dataclass(frozen=True)
class DriverNote:
    """What is in the way and what to do."""

    title: str
    steps: tuple[str, ...]
    allow: str = ""  # a driver's file that can be allowed with one click
    details: str = ""  # for the person at the desk
    builtin: bool = False  # the built-in driver can be used instead
    cure: str = ""  # a command that can be run from here
    level: Level = "bad"


def driver_notes(
    troubles: Sequence[DriverTrouble], system: str = sys.platform, builtin: BuiltinDriver | None = None
) -> list[DriverNote]:
    """One note for each trouble, one for all drivers without cameras; `builtin` None is looked for, some ms."""
    windows = system.startswith("win")
    notes = []
    without = [one.file for one in troubles if one.kind == "no-cameras"]
    wrong = [one for one in troubles if one.kind == "wrong-driver"]
    builtin = builtin or (state() if troubles else BuiltinDriver("lacking"))
    for one in troubles:
        if one.kind == "no-driver":
            notes.append(_no_driver(one.makers, windows, builtin))
        elif one.kind == "not-allowed":
            notes.append(_not_allowed(one))
        elif one.kind == "not-loaded":
            notes.append(_not_loaded(one, builtin))
    if wrong:
        notes.append(_wrong_driver(wrong, builtin))
    if without:
        notes.append(_no_cameras(without, windows))
    return notes


def _no_driver(makers: Sequence[str], windows: bool, builtin: BuiltinDriver) -> DriverNote:
    own = translate("Drivers", "Install the driver package of the cameras' maker, then search again.")
    other = translate("Drivers", "Installed already? {name} must name the folder of its .cti file.")
    if windows:
        own = translate("Drivers", "Install the 64-bit driver package of the cameras' maker, then restart SphereCal.")
    steps = (own, *_packages(makers), *_builtin_lacks(builtin))
    title, details = translate("Drivers", "No camera driver is installed."), other.format(name=ENVIRONMENT)
    return DriverNote(title, steps, details=details, builtin=builtin.kind != "lacking")


def _packages(makers: Sequence[str]) -> list[str]:
    return [f"{name}: {maker.driver}" for name in makers if (maker := maker_of(name)) is not None]


def _builtin_lacks(builtin: BuiltinDriver) -> list[str]:
    text = translate("Drivers", "Or the built-in driver, for GigE and USB3 Vision cameras of any maker: {line}")
    return [text.format(line=builtin.install)] if builtin.install else []


def _wrong_driver(troubles: Sequence[DriverTrouble], builtin: BuiltinDriver) -> DriverNote:
    """Cameras answer, and no driver that is there lists one: it is another maker's."""
    names = [Path(one.file).name for one in troubles]
    title = translate("Drivers", "The driver does not reach these cameras: {names}.")
    title = title.format(names=languages.listed(names))
    own = translate("Drivers", "Install the driver package of the cameras' maker, then search again.")
    in_use = ANY_MAKER.files[0] in names
    steps = (own, *_packages(troubles[0].makers), *([] if in_use else _builtin_lacks(builtin)))
    return DriverNote(title, steps, builtin=not in_use and builtin.kind != "lacking")


def _not_allowed(one: DriverTrouble) -> DriverNote:
    title = translate("Drivers", "The driver {name} is not allowed, so it was not loaded.")
    title = title.format(name=Path(one.file).name)
    message = translate("Drivers", "A driver is a program. Load it only if you or its maker have installed it.")
    return DriverNote(title, (one.file, message), one.file)


def _not_loaded(one: DriverTrouble, builtin: BuiltinDriver) -> DriverNote:
    title = translate("Drivers", "The driver {name} does not work.").format(name=Path(one.file).name)
    message = translate("Drivers", "Install it again with its maker's installer; never copy the file alone.")
    instead = builtin.kind != "lacking" and Path(one.file).name not in ANY_MAKER.files
    return DriverNote(title, (one.file, message), details=one.said, builtin=instead)


def _no_cameras(files: Sequence[str], windows: bool) -> DriverNote:
    names = languages.listed(Path(file).name for file in files)
    title = translate("Drivers", "The driver works, but sees no camera: {names}.").format(names=names)
    steps = [
        translate("Drivers", "Power and cables: is the light at each camera's plug on?"),
        translate("Drivers", "Close the maker's own viewer and any other program that holds the cameras."),
        translate("Drivers", "Some drivers only see their own maker's cameras: install that of your cameras."),
    ]
    if windows:
        wall = translate("Drivers", "GigE: let SphereCal through the Windows firewall, in private networks too.")
        steps.append(wall)
        steps.append(translate("Drivers", "USB3: Device Manager must show the cameras with their maker's driver."))
    else:
        steps.append(translate("Drivers", "GigE: spherecal cameras doctor examines the network line."))
        steps.append(translate("Drivers", "USB3: replug the cameras after installing the driver (its udev rules)."))
    return DriverNote(title, tuple(steps))


def network_notes(facts: "Sequence[InterfaceFact]", all_well: bool) -> list[DriverNote]:
    """What cures this computer's network; a firewall only where not `all_well`, addresses are in the cameras' rows."""
    from spherecal_cameras.camera_network import can_apply  # the window starts without the cameras' modules

    notes = []
    for fact in facts:
        found = fact.finding
        if found is None or fact.name == "addresses" or (found.severity == "info" and fact.name != "firewall"):
            continue
        if fact.name == "firewall" and all_well:
            continue
        title, *steps = (found.words(part, languages.now()) for part in ("title", "message", "hint"))
        cure = fact.cure if can_apply(fact.cure) else ""
        notes.append(DriverNote(title, tuple(steps), cure=cure, level="caution"))
    return notes


def makers_rows(system: str = sys.platform) -> list[tuple[str, str, str, str]]:
    """Maker, package of its driver, file, folder on this system; those without a usual folder here say so."""
    system = "linux" if system.startswith("linux") else system
    rows = []
    for maker in (*MAKERS, ANY_MAKER):
        folders = maker.folders(system)
        if maker is ANY_MAKER and not folders:
            continue
        name = maker.name or translate("Drivers", "any maker (GigE, USB3 Vision)")
        none = translate("Drivers", "as its installer says")
        rows.append((name, maker.driver, "\n".join(maker.files), "\n".join(folders) or none))
    return rows
