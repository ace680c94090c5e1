"""targets.json: a target set, read and written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.targets.marker_set import BORDER_BITS, CORNERS, marker_dictionary
from spherecal.targets.target_set import Polarity, TargetSet
from spherecal_files import codec
from spherecal_files.atomic import write_file_whole
from spherecal_files.json_file import JsonValue

_POLARITIES: tuple[Polarity, ...] = ("light-on-dark", "dark-on-light")
_MOST_STRETCH = 1.05  # of a print: more is refused when rulers are entered (targets.sheet)


def read_target_set(path: Path) -> TargetSet:
    """The target set in a file."""
    return TARGETS.read(path)


@dataclass(frozen=True)
class _Target:
    id: int
    dots: dict[str, FloatArray]


def _read_set(document: JsonValue) -> TargetSet:
    f = _SET.read(document)
    return (_markers if f["family"] == MARKERS else _stickers)(f, document)


def _stickers(f: dict[str, Any], document: JsonValue) -> TargetSet:
    given = document.fields(("polarity", "dot_diameter_mm", "targets"))
    if given["dot_diameter_mm"].positive("mm") >= f["size_mm"]:
        raise given["dot_diameter_mm"].error(Phrase("problem-dot-size"))
    _check_reach(f["layouts"], given["targets"], f["size_mm"])
    f.pop("dictionary", None)
    return TargetSet(**f)


def _markers(f: dict[str, Any], document: JsonValue) -> TargetSet:
    """ArUco or AprilTag markers; without `targets` all of the dictionary."""
    given = document.fields(("dictionary",), ("dot_diameter_mm", "targets"))
    if "dot_diameter_mm" in given:
        given["dot_diameter_mm"].number(0, 0, "for markers")
    try:
        every = make_marker_set(f["dictionary"], f["size_mm"], None, f.get("polarity", "dark-on-light"))
    except InputError as error:
        raise given["dictionary"].error(Phrase("problem-dictionary"), error.hint) from None
    if "targets" not in given:
        return every
    _check_reach(f["layouts"], given["targets"], _MOST_STRETCH * f["size_mm"])
    for value, (i, layout) in zip(given["targets"].items(), f["layouts"].items(), strict=True):
        if i not in every.layouts:
            raise value.error(Phrase("problem-marker-id", {"id": i}))
        if tuple(layout) != CORNERS:
            raise value.error(Phrase("problem-marker-dots", {"dots": ", ".join(CORNERS)}))
    return replace(every, layouts=f["layouts"])


def _check_reach(layouts: Mapping[int, Mapping[str, FloatArray]], targets: JsonValue, size_mm: float) -> None:
    """Refuse dots that are off a sticker of this size."""
    for value, layout in zip(targets.items(), layouts.values(), strict=True):
        for point, place in layout.items():
            if np.abs(place).max() > size_mm / 2:
                dots = value.fields(("dots",))["dots"]
                raise dots.error(Phrase("problem-dot-off", {"point": point, "reach": size_mm / 2}))


def write_target_set(path: Path, target_set: TargetSet) -> None:
    """Write targets.json."""
    write_file_whole(path, TARGETS.bytes(target_set))


def given(*keys: str, **others: codec.Schema) -> codec.Schema:
    """That these fields are there and not null, and what others must be."""
    known: codec.Schema = {key: {"not": {"type": "null"}} for key in keys}
    return {"required": list(keys), "properties": known | others}


_PLACE = codec.numbers("", 2).mapped(np.array, lambda xy: np.asarray(xy, dtype=float).tolist())
_DOTS = codec.entries(
    "Places of the dots by name: mm from the sticker's centre, x right, y down as printed.", _PLACE
).that(len, Phrase("problem-no-dots"), minProperties=1)
_TARGET = codec.record(
    "", _Target, codec.field("id", codec.integer("The number that the target carries.")), codec.field("dots", _DOTS)
)
_LAYOUTS = codec.items(
    "The targets. For `aruco` they may be absent: all markers of the dictionary.", _TARGET, least=1, differ="id"
).mapped(
    lambda targets: {target.id: target.dots for target in targets},
    lambda layouts: [_Target(int(i), dots) for i, dots in layouts.items()],
)
_SET = codec.record(
    "",
    dict,
    codec.field(
        "family", codec.name("`dots8`: the eight-dot targets of this program; `aruco`: ArUco or AprilTag markers.")
    ),
    codec.optional(
        "polarity",
        codec.choice(
            "The brightness of dots or markers and of their background; may be absent for `aruco`: `dark-on-light`.",
            _POLARITIES,
        ),
    ),
    codec.field("size_mm", codec.positive("Side of a sticker, or of a marker's black square.", "mm")),
    codec.optional(
        "dot_diameter_mm",
        codec.number("Diameter of a dot, smaller than `size_mm`; of `aruco` 0 or absent.", 0, unit="mm"),
    ),
    codec.optional(
        "dictionary",
        codec.text("OpenCV's name of the markers' dictionary, such as `DICT_4X4_250`; needed for `aruco`."),
        omit=None,
    ),
    codec.optional("targets", _LAYOUTS, "layouts"),
)
_FORMS = [
    given("polarity", "targets", "dot_diameter_mm", dot_diameter_mm=codec.positive("").schema),
    given("dictionary", family={"const": "aruco"}, dot_diameter_mm={"enum": [0, None]}),
]
TARGETS = codec.FileFormat(
    "spherecal/targets",
    "targets.json",
    "The stickers: the places of the dots of every target.",
    codec.Kind(_SET.schema | {"anyOf": _FORMS}, _read_set, _SET.entry),  # what is needed depends on the family
    ("Ids differ.", "Every dot is on the sticker.", "Dots of a marker are its corners 0 to 3."),
    more="#markers",
    lines="targets",
)


MARKERS = "aruco"
_CORNER = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])


def marker_count(name: str) -> int:
    """How many markers a dictionary has; their ids are 0 to one less."""
    return len(marker_dictionary(name).bytesList)


def make_marker_set(
    dictionary: str, size_mm: float, ids: Sequence[int] | None = None, polarity: Polarity = "dark-on-light"
) -> TargetSet:
    """Markers of a dictionary (all without `ids`) as targets; points 0 to 3 are the black square's corners."""
    count = marker_count(dictionary)
    chosen = range(count) if ids is None else ids
    if not chosen or min(chosen) < 0 or max(chosen) >= count:
        raise InputError(Phrase("error-marker-ids", {"dictionary": dictionary, "last": count - 1}))
    if not size_mm > 0:
        raise InputError(Phrase("error-marker-size", {"size_mm": size_mm}))
    corners = size_mm * _CORNER
    layouts: dict[int, dict[str, FloatArray]] = {
        int(i): dict(zip(CORNERS, corners.copy(), strict=True)) for i in chosen
    }
    return TargetSet(MARKERS, polarity, size_mm, 0.0, layouts, dictionary)


def marker_bits(dictionary: str, marker: int, border: int = BORDER_BITS) -> FloatArray:
    """The cells (n, n) of a marker with its black border, 0 black, 1 white."""
    found = marker_dictionary(dictionary)
    side = found.markerSize + 2 * border
    return (np.asarray(found.generateImageMarker(marker, side, borderBits=border)) > 127).astype(float)


def sticker_mm(target_set: TargetSet) -> float:
    """Side in mm of a sticker as printed; that of a marker has a blank edge as wide as one of its cells."""
    if target_set.dictionary is None:
        return target_set.size_mm
    cells = marker_dictionary(target_set.dictionary).markerSize + 2 * BORDER_BITS
    return target_set.size_mm * (1 + 2 / cells)
