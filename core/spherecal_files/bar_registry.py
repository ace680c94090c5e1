"""The owner's reference bars by serial number, which a session's bar may name instead of lengths; one file per user."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.assumed import ASSUMED_EXPANSION_PER_KELVIN, ASSUMED_FACTOR, ASSUMED_TEMPERATURE_C
from spherecal.data.session import Bar, BarLength, Certificate, Mark
from spherecal_files import codec
from spherecal_files.json_file import JsonValue, printable
from spherecal_files.registry import Registry

# An expanded uncertainty above 5 % of its length is no certificate; micrometres given for millimetres are.
_WORST_RELATIVE_UNCERTAINTY = 0.05
# Rounded to whole millimetres a length of 50 mm is still called by what it is within 1 %; a slip in the digits before
# the millimetres, or inches for millimetres, is further away.
_WORST_RELATIVE_NOMINAL = 0.01
# From about 1 (k = 1) to Student's t for one degree of freedom, 95.45 %.
_COVERAGE_FACTORS = (1.0, 14.0)
# Plastics expand by 2e-4 per kelvin at most, some composites shrink by 1e-5; 11.5 instead of 1.15e-5 is refused.
_EXPANSIONS_PER_KELVIN = (-1e-4, 1e-3)
_REFERENCE_TEMPERATURES_C = (-50.0, 100.0)
# Of a length whose uncertainty is not stated: the limits of a class II rule, a + b L (Directive 2014/32/EU, MI-008), as
# +-limits of an even distribution.
_RULE_MM, _RULE_RELATIVE = 0.3, 0.2e-3


T = TypeVar("T")


@dataclass(frozen=True)
class RegisteredBar:
    """A bar as its owner knows it, lengths at `reference_temperature_c`; `assumed` names what was not stated."""

    serial: str
    marks: dict[str, Mark]
    lengths: tuple[BarLength, ...]
    expansion_per_kelvin: float
    reference_temperature_c: float = 20.0
    description: str = ""
    certificate: Certificate | None = None
    assumed: tuple[str, ...] = ()


def find_bar(serial: str, path: Path | None = None) -> RegisteredBar:
    """The bar with this serial; `path` None: that of `BAR_REGISTRY`."""
    bars = BAR_REGISTRY.read(path)
    if serial not in bars:
        raise InputError(
            Phrase("error-no-registered-bar", {"file": path or BAR_REGISTRY.path(), "serial": printable(serial)}),
            Phrase("registered-bars", {"bars": list(bars)}) if bars else Phrase("registered-none"),
        )
    return bars[serial]


def figures_entry(bar: RegisteredBar | Bar) -> dict[str, Any]:
    """All that measuring with a bar takes, as files have it: marks, lengths, temperature, certificate."""
    return codec.record("", dict, *FIGURES).entry(bar)


def read_lengths(lengths: JsonValue, marks: Mapping[str, Mark]) -> tuple[BarLength, ...]:
    """A bar's certified lengths between its marks, at least one."""
    found = LENGTHS.read(lengths)
    for one, value in zip(found, lengths.items(), strict=True):
        ends = value.fields(("from", "to"))
        for end, mark in (("from", one.from_mark), ("to", one.to_mark)):
            if mark not in marks:
                raise ends[end].error(Phrase("problem-unknown-mark", {"mark": mark}))
        if marks[one.from_mark] == marks[one.to_mark]:
            raise ends["to"].error(Phrase("problem-same-mark"))
    return found


def _unless_assumed(key: str, kind: codec.Kind[Any]) -> codec.Field:
    """A figure that is not written where it was assumed."""
    known = attrgetter(key)
    return replace(codec.optional(key, kind, omit=None), get=lambda of: None if key in of.assumed else known(of))


def _length(length_mm: float, **stated: Any) -> BarLength:
    factor = stated.get("coverage_factor", ASSUMED_FACTOR)
    rule_mm = factor * (_RULE_MM + _RULE_RELATIVE * length_mm) / math.sqrt(3)
    assumed = tuple(key for key in ("expanded_uncertainty_mm", "coverage_factor") if key not in stated)
    given = {"expanded_uncertainty_mm": rule_mm, "coverage_factor": factor} | stated
    return BarLength(length_mm=length_mm, **given, assumed=assumed)


def _check_length(length: BarLength, f: Mapping[str, JsonValue]) -> None:
    if "expanded_uncertainty_mm" in f:
        most = _WORST_RELATIVE_UNCERTAINTY * length.length_mm
        f["expanded_uncertainty_mm"].number(0, most, Phrase("mm-of-length"))
    nominal, certified = length.nominal_mm, length.length_mm
    if nominal is not None and abs(certified - nominal) > _WORST_RELATIVE_NOMINAL * nominal:
        problem = Phrase("problem-nominal", {"nominal_mm": nominal, "certified_mm": certified})
        raise f["nominal_mm"].error(problem)


