"""The procedure in verification.json, read and checked: limit and decision, budgets, bars, temperatures, departures."""

from dataclasses import dataclass

from spherecal.files.json_file import JsonValue
from spherecal.files.written_phrase import Sentence, read_sentence, read_sentences

_MOST_MM = 1e9


@dataclass(frozen=True)
class ConformityRow:
    """One certified length against the limit."""

    bar: str
    start: str
    end: str
    worst_pose: str
    worst_error_mm: float
    limit_mm: float
    expanded_mm: float
    verdict: str

    @property
    def key(self) -> tuple[str, str, str]:
        """The certified length."""
        return self.bar, self.start, self.end


@dataclass(frozen=True)
class AcceptanceReport:
    """The limit E = A + L/K (`divisor` None: A alone), the decision, its rule, and what cast doubt on a pass."""

    rule: str
    words: str
    constant_mm: float
    divisor: float | None
    verdict: str
    doubts: tuple[str, ...]
    lengths: tuple[ConformityRow, ...]

    def at(self, length_mm: float) -> float:
        """The limit of a length in mm."""
        return self.constant_mm + (0.0 if self.divisor is None else length_mm / self.divisor)


@dataclass(frozen=True)
class ContributionRow:
    """One contribution of a budget; `freedom` None: infinite."""

    name: str
    evaluation: str
    distribution: str
    standard_mm: float
    freedom: float | None
    share: float
    contained_mm: float | None


@dataclass(frozen=True)
class BudgetReport:
    """The budget of one length's error."""

    bar: str
    start: str
    end: str
    combined_mm: float
    freedom: float | None
    coverage_factor: float
    expanded_mm: float
    remedy: Sentence
    contributions: tuple[ContributionRow, ...]


@dataclass(frozen=True)
class ArtefactRow:
    """A bar: serial, certificate in words, expansion, lengths in words."""

    id: str
    serial: str
    certificate: str
    laboratory: str
    issued: str
    valid_until: str
    expansion_per_kelvin: float
    reference_temperature_c: float
    lengths: tuple[tuple[str, str, float, float, float], ...]


@dataclass(frozen=True)
class PoseRow:
    """A pose of a bar with its temperature."""

    id: str
    bar: str
    temperature_c: float | None


@dataclass(frozen=True)
class ProcedureReport:
    """All of it."""

    title: str
    departures: tuple[Sentence, ...]
    volume: tuple[tuple[float, ...], float] | None
    bars: tuple[ArtefactRow, ...]
    poses: tuple[PoseRow, ...]
    acceptance: AcceptanceReport | None
    budgets: tuple[BudgetReport, ...]
    cameras_moved: tuple[str, ...]


_OPTIONAL = ("departure_phrases", "volume_mm", "acceptance", "cameras_moved")


def read_procedure(value: JsonValue) -> ProcedureReport:
    """The procedure; InputError names what is not as it was written."""
    f = value.fields(("title", "departures", "bars", "poses", "budgets"), _OPTIONAL)
    volume = None
    if "volume_mm" in f:
        v = f["volume_mm"].fields(("sides", "diagonal"))
        volume = tuple(v["sides"].numbers(3)), v["diagonal"].number(0, _MOST_MM)
    return ProcedureReport(
        title=f["title"].text(),
        departures=read_sentences(f["departures"], f.get("departure_phrases")),
        volume=volume,
        bars=tuple(_read_bar(item) for item in f["bars"].items()),
        poses=tuple(_read_pose(item) for item in f["poses"].items()),
        acceptance=_read_acceptance(f["acceptance"]) if "acceptance" in f else None,
        budgets=tuple(_read_budget(item) for item in f["budgets"].items()),
        cameras_moved=tuple(item.name() for item in f["cameras_moved"].items()) if "cameras_moved" in f else (),
    )


