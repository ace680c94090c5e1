"""The errors of the engine that somebody at the rig meets, in the reader's language; all others stay English."""

import re
from functools import cache

from PySide6.QtCore import QCoreApplication

from spherecal_gui import languages

translate = QCoreApplication.translate

_FIELD = re.compile(r"\{(\w+)\}")


def in_own_words(text: str) -> str:
    """An error's message or hint in the language in use, where it is one of those known here."""
    if languages.now() == "en" or not text:
        return text
    for source, translated in _known():
        found = _pattern(source).fullmatch(text)
        if found is not None:
            return translated.format(**{name: in_own_words(value) for name, value in found.groupdict().items()})
    return text


@cache
def _pattern(source: str) -> re.Pattern[str]:
    parts = _FIELD.split(source)
    return re.compile("".join(re.escape(part) if i % 2 == 0 else f"(?P<{part}>.+)" for i, part in enumerate(parts)))


def _known() -> list[tuple[str, str]]:
    """The engine's sentences with their translations; a test compares them with what the engine really says."""
    return [
        ("{file}: cannot be written ({why}).", translate("Errors", "{file}: cannot be written ({why}).")),
        ("{file}: cannot be read ({why}).", translate("Errors", "{file}: cannot be read ({why}).")),
        ("no space left on device", translate("Errors", "the disk is full")),
        ("permission denied", translate("Errors", "permission denied")),
        ("Free the disk, try again.", translate("Errors", "Free the disk, try again.")),
        ("Choose another folder.", translate("Errors", "Choose another folder.")),
        (
            "There is no camera source {name}.",
            translate("Errors", "There is no camera source {name}."),
        ),
        (
            "Sources are genicam, replay:FOLDER and simulated[:PRESET].",
            translate("Errors", "Sources are genicam, replay:FOLDER and simulated[:PRESET]."),
        ),
        ("There is no rig preset {name}.", translate("Errors", "There is no rig preset {name}.")),
        ("Presets are {names}.", translate("Errors", "Presets are {names}.")),
        ("{file} cannot be read: {why}.", translate("Errors", "{file} cannot be read: {why}.")),
        ("{file} is not an image.", translate("Errors", "{file} is not an image.")),
        ("{file} is damaged: {why}.", translate("Errors", "{file} is damaged: {why}.")),
        (
            "Use PNG, TIFF, JPEG, BMP or PGM files.",
            translate("Errors", "Use PNG, TIFF, JPEG, BMP or PGM files."),
        ),
        ("Name another place.", translate("Errors", "Name another place.")),
        (
            "{folder}: was captured with other cameras ({names}).",
            translate("Errors", "{folder}: was captured with other cameras ({names})."),
        ),
        (
            "Connect the same cameras, or capture into a new folder.",
            translate("Errors", "Connect the same cameras, or capture into a new folder."),
        ),
        (
            "{folder}: too little is seen by three cameras at once to check the rig.",
            translate("Errors", "{folder}: too little is seen by three cameras at once to check the rig."),
        ),
        (
            "Put the ball, or a bar with its marks, in the middle of the volume.",
            translate("Errors", "Put the ball, or a bar with its marks, in the middle of the volume."),
        ),
        ('"{text}" is no limit.', translate("Errors", '"{text}" is no limit.')),
        (
            "Write A + L/K with A in mm, such as 0.03+L/20000, or A alone.",
            translate("Errors", "Write A + L/K with A in mm, such as 0.03+L/20000, or A alone."),
        ),
        ('The place "{name}" is named twice.', translate("Errors", 'The place "{name}" is named twice.')),
        (
            "Origin, X and XY plane need three places.",
            translate("Errors", "Origin, X and XY plane need three places."),
        ),
        ('The result has no place "{name}".', translate("Errors", 'The result has no place "{name}".')),
        (
            "{a} and {b} are only {mm} apart, too near to give a direction.",
            translate("Errors", "{a} and {b} are only {mm} apart, too near to give a direction."),
        ),
        (
            "Choose places that are far apart, at least {mm}.",
            translate("Errors", "Choose places that are far apart, at least {mm}."),
        ),
        (
            "{names} lie nearly in a line: {c} is only {mm} beside the line through {a} and {b} (angle {deg} degrees), "
            "so that the turn about X is not defined.",
            translate(
                "Errors",
                "{names} lie nearly in a line: {c} is only {mm} beside the line through {a} and {b} (angle {deg} "
                "degrees), so that the turn about X is not defined.",
            ),
        ),
        (
            "Choose a third place well beside that line, at least {deg} degrees off it.",
            translate("Errors", "Choose a third place well beside that line, at least {deg} degrees off it."),
        ),
        ("A frame needs three places, not {n}.", translate("Errors", "A frame needs three places, not {n}.")),
        (
            "Name the origin, a place on the +X axis and one in the XY plane; or none, for the reference camera.",
            translate(
                "Errors",
                "Name the origin, a place on the +X axis and one in the XY plane; or none, for the reference camera.",
            ),
        ),
    ]
