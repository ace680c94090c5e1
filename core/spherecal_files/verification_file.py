"""verification.json: its contents, from a computed verification and as they are read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from operator import itemgetter
from typing import Any, get_args

from spherecal.base.messages.catalogue import phrase
from spherecal.data.findings import Finding
from spherecal.data.session import BarPose
from spherecal_files.bar_registry import CERTIFICATE, LENGTH
from spherecal_files.codec import (
    FileFormat,
    Kind,
    choice,
    field,
    group,
    integer,
    items,
    name,
    number,
    numbers,
    optional,
    prose,
    record,
    serial,
    software,
    text,
    time,
    unread,
)
from spherecal_files.findings_file import FINDING
from spherecal_files.json_file import finite
from spherecal_files.written_phrase import PHRASE, Sentence, sentence, sentence_fields, sentences
from spherecal_verify.budget import Budget, Contribution
from spherecal_verify.limit import RULE, Acceptance, Conformity, LengthConformity, LengthLimit, OfLength
from spherecal_verify.participation import CameraViews, State
from spherecal_verify.verification import LengthStatistics, MeasuredLength, Verification, is_failed

_MOST_MM = 1e9
_PARTS = ("calibration", "scale", "certificate", "temperature")


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
class ProcedureReport:
    """The procedure as read from verification.json: departures, bars, poses, budgets, and the limit if one was set."""

    title: str
    departures: tuple[Sentence, ...]
    bars: tuple[ArtefactRow, ...]
    poses: tuple[BarPose, ...]
    budgets: tuple[Budget, ...]
    volume: tuple[tuple[float, ...], float] | None = None
    acceptance: Acceptance | None = None
    cameras_moved: tuple[str, ...] = ()


@dataclass(frozen=True)
class BarRow(OfLength):
    """One measured length of bars.csv; error = measured - reference, `u_mm` its standard uncertainty."""

    pose: str
    length_mm: float
    reference_mm: float
    error_mm: float
    u_mm: float | None
    views: int


@dataclass(frozen=True)
class Override:
    """Who uses a rig although its verification failed, why, and since when (UTC)."""

    by: str
    reason: str
    at: datetime


@dataclass(frozen=True)
class BarReport:
    """A verification as read from its files; `exceeding` names the lengths (pose, from, to) that break the rule.

    `contradicting` are cameras that are not where the calibration has them.
    """

    lengths: tuple[LengthStatistics, ...]
    n: int
    verdict: str
    rule: Sentence
    mean_error_mm: float | None = None
    sd_mm: float | None = None
    max_abs_error_mm: float | None = None
    coverage_factor: float | None = None
    exceeding: frozenset[tuple[str, str, str]] = frozenset()
    findings: tuple[Finding, ...] = ()
    procedure: ProcedureReport | None = None
    contradicting: tuple[str, ...] = ()
    cameras: tuple[CameraViews, ...] = ()
    measured: tuple[BarRow, ...] = ()
    override: Override | None = None

    def broken(self, row: BarRow) -> bool:
        """Whether a measured length breaks the rule."""
        return (row.pose, row.from_mark, row.to_mark) in self.exceeding

    @property
    def failed(self) -> bool:
        """Whether the rig is shown to be wrong, as `Verification.failed`."""
        acceptance = None if self.procedure is None else self.procedure.acceptance
        return is_failed(self.verdict, None if acceptance is None else acceptance.verdict, self.findings)


def _bar_report(
    rule: str,
    rule_phrase: Mapping[str, Any] | None = None,
    exceeding: Sequence[tuple[str, str, str]] = (),
    **others: Any,
) -> BarReport:
    return BarReport(rule=sentence(rule, rule_phrase), exceeding=frozenset(exceeding), **others)


def _procedure(
    departures: Sequence[str], departure_phrases: Sequence[Mapping[str, Any]] | None = None, **others: Any
) -> ProcedureReport:
    return ProcedureReport(departures=sentences(departures, departure_phrases), **others)


def _artefact(certificate: Mapping[str, str] | None = None, serial: str = "", **others: Any) -> ArtefactRow:
    said = {key: (certificate or {}).get(key, "") for key in ("number", "laboratory", "date", "valid_until")}
    about = {"certificate": said["number"], "laboratory": said["laboratory"], "issued": said["date"]}
    return ArtefactRow(serial=serial, **about, valid_until=said["valid_until"], **others)


def _certified(from_mark: str, to_mark: str, length_mm: float, **others: float) -> tuple[Any, ...]:
    return from_mark, to_mark, length_mm, others.get("expanded_uncertainty_mm"), others.get("coverage_factor")


def _remedy(budget: Budget) -> str:
    said = budget.remedy()
    return "" if said is None else phrase(said)


def _poses(verification: Verification) -> list[MeasuredLength]:
    """The longest length of each pose."""
    poses: dict[str, MeasuredLength] = {}
    for m in verification.measured:
        if m.pose not in poses or m.reference_mm > poses[m.pose].reference_mm:
            poses[m.pose] = m
    return list(poses.values())


def _mm(about: str, least: float = 0) -> Kind[float]:
    return number(about, least, _MOST_MM)


_ENDS = (
    field("bar", name("The bar.")),
    field("from", name("The mark at which the length begins."), "from_mark"),
    field("to", name("The mark at which it ends."), "to_mark"),
)
_LENGTH = record(
    "",
    LengthStatistics,
    *_ENDS,
    field("n", integer("How often it was measured.", 0)),
    optional("mean_error_mm", number("Mean error.")),
    optional("sd_mm", number("Standard deviation of the errors.", 0)),
    optional("max_abs_error_mm", number("Largest error, without its sign.", 0)),
    optional("expanded_uncertainty_mm", number("Expanded uncertainty of an error.", 0)),
    optional("coverage_factor", number("The factor k.", 0)),
    optional(
        "standard_uncertainties_mm",
        record(
            "Standard uncertainties by source.",
            dict,
            optional("repeatability", number("", 0), "repeatability_mm"),
            *(optional(part, number("", 0), f"budget.{part}_mm") for part in _PARTS),
        ),
        lambda length: length,
    ),
)
_OVERALL = group(
    "overall",
    "All lengths together.",
    field("n", integer("The number of measured lengths.", 0), "overall.n"),
    optional("mean_error_mm", number("Mean error."), "overall.mean_error_mm"),
    optional("sd_mm", number("Standard deviation of the errors.", 0), "overall.sd_mm"),
    unread("rms_error_mm", "Root mean square error.", lambda of: finite(of.overall.rms_error_mm)),
    optional("max_abs_error_mm", number("Largest error, without its sign.", 0), "overall.max_abs_error_mm"),
    unread(
        "expanded_uncertainty_mm",
        "That of the mean error, with what the lengths have in common (95.45 %).",
        lambda of: finite(of.overall.expanded_uncertainty_mm),
    ),
)
_BROKEN = record(
    "",
    lambda pose, start, end: (pose, start, end),
    field("pose", name("The pose."), itemgetter(0), "pose"),
    field("from", name("The mark."), itemgetter(1), "start"),
    field("to", name("The mark."), itemgetter(2), "end"),
)
_DECISION = group(
    "decision",
    "Whether the errors agree with their uncertainty.",
    *sentence_fields("rule", "The rule in words.", lambda of: of.decision.rule),
    field("verdict", prose("`consistent`, `inconsistent` ..."), "decision.verdict"),
    optional("coverage_factor", number("The factor k.", 0), "decision.coverage_factor"),
    unread("chi_square", "Of all errors together, on `n` degrees of freedom.", lambda of: of.decision.chi_square),
    unread("most_chi_square", "The most that agrees (99.9 %).", lambda of: of.decision.most_chi_square),
    optional("exceeding", items("Lengths that break the rule.", _BROKEN), "decision.exceeding"),
    optional(
        "cameras", items("Cameras that contradict the calibration.", name("")), "decision.cameras", "contradicting"
    ),
)
_CAMERA = record(
    "",
    CameraViews,
    field("id", name("Its id.")),
    field("views", integer("Views of marks.", 0), "seen"),
    field("used", integer("Views that were used.", 0)),
    optional("rms_px", number("Root mean square of their residuals.", 0)),
    field("state", choice("Its state.", get_args(State))),
)
_CERTIFICATE = record(
    "",
    dict,
    field("number", text("Its number.")),
    optional("laboratory", text("Who issued it.")),
    optional("date", text("When it was issued.")),
    optional("valid_until", text("Until when it is valid.")),
)
_CERTIFIED = record(
    "",
    _certified,
    field("from", name("The mark at which it begins."), "from_mark"),
    field("to", name("The mark at which it ends."), "to_mark"),
    field("length_mm", _mm("The length.")),
    optional("expanded_uncertainty_mm", _mm("Its expanded uncertainty.")),
    optional("coverage_factor", _mm("The factor k.")),
    unread("nominal_mm", "Its nominal length."),
)
_BAR = record(
    "A bar and its certificate.",
    _artefact,
    field("id", name("Its id.")),
    optional("serial", serial("Its serial number.")),
    optional("certificate", replace(_CERTIFICATE, entry=CERTIFICATE.entry)),
    field("expansion_per_kelvin", number("Coefficient of linear expansion.", -1, 1)),
    field("reference_temperature_c", number("The temperature that the lengths refer to.", -300, 1000)),
    unread("assumed", "Which of these were assumed."),
    field("lengths", items("The certified lengths, as in session.json.", replace(_CERTIFIED, entry=LENGTH.entry))),
)
_POSE = record(
    "",
    BarPose,
    field("id", name("Its id."), "pose", "id"),
    field("bar", name("The bar.")),
    optional("temperature_c", number("The bar's temperature.", -300, 1000)),
    unread("from", "The mark at one end of the longest length.", "from_mark"),
    unread("to", "The mark at its other end.", "to_mark"),
    unread(
        "ends_mm",
        "Positions of both marks in the world.",
        lambda m: None if m.ends_mm is None else finite(m.ends_mm.round(3)),
    ),
)
_CONFORMITY = record(
    "",
    LengthConformity,
    *_ENDS,
    field("worst_pose", name("The pose with the largest error.")),
    field("worst_error_mm", _mm("That error.", -_MOST_MM)),
    field("limit_mm", _mm("The limit of this length.")),
    field("expanded_uncertainty_mm", _mm("Expanded uncertainty of an error.")),
    field("verdict", choice("The decision.", get_args(Conformity))),
)
_LIMIT = record(
    "The limit.",
    LengthLimit,
    field("words", text("The limit as a formula."), LengthLimit.words),
    field("constant_mm", _mm("A.")),
    optional("divisor", number("K; absent: A alone.", 1e-9)),
)
_ACCEPTANCE = record(
    "The limit E = A + L/K and the decision.",
    Acceptance,
    field("rule", prose("The decision rule in words."), lambda _: RULE),
    field("limit", _LIMIT),
    optional("verdict", choice("The decision; absent where nothing was measured.", get_args(Conformity))),
    optional("doubts", items("Doubts that prevent a pass.", text(""))),
    field("lengths", items("Each certified length.", _CONFORMITY)),
)
_CONTRIBUTION = record(
    "",
    Contribution,
    field("name", text("What it is.")),
    field("evaluation", choice("Type of evaluation (GUM).", ("A", "B"))),
    field("distribution", text("Its distribution.")),
    field("standard_uncertainty_mm", _mm("Standard uncertainty."), "standard_mm"),
    optional("degrees_of_freedom", number("Absent: infinite.", 0), "freedom"),
    field("share", number("Share of the combined variance.", 0, 1.0001)),
    optional("contained_in_repeatability_mm", _mm("The part that is included in the repeatability."), lambda _: None),
)
_BUDGET = record(
    "The uncertainty budget of a length's error.",
    Budget,
    *_ENDS,
    field("combined_mm", _mm("Combined standard uncertainty.")),
    optional("effective_degrees_of_freedom", number("Absent: infinite.", 0), "freedom"),
    field("coverage_factor", number("The factor k.", 0, 100)),
    field("expanded_uncertainty_mm", _mm("Expanded uncertainty."), "expanded_mm"),
    optional("remedy", prose("What would reduce it; empty where nothing would."), _remedy),
    optional("remedy_phrase", PHRASE, Budget.remedy),
    field("contributions", items("The contributions.", _CONTRIBUTION)),
)
_VOLUME = record(
    "The measuring volume.",
    lambda sides, diagonal: (sides, diagonal),
    field("sides", numbers("Its sides.", 3), itemgetter(0), "sides"),
    field("diagonal", _mm(""), itemgetter(1), "diagonal"),
)
PROCEDURE = record(
    "The procedure, its limit and budgets.",
    _procedure,
    field("title", text("Its title."), "procedure.title"),
    field(
        "departures",
        replace(items("Departures from the guideline.", prose("")), entry=lambda said: [phrase(one) for one in said]),
        "procedure.departures",
    ),
    optional(
        "departure_phrases",
        items("The departures for other languages, in their order.", PHRASE),
        "procedure.departures",
        "departure_phrases",
    ),
    optional("volume_mm", _VOLUME, "procedure.volume_mm", "volume"),
    field("bars", items("The bars.", _BAR), "procedure.bars"),
    field("poses", items("The poses.", _POSE), _poses, "poses"),
    optional("acceptance", _ACCEPTANCE, "procedure.acceptance"),
    field("budgets", items("A budget for each length.", _BUDGET), "procedure.budgets"),
    optional(
        "cameras_moved",
        items("Cameras that moved since the calibration.", name("")),
        lambda of: [] if of.consistency is None else [camera.id for camera in of.consistency.moved],
        "cameras_moved",
    ),
)
OVERRIDE = record(
    "Who uses the rig although this verification failed; `spherecal override` writes it.",
    Override,
    field("by", text("The name.")),
    field("reason", text("The reason.")),
    field("at", time("Since when.")),
)
VERIFICATION = FileFormat(
    "spherecal/verification",
    "verification.json",
    "The verification of a rig with check bars; single lengths are in bars.csv.",
    record(
        "",
        _bar_report,
        field("lengths", items("Each certified length over its poses.", _LENGTH)),
        _OVERALL,
        _DECISION,
        optional("cameras", items("The cameras.", _CAMERA)),
        optional("findings", items("What was found.", FINDING)),
        optional("procedure", PROCEDURE, lambda of: None if of.procedure is None else of, "procedure", omit=None),
        optional("override", OVERRIDE, lambda _: None, "override", omit=None),
        software(),
    ),
    more="verification.md",
)
