"""targets.json: a target set, read and written."""

import json
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import write_file_whole
from spherecal.files.json_file import JsonValue, read_json, unique
from spherecal.targets.target_set import Polarity, TargetSet

FORMAT = "spherecal/targets"
VERSION = 1


def read_target_set(path: Path) -> TargetSet:
    """The target set in a file; InputError where it is not as the interface says."""
    f = read_json(path, FORMAT, VERSION).fields(("family", "polarity", "size_mm", "dot_diameter_mm", "targets"))
    size_mm = f["size_mm"].positive("mm")
    dot_diameter_mm = f["dot_diameter_mm"].positive("mm")
    if dot_diameter_mm >= size_mm:
        raise f["dot_diameter_mm"].error(Phrase("problem-dot-size"))
    targets = [target.fields(("id", "dots")) for target in f["targets"].items(least=1)]
    ids = [target["id"].integer() for target in targets]
    unique([target["id"] for target in targets], list(map(str, ids)), "id")
    layouts = {i: _read_dots(target["dots"], size_mm) for i, target in zip(ids, targets, strict=True)}
    polarity: Polarity = f["polarity"].choice("light-on-dark", "dark-on-light")
    return TargetSet(f["family"].name(), polarity, size_mm, dot_diameter_mm, layouts)


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
    lines = [
        json.dumps({"id": int(i), "dots": {name: np.asarray(xy, dtype=float).tolist() for name, xy in dots.items()}})
        for i, dots in target_set.layouts.items()
    ]
    text = json.dumps(head, indent=1)[:-2] + ',\n "targets": [\n  ' + ",\n  ".join(lines) + "\n ]\n}\n"
    return text.encode()
