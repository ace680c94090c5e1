"""targets.json: a target set, read and written."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import write_file_whole
from spherecal.files.json_file import JsonValue, read_json, unique
from spherecal.targets.marker_set import CORNERS, make_marker_set
from spherecal.targets.marker_set import FAMILY as MARKERS
from spherecal.targets.target_set import Polarity, TargetSet

FORMAT = "spherecal/targets"
VERSION = 1
_FIELDS = ("polarity", "size_mm", "dot_diameter_mm", "targets", "dictionary")
_POLARITIES: tuple[Polarity, ...] = ("light-on-dark", "dark-on-light")
_MOST_STRETCH = 1.05  # of a print: more is refused when rulers are entered (targets.sheet)


def read_target_set(path: Path) -> TargetSet:
    """The target set in a file; InputError where it is not as the interface says."""
    return target_set_of(read_json(path, FORMAT, VERSION))


def target_set_of(document: JsonValue) -> TargetSet:
    """The target set in the contents of targets.json, wherever they stand; InputError as above."""
    family = document.fields(("family",), _FIELDS)["family"].name()
    if family == MARKERS:
        return _read_markers(document)
    f = document.fields(("family", "polarity", "size_mm", "dot_diameter_mm", "targets"))
    size_mm = f["size_mm"].positive("mm")
    dot_diameter_mm = f["dot_diameter_mm"].positive("mm")
    if dot_diameter_mm >= size_mm:
        raise f["dot_diameter_mm"].error(Phrase("problem-dot-size"))
    polarity: Polarity = f["polarity"].choice(*_POLARITIES)
    return TargetSet(family, polarity, size_mm, dot_diameter_mm, _read_layouts(f["targets"], size_mm))


def _read_markers(document: JsonValue) -> TargetSet:
    """ArUco or AprilTag markers; without `targets` all of the dictionary."""
    f = document.fields(("dictionary", "size_mm"), _FIELDS)
    size_mm = f["size_mm"].positive("mm")
    polarity: Polarity = f["polarity"].choice(*_POLARITIES) if "polarity" in f else "dark-on-light"
    if "dot_diameter_mm" in f:
        f["dot_diameter_mm"].number(0, 0, "for markers")
    try:
        every = make_marker_set(f["dictionary"].text(), size_mm, None, polarity)
    except InputError as error:
        raise f["dictionary"].error(Phrase("problem-dictionary"), error.hint) from None
    if "targets" not in f:
        return every
    layouts = _read_layouts(f["targets"], _MOST_STRETCH * size_mm)
    for value, (i, layout) in zip(f["targets"].items(), layouts.items(), strict=True):
        if i not in every.layouts:
            raise value.error(Phrase("problem-marker-id", {"id": i}))
        if tuple(layout) != CORNERS:
            raise value.error(Phrase("problem-marker-dots", {"dots": ", ".join(CORNERS)}))
    return replace(every, layouts=layouts)


def _read_layouts(values: JsonValue, size_mm: float) -> dict[int, dict[str, FloatArray]]:
    targets = [target.fields(("id", "dots")) for target in values.items(least=1)]
    ids = [target["id"].integer() for target in targets]
    unique([target["id"] for target in targets], list(map(str, ids)), "id")
    return {i: _read_dots(target["dots"], size_mm) for i, target in zip(ids, targets, strict=True)}


def _read_dots(dots: JsonValue, size_mm: float) -> dict[str, FloatArray]:
    layout = {name: np.array(place.numbers(2)) for name, place in dots.entries().items()}
    if not layout:
        raise dots.error(Phrase("problem-no-dots"))
    for name, place in layout.items():
        if np.abs(place).max() > size_mm / 2:
            raise dots.error(Phrase("problem-dot-off", {"point": name, "reach": size_mm / 2}))
    return layout


def write_target_set(path: Path, target_set: TargetSet) -> None:
    """Write targets.json; OutputError if that fails."""
    write_file_whole(path, target_set_bytes(target_set))


def target_set_bytes(target_set: TargetSet) -> bytes:
    """targets.json, one target a line."""
    head = {
        "format": FORMAT,
        "version": VERSION,
        "family": target_set.family,
        "polarity": target_set.polarity,
        "size_mm": float(target_set.size_mm),
        "dot_diameter_mm": float(target_set.dot_diameter_mm),
    }
    if target_set.dictionary is not None:
        head["dictionary"] = target_set.dictionary
    lines = [
        json.dumps({"id": int(i), "dots": {name: np.asarray(xy, dtype=float).tolist() for name, xy in dots.items()}})
        for i, dots in target_set.layouts.items()
    ]
    text = json.dumps(head, indent=1)[:-2] + ',\n "targets": [\n  ' + ",\n  ".join(lines) + "\n ]\n}\n"
    return text.encode()