def _read_bar(value: JsonValue) -> ArtefactRow:
    f = value.fields(("id", "expansion_per_kelvin", "reference_temperature_c", "lengths"), ("serial", "certificate"))
    about = f["certificate"].fields(("number",), ("laboratory", "date", "valid_until")) if "certificate" in f else {}
    said = {key: one.text() for key, one in about.items()}
    lengths = []
    for item in f["lengths"].items():
        x = item.fields(("from", "to", "length_mm"), ("expanded_uncertainty_mm", "coverage_factor"))
        keys = ("length_mm", "expanded_uncertainty_mm", "coverage_factor")
        numbers = (x[key].number(0, _MOST_MM) if key in x else None for key in keys)
        lengths.append((x["from"].name(), x["to"].name(), *numbers))
    return ArtefactRow(
        f["id"].name(),
        f["serial"].serial() if "serial" in f else "",
        said.get("number", ""),
        said.get("laboratory", ""),
        said.get("date", ""),
        said.get("valid_until", ""),
        f["expansion_per_kelvin"].number(-1, 1),
        f["reference_temperature_c"].number(-300, 1000),
        tuple(lengths),
    )


def _read_pose(value: JsonValue) -> PoseRow:
    f = value.fields(("id", "bar"), ("temperature_c",))
    temperature = f["temperature_c"].number(-300, 1000) if "temperature_c" in f else None
    return PoseRow(f["id"].name(), f["bar"].name(), temperature)


def _read_acceptance(value: JsonValue) -> AcceptanceReport:
    f = value.fields(("rule", "limit", "lengths"), ("verdict", "doubts"))
    limit = f["limit"].fields(("words", "constant_mm"), ("divisor",))
    verdict = f["verdict"].choice("pass", "fail", "cannot tell") if "verdict" in f else "no data"
    return AcceptanceReport(
        f["rule"].prose(),
        limit["words"].text(),
        limit["constant_mm"].number(0, _MOST_MM),
        limit["divisor"].number(1e-9) if "divisor" in limit else None,
        verdict,
        tuple(item.text() for item in f["doubts"].items()) if "doubts" in f else (),
        tuple(_read_conformity(item) for item in f["lengths"].items()),
    )


def _read_conformity(value: JsonValue) -> ConformityRow:
    f = value.fields(
        ("bar", "from", "to", "worst_pose", "worst_error_mm", "limit_mm", "expanded_uncertainty_mm", "verdict")
    )
    return ConformityRow(
        f["bar"].name(),
        f["from"].name(),
        f["to"].name(),
        f["worst_pose"].name(),
        f["worst_error_mm"].number(-_MOST_MM, _MOST_MM),
        f["limit_mm"].number(0, _MOST_MM),
        f["expanded_uncertainty_mm"].number(0, _MOST_MM),
        f["verdict"].choice("pass", "fail", "cannot tell"),
    )


def _read_budget(value: JsonValue) -> BudgetReport:
    required = ("bar", "from", "to", "combined_mm", "coverage_factor", "expanded_uncertainty_mm", "contributions")
    f = value.fields(required, ("effective_degrees_of_freedom", "remedy", "remedy_phrase"))
    freedom = f["effective_degrees_of_freedom"].number(0) if "effective_degrees_of_freedom" in f else None
    return BudgetReport(
        f["bar"].name(),
        f["from"].name(),
        f["to"].name(),
        f["combined_mm"].number(0, _MOST_MM),
        freedom,
        f["coverage_factor"].number(0, 100),
        f["expanded_uncertainty_mm"].number(0, _MOST_MM),
        read_sentence(f["remedy"], f.get("remedy_phrase")) if "remedy" in f else Sentence(""),
        tuple(_read_contribution(item) for item in f["contributions"].items()),
    )


def _read_contribution(value: JsonValue) -> ContributionRow:
    required = ("name", "evaluation", "distribution", "standard_uncertainty_mm", "share")
    f = value.fields(required, ("degrees_of_freedom", "contained_in_repeatability_mm"))
    return ContributionRow(
        f["name"].text(),
        f["evaluation"].choice("A", "B"),
        f["distribution"].text(),
        f["standard_uncertainty_mm"].number(0, _MOST_MM),
        f["degrees_of_freedom"].number(0) if "degrees_of_freedom" in f else None,
        f["share"].number(0, 1.0001),
        f["contained_in_repeatability_mm"].number(0, _MOST_MM) if "contained_in_repeatability_mm" in f else None,
    )
