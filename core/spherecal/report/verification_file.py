"""bars.csv and verification.json of a result folder, read and checked."""

from dataclasses import dataclass
from math import isnan
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding, Severity, as_written
from spherecal.files.findings_file import with_values
from spherecal.files.json_file import JsonValue, read_json
from spherecal.files.written_phrase import Sentence, read_sentence
from spherecal.report.csv_table import read_csv
from spherecal.report.procedure_file import ProcedureReport, read_procedure
from spherecal.verify.write_verification import BAR_COLUMNS, FORMAT, VERSION

BUDGET_PARTS = ("repeatability", "calibration", "scale", "certificate", "temperature")


@dataclass(frozen=True)
class BarRow:
    """One measured length of bars.csv; error = measured - reference, `u_mm` its standard uncertainty."""

    bar: str
    pose: str
    start: str
    end: str
    length_mm: float
    reference_mm: float
    error_mm: float
    u_mm: float | None
    views: int

    @property
    def key(self) -> tuple[str, str, str]:
        """The certified length that was measured."""
        return self.bar, self.start, self.end


@dataclass(frozen=True)
class LengthRow:
    """One certified length over its poses; `budget_mm` holds standard uncertainties by BUDGET_PARTS, if given."""

    bar: str
    start: str
    end: str
    n: int
    mean_error_mm: float | None
    sd_mm: float | None
    max_abs_error_mm: float | None
    expanded_mm: float | None
    coverage_factor: float | None
    budget_mm: tuple[float | None, ...]

    @property
    def key(self) -> tuple[str, str, str]:
        """The certified length."""
        return self.bar, self.start, self.end


@dataclass(frozen=True)
class CameraRow:
    """One camera in the verification: views of marks, those used, rms of their residuals, its state."""

    id: str
    seen: int
    used: int
    rms_px: float | None
    state: str


@dataclass(frozen=True)
class BarReport:
    """A verification as read from its files; `exceeding` names the lengths (pose, from, to) that break the rule.

    `contradicting` are cameras that are not where the calibration has them.
    """

    measured: tuple[BarRow, ...]
    lengths: tuple[LengthRow, ...]
    n: int
    mean_error_mm: float | None
    sd_mm: float | None
    max_abs_error_mm: float | None
    verdict: str
    rule: Sentence
    coverage_factor: float | None
    exceeding: frozenset[tuple[str, str, str]]
    findings: tuple[Finding, ...]
    procedure: ProcedureReport | None = None
    contradicting: tuple[str, ...] = ()
    cameras: tuple[CameraRow, ...] = ()


def read_bar_report(folder: Path) -> BarReport | None:
    """The verification in a result folder, None where there is none; InputError where it is broken or half there."""
    table, document = folder / "bars.csv", folder / "verification.json"
    if not table.exists() and not document.exists():
        return None
    for path, other in ((table, document), (document, table)):
        if not path.exists():
            raise InputError(Phrase("error-verification-part", {"file": path, "other": other.name}))
    optional = ("findings", "procedure", "cameras")
    f = read_json(document, FORMAT, VERSION).fields(("lengths", "overall", "decision"), optional)
    overall = f["overall"].fields(("n",), ("mean_error_mm", "sd_mm", "max_abs_error_mm"))
    decision = f["decision"].fields(("verdict", "rule"), ("rule_phrase", "coverage_factor", "exceeding", "cameras"))
    exceeding = decision["exceeding"].items() if "exceeding" in decision else []
    findings = f["findings"].items() if "findings" in f else []
    return BarReport(
        measured=_read_rows(table),
        lengths=tuple(_read_length(value) for value in f["lengths"].items()),
        n=overall["n"].integer(0),
        mean_error_mm=_optional(overall, "mean_error_mm"),
        sd_mm=_optional(overall, "sd_mm", 0),
        max_abs_error_mm=_optional(overall, "max_abs_error_mm", 0),
        verdict=decision["verdict"].prose(),
        rule=read_sentence(decision["rule"], decision.get("rule_phrase")),
        coverage_factor=_optional(decision, "coverage_factor", 0),
        exceeding=frozenset(_read_exceeding(value) for value in exceeding),
        findings=with_values([_read_finding(value) for value in findings], folder),
        procedure=read_procedure(f["procedure"]) if "procedure" in f else None,
        contradicting=tuple(one.name() for one in decision["cameras"].items()) if "cameras" in decision else (),
        cameras=tuple(_read_camera(value) for value in f["cameras"].items()) if "cameras" in f else (),
    )


def _read_camera(value: JsonValue) -> CameraRow:
    f = value.fields(("id", "views", "used", "state"), ("rms_px",))
    return CameraRow(
        f["id"].name(),
        f["views"].integer(0),
        f["used"].integer(0),
        _optional(f, "rms_px", 0),
        f["state"].choice("verified", "not seen", "rejected"),
    )


def _optional(fields: dict[str, JsonValue], key: str, least: float = -1e30) -> float | None:
    return fields[key].number(least) if key in fields else None


def _read_finding(value: JsonValue) -> Finding:
    f = value.fields(("severity", "code", "message", "hint", "where"))
    severity: Severity = f["severity"].choice("info", "warning", "error")
    where = tuple(item.prose() for item in f["where"].items())
    return as_written(severity, f["code"].prose(), f["message"].prose(), f["hint"].prose(), where)


def _read_exceeding(value: JsonValue) -> tuple[str, str, str]:
    f = value.fields(("pose", "from", "to"))
    return f["pose"].name(), f["from"].name(), f["to"].name()


def _read_length(value: JsonValue) -> LengthRow:
    optional = (
        "mean_error_mm", "sd_mm", "max_abs_error_mm", "expanded_uncertainty_mm", "coverage_factor",
        "standard_uncertainties_mm",
    )  # fmt: skip
    f = value.fields(("bar", "from", "to", "n"), optional)
    parts = f["standard_uncertainties_mm"].fields((), BUDGET_PARTS) if "standard_uncertainties_mm" in f else {}
    return LengthRow(
        f["bar"].name(),
        f["from"].name(),
        f["to"].name(),
        f["n"].integer(0),
        _optional(f, "mean_error_mm"),
        _optional(f, "sd_mm", 0),
        _optional(f, "max_abs_error_mm", 0),
        _optional(f, "expanded_uncertainty_mm", 0),
        _optional(f, "coverage_factor", 0),
        tuple(_optional(parts, part, 0) for part in BUDGET_PARTS),
    )


def _read_rows(path: Path) -> tuple[BarRow, ...]:
    table = read_csv(path, BAR_COLUMNS)
    u = table.lengths("u_mm", may_be_empty=True)
    return tuple(
        BarRow(bar, pose, start, end, length, reference, error, None if isnan(sigma) else sigma, views)
        for bar, pose, start, end, length, reference, error, sigma, views in zip(
            *(table.names(name) for name in ("bar", "pose", "from", "to")),
            *(table.numbers(name).tolist() for name in ("length_mm", "reference_mm", "error_mm")),
            u.tolist(),
            table.whole_numbers("views").tolist(),
            strict=True,
        )
    )