def _check_dates(certificate: Certificate, f: Mapping[str, JsonValue]) -> None:
    issued, until = certificate.date, certificate.valid_until
    if issued is not None and until is not None and until < issued:
        raise f["valid_until"].error(Phrase("problem-before-date", {"date": issued.isoformat()}))


def _read_serial(value: JsonValue) -> str:
    return replace(value, value=value.serial()).name()


def with_assumed(make: Callable[..., T]) -> Callable[..., T]:
    """A bar of its fields, with what is assumed of its temperature where they do not say it."""

    def made(**stated: Any) -> T:
        assumed = tuple(key for key in _ASSUMED if key not in stated)
        return make(**_ASSUMED | stated, assumed=assumed)

    return made


_ASSUMED = {"expansion_per_kelvin": ASSUMED_EXPANSION_PER_KELVIN, "reference_temperature_c": ASSUMED_TEMPERATURE_C}
MARKS = codec.entries(
    "The bar's marks by name.",
    codec.record(
        "A mark.",
        Mark,
        codec.field("target", codec.integer("Its target.")),
        codec.field("point", codec.name("The point of the target, mostly `centre`.")),
    ),
)
# Its range depends on the length: `_check_length`.
_EXPANDED = replace(codec.number("Its expanded uncertainty, at most 5 % of the length.", 0), read=JsonValue.number)
LENGTH = codec.record(
    "A certified length.",
    _length,
    codec.field("from", codec.name("The mark at which it begins."), "from_mark"),
    codec.field("to", codec.name("The mark at which it ends."), "to_mark"),
    codec.field("length_mm", codec.positive("The length at the reference temperature.", "mm")),
    _unless_assumed("expanded_uncertainty_mm", _EXPANDED),
    _unless_assumed(
        "coverage_factor", codec.number("The factor k of that uncertainty; 2 where absent.", *_COVERAGE_FACTORS)
    ),
    codec.optional("nominal_mm", codec.positive("The nominal length, within 1 % of it.", "mm"), omit=None),
    check=_check_length,
)
LENGTHS = codec.items("The certified lengths.", LENGTH, least=1)
_CERTIFICATE = codec.record(
    "",
    Certificate,
    codec.field("number", codec.text("Its number.")),
    codec.optional("laboratory", codec.text("Who issued it."), omit=""),
    codec.optional("date", codec.date("When it was issued."), omit=None),
    codec.optional("valid_until", codec.date("Until when it is valid."), omit=None),
    check=_check_dates,
)
CERTIFICATE = replace(
    codec.one_of(
        "The calibration certificate; a text alone is its number.", codec.text("").mapped(Certificate), _CERTIFICATE
    ),
    entry=_CERTIFICATE.entry,
)
SERIAL = replace(codec.one_of("Its serial number.", codec.name(""), codec.integer("", 0)), read=_read_serial)
_EXPANSION = codec.number(
    "Coefficient of linear expansion per kelvin; 1.15e-5 (steel) where absent.", *_EXPANSIONS_PER_KELVIN, "1/K"
)
_TEMPERATURE = codec.number(
    "The temperature that the lengths refer to, in degrees Celsius; 20 where absent.", *_REFERENCE_TEMPERATURES_C, "°C"
)
FIGURES = (
    codec.field("marks", MARKS),
    codec.field("lengths", LENGTHS),
    _unless_assumed("expansion_per_kelvin", _EXPANSION),
    _unless_assumed("reference_temperature_c", _TEMPERATURE),
    codec.optional("certificate", CERTIFICATE, omit=None),
)
REGISTERED_BAR = codec.record(
    "",
    with_assumed(RegisteredBar),
    codec.field("serial", SERIAL),
    codec.optional("description", codec.text("What it is.")),
    *FIGURES,
    check=lambda bar, f: read_lengths(f["lengths"], bar.marks),
)
BARS = codec.FileFormat(
    "spherecal/bars",
    "bars.json",
    "The owner's reference bars, in the user's settings; `SPHERECAL_BARS` names another file.",
    codec.only("bars", codec.items("The bars.", REGISTERED_BAR, differ="serial")),
    ("Serial numbers differ.", "Every named mark exists."),
    more="verification.md",
)
BAR_REGISTRY = Registry(BARS, "SPHERECAL_BARS", "serial", Phrase("error-set-bars"))
