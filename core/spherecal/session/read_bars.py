"""Reading the reference bars of a session."""

from spherecal.session.json_file import JsonValue, unique
from spherecal.session.model import Bar, BarLength, Mark

# An expanded uncertainty above 5 % of its length is no certificate; micrometres given for millimetres are.
_WORST_RELATIVE_UNCERTAINTY = 0.05
# From about 1 (k = 1) to Student's t for one degree of freedom, 95.45 %.
_COVERAGE_FACTORS = (1.0, 14.0)
# Plastics expand by 2e-4 per kelvin at most, some composites shrink by 1e-5; 11.5 instead of 1.15e-5 is refused.
_EXPANSIONS_PER_KELVIN = (-1e-4, 1e-3)
_REFERENCE_TEMPERATURES_C = (-50.0, 100.0)


def read_bars(bars: JsonValue) -> tuple[Bar, ...]:
    """The reference bars, in order; InputError where one is not as the interface says."""
    values = bars.items()
    found = tuple(_read_bar(value) for value in values)
    unique(values, [bar.id for bar in found], "id")
    return found


def _read_bar(bar: JsonValue) -> Bar:
    f = bar.fields(("id", "role", "marks", "lengths", "expansion_per_kelvin", "reference_temperature_c"))
    marks = {name: _read_mark(mark) for name, mark in f["marks"].entries().items()}
    lengths = f["lengths"].items(least=1)
    return Bar(
        id=f["id"].name(),
        role=f["role"].choice("scale", "check"),
        marks=marks,
        lengths=tuple(_read_length(length, marks) for length in lengths),
        expansion_per_kelvin=f["expansion_per_kelvin"].number(*_EXPANSIONS_PER_KELVIN, unit="per kelvin"),
        reference_temperature_c=f["reference_temperature_c"].number(*_REFERENCE_TEMPERATURES_C, unit="degrees Celsius"),
    )


def _read_mark(mark: JsonValue) -> Mark:
    f = mark.fields(("target", "point"))
    return Mark(f["target"].integer(), f["point"].name())


def _read_length(length: JsonValue, marks: dict[str, Mark]) -> BarLength:
    f = length.fields(("from", "to", "length_mm", "expanded_uncertainty_mm", "coverage_factor"))
    ends = [f[end].name() for end in ("from", "to")]
    for end, name in zip(("from", "to"), ends, strict=True):
        if name not in marks:
            raise f[end].error(f'names a mark that the bar does not have: "{name}"')
    if marks[ends[0]] == marks[ends[1]]:
        raise f["to"].error('is the same mark as "from"')
    length_mm = f["length_mm"].positive("mm")
    most = _WORST_RELATIVE_UNCERTAINTY * length_mm
    return BarLength(
        ends[0], ends[1], length_mm,
        f["expanded_uncertainty_mm"].number(0, most, "mm (5 % of the length)"),
        f["coverage_factor"].number(*_COVERAGE_FACTORS),
    )  # fmt: skip
