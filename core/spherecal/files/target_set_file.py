"""targets.json: a target set, read and written."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.files.atomic import write_file_whole
from spherecal.files.codec import (
    Format,
    Kind,
    Schema,
    choice,
    entries,
    field,
    integer,
    items,
    name,
    number,
    numbers,
    optional,
    positive,
    record,
    text,
)
from spherecal.files.json_file import JsonValue, unique
from spherecal.targets.marker_set import CORNERS, make_marker_set
from spherecal.targets.marker_set import FAMILY as MARKERS
from spherecal.targets.target_set import Polarity, TargetSet

_FIELDS = ("polarity", "size_mm", "dot_diameter_mm", "targets", "dictionary")
_POLARITIES: tuple[Polarity, ...] = ("light-on-dark", "dark-on-light")
_MOST_STRETCH = 1.05  # of a print: more is refused when rulers are entered (targets.sheet)


def read_target_set(path: Path) -> TargetSet:
    """The target set in a file; InputError where it is not as the interface says."""
    return TARGETS.read(path)


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
    for point, place in layout.items():
        if np.abs(place).max() > size_mm / 2:
            raise dots.error(Phrase("problem-dot-off", {"point": point, "reach": size_mm / 2}))
    return layout


def write_target_set(path: Path, target_set: TargetSet) -> None:
    """Write targets.json; OutputError if that fails."""
    write_file_whole(path, target_set_bytes(target_set))


def _layouts(layouts: Mapping[int, Mapping[str, FloatArray]]) -> list[dict[str, object]]:
    return [
        {"id": int(i), "dots": {key: np.asarray(xy, dtype=float).tolist() for key, xy in dots.items()}}
        for i, dots in layouts.items()
    ]


def target_set_bytes(target_set: TargetSet) -> bytes:
    """targets.json, one target a line."""
    return TARGETS.bytes(target_set)


def given(*keys: str, **others: Schema) -> Schema:
    """That these fields are there and not null, and what others must be."""
    known: Schema = {key: {"not": {"type": "null"}} for key in keys}
    return {"required": list(keys), "properties": known | others}


_DOTS = entries(
    "Places of the dots by name: mm from the sticker's centre, x right, y down as printed.", numbers("", 2)
).checked(lambda *_: None, minProperties=1)
_TARGET = record("", dict, field("id", integer("The number that the target carries.")), field("dots", _DOTS))
_LAYOUTS = items("The targets; only of `aruco` may they be absent: all markers of the dictionary.", _TARGET, least=1)
_SET = record(
    "",
    dict,
    field("family", name("`dots8`: the eight-dot targets of this program; `aruco`: ArUco or AprilTag markers.")),
    optional(
        "polarity",
        choice(
            "The dots or markers and what they are printed on; only of `aruco` may it be absent: `dark-on-light`.",
            _POLARITIES,
        ),
    ),
    field("size_mm", positive("Side of a sticker, or of a marker's black square.")),
    optional(
        "dot_diameter_mm",
        number("Diameter of a dot, smaller than `size_mm`; of `aruco` 0 or absent.", 0),
    ),
    optional(
        "dictionary",
        text("OpenCV's name of the markers' dictionary, such as `DICT_4X4_250`; needed for `aruco`."),
        omit=None,
    ),
    optional("targets", replace(_LAYOUTS, entry=_layouts), "layouts"),
)
_FORMS = [
    given("polarity", "targets", "dot_diameter_mm", dot_diameter_mm=positive("").schema),
    given("dictionary", family={"const": "aruco"}, dot_diameter_mm={"enum": [0, None]}),
]
TARGETS = Format(
    "spherecal/targets",
    "targets.json",
    "The stickers: the places of the dots of every target.",
    Kind(_SET.schema | {"anyOf": _FORMS}, target_set_of, _SET.entry),  # what is needed depends on the family
    ("Ids differ.", "Every dot is on the sticker.", "Dots of a marker are its corners 0 to 3."),
    more="#markers",
    lines="targets",
)
