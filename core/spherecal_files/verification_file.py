"""verification.json: its contents, from a computed verification and as they are read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from operator import itemgetter
from typing import Any, get_args

from spherecal.base.messages.catalogue import phrase
from spherecal.data.findings import Finding
from spherecal.data.session import BarPose
from spherecal_files import codec
from spherecal_files.bar_registry import CERTIFICATE, LENGTH
from spherecal_files.findings_file import FINDING, PHRASE, Sentence, sentence, sentence_fields, sentences
from spherecal_files.json_file import finite
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


def _mm(about: str, least: float = 0) -> codec.Kind[float]:
    return codec.number(about, least, _MOST_MM)


_ENDS = (
    codec.field("bar", codec.name("The bar.")),
    codec.field("from", codec.name("The mark at which the length begins."), "from_mark"),
    codec.field("to", codec.name("The mark at which it ends."), "to_mark"),
)
_LENGTH = codec.record(
    "",
    LengthStatistics,
    *_ENDS,
    codec.field("n", codec.integer("How often it was measured.", 0)),
    codec.optional("mean_error_mm", codec.number("Mean error.")),
    codec.optional("sd_mm", codec.number("Standard deviation of the errors.", 0)),
    codec.optional("max_abs_error_mm", codec.number("Largest error, without its sign.", 0)),
    codec.optional("expanded_uncertainty_mm", codec.number("Expanded uncertainty of an error.", 0)),
    codec.optional("coverage_factor", codec.number("The factor k.", 0)),
    codec.optional(
        "standard_uncertainties_mm",
        codec.record(
            "Standard uncertainties by source.",
            dict,
            codec.optional("repeatability", codec.number("", 0), "repeatability_mm"),
            *(codec.optional(part, codec.number("", 0), f"budget.{part}_mm") for part in _PARTS),
        ),
        lambda length: length,
    ),
)
_OVERALL = codec.group(
    "overall",
    "All lengths together.",
    codec.field("n", codec.integer("The number of measured lengths.", 0), "overall.n"),
    codec.optional("mean_error_mm", codec.number("Mean error."), "overall.mean_error_mm"),
    codec.optional("sd_mm", codec.number("Standard deviation of the errors.", 0), "overall.sd_mm"),
    codec.unread("rms_error_mm", "Root mean square error.", lambda of: finite(of.overall.rms_error_mm)),
    codec.optional("max_abs_error_mm", codec.number("Largest error, without its sign.", 0), "overall.max_abs_error_mm"),
    codec.unread(
        "expanded_uncertainty_mm",
        "That of the mean error, with what the lengths have in common (95.45 %).",
        lambda of: finite(of.overall.expanded_uncertainty_mm),
    ),
)
_BROKEN = codec.record(
    "",
    lambda pose, start, end: (pose, start, end),
    codec.field("pose", codec.name("The pose."), itemgetter(0), "pose"),
    codec.field("from", codec.name("The mark."), itemgetter(1), "start"),
    codec.field("to", codec.name("The mark."), itemgetter(2), "end"),
)
_DECISION = codec.group(
    "decision",
    "Whether the errors agree with their uncertainty.",
    *sentence_fields("rule", "The rule in words.", lambda of: of.decision.rule),
    codec.field("verdict", codec.prose("`consistent`, `inconsistent` ..."), "decision.verdict"),
    codec.optional("coverage_factor", codec.number("The factor k.", 0), "decision.coverage_factor"),
    codec.unread("chi_square", "Of all errors together, on `n` degrees of freedom.", lambda of: of.decision.chi_square),
    codec.unread("most_chi_square", "The most that agrees (99.9 %).", lambda of: of.decision.most_chi_square),
    codec.optional("exceeding", codec.items("Lengths that break the rule.", _BROKEN), "decision.exceeding"),
    codec.optional(
        "cameras",
        codec.items("Cameras that contradict the calibration.", codec.name("")),
        "decision.cameras",
        "contradicting",
    ),
)
_CAMERA = codec.record(
    "",
    CameraViews,
    codec.field("id", codec.name("Its id.")),
    codec.field("views", codec.integer("Views of marks.", 0), "seen"),
    codec.field("used", codec.integer("Views that were used.", 0)),
    codec.optional("rms_px", codec.number("Root mean square of their residuals.", 0)),
    codec.field("state", codec.choice("Its state.", get_args(State))),
)
_CERTIFICATE = codec.record(
    "",
    dict,
    codec.field("number", codec.text("Its number.")),
    codec.optional("laboratory", codec.text("Who issued it.")),
    codec.optional("date", codec.text("When it was issued.")),
    codec.optional("valid_until", codec.text("Until when it is valid.")),
)
_CERTIFIED = codec.record(
    "",
    _certified,
    codec.field("from", codec.name("The mark at which it begins."), "from_mark"),
    codec.field("to", codec.name("The mark at which it ends."), "to_mark"),
    codec.field("length_mm", _mm("The length.")),
    codec.optional("expanded_uncertainty_mm", _mm("Its expanded uncertainty.")),
    codec.optional("coverage_factor", _mm("The factor k.")),
    codec.unread("nominal_mm", "Its nominal length."),
)
_BAR = codec.record(
    "A bar and its certificate.",
    _artefact,
    codec.field("id", codec.name("Its id.")),
    codec.optional("serial", codec.serial("Its serial number.")),
    codec.optional("certificate", replace(_CERTIFICATE, entry=CERTIFICATE.entry)),
    codec.field("expansion_per_kelvin", codec.number("Coefficient of linear expansion.", -1, 1)),
    codec.field("reference_temperature_c", codec.number("The temperature that the lengths refer to.", -300, 1000)),
    codec.unread("assumed", "Which of these were assumed."),
    codec.field(
        "lengths", codec.items("The certified lengths, as in session.json.", replace(_CERTIFIED, entry=LENGTH.entry))
    ),
)
_POSE = codec.record(
    "",
    BarPose,
    codec.field("id", codec.name("Its id."), "pose", "id"),
    codec.field("bar", codec.name("The bar.")),
    codec.optional("temperature_c", codec.number("The bar's temperature.", -300, 1000)),
    codec.unread("from", "The mark at one end of the longest length.", "from_mark"),
    codec.unread("to", "The mark at its other end.", "to_mark"),
    codec.unread(
        "ends_mm",
        "Positions of both marks in the world.",
        lambda m: None if m.ends_mm is None else finite(m.ends_mm.round(3)),
    ),
)
_CONFORMITY = codec.record(
    "",
    LengthConformity,
    *_ENDS,
    codec.field("worst_pose", codec.name("The pose with the largest error.")),
    codec.field("worst_error_mm", _mm("That error.", -_MOST_MM)),
    codec.field("limit_mm", _mm("The limit of this length.")),
    codec.field("expanded_uncertainty_mm", _mm("Expanded uncertainty of an error.")),
    codec.field("verdict", codec.choice("The decision.", get_args(Conformity))),
)
_LIMIT = codec.record(
    "The limit.",
    LengthLimit,
    codec.field("words", codec.text("The limit as a formula."), LengthLimit.words),
    codec.field("constant_mm", _mm("A.")),
    codec.optional("divisor", codec.number("K; absent: A alone.", 1e-9)),
)
_ACCEPTANCE = codec.record(
    "The limit E = A + L/K and the decision.",
    Acceptance,
    codec.field("rule", codec.prose("The decision rule in words."), lambda _: RULE),
    codec.field("limit", _LIMIT),
    codec.optional("verdict", codec.choice("The decision; absent where nothing was measured.", get_args(Conformity))),
    codec.optional("doubts", codec.items("Doubts that prevent a pass.", codec.text(""))),
    codec.field("lengths", codec.items("Each certified length.", _CONFORMITY)),
)
_CONTRIBUTION = codec.record(
    "",
    Contribution,
    codec.field("name", codec.text("What it is.")),
    codec.field("evaluation", codec.choice("Type of evaluation (GUM).", ("A", "B"))),
    codec.field("distribution", codec.text("Its distribution.")),
    codec.field("standard_uncertainty_mm", _mm("Standard uncertainty."), "standard_mm"),
    codec.optional("degrees_of_freedom", codec.number("Absent: infinite.", 0), "freedom"),
    codec.field("share", codec.number("Share of the combined variance.", 0, 1.0001)),
    codec.optional(
        "contained_in_repeatability_mm", _mm("The part that is included in the repeatability."), lambda _: None
    ),
)
_BUDGET = codec.record(
    "The uncertainty budget of a length's error.",
    Budget,
    *_ENDS,
    codec.field("combined_mm", _mm("Combined standard uncertainty.")),
    codec.optional("effective_degrees_of_freedom", codec.number("Absent: infinite.", 0), "freedom"),
    codec.field("coverage_factor", codec.number("The factor k.", 0, 100)),
    codec.field("expanded_uncertainty_mm", _mm("Expanded uncertainty."), "expanded_mm"),
    codec.optional("remedy", codec.prose("What would reduce it; empty where nothing would."), _remedy),
    codec.optional("remedy_phrase", PHRASE, Budget.remedy),
    codec.field("contributions", codec.items("The contributions.", _CONTRIBUTION)),
)
_VOLUME = codec.record(
    "The measuring volume.",
    lambda sides, diagonal: (sides, diagonal),
    codec.field("sides", codec.numbers("Its sides.", 3), itemgetter(0), "sides"),
    codec.field("diagonal", _mm(""), itemgetter(1), "diagonal"),
)
PROCEDURE = codec.record(
    "The procedure, its limit and budgets.",
    _procedure,
    codec.field("title", codec.text("Its title."), "procedure.title"),
    codec.field(
        "departures",
        replace(
            codec.items("Departures from the guideline.", codec.prose("")),
            entry=lambda said: [phrase(one) for one in said],
        ),
        "procedure.departures",
    ),
    codec.optional(
        "departure_phrases",
        codec.items("The departures for other languages, in their order.", PHRASE),
        "procedure.departures",
        "departure_phrases",
    ),
    codec.optional("volume_mm", _VOLUME, "procedure.volume_mm", "volume"),
    codec.field("bars", codec.items("The bars.", _BAR), "procedure.bars"),
    codec.field("poses", codec.items("The poses.", _POSE), _poses, "poses"),
    codec.optional("acceptance", _ACCEPTANCE, "procedure.acceptance"),
    codec.field("budgets", codec.items("A budget for each length.", _BUDGET), "procedure.budgets"),
    codec.optional(
        "cameras_moved",
        codec.items("Cameras that moved since the calibration.", codec.name("")),
        lambda of: [] if of.consistency is None else [camera.id for camera in of.consistency.moved],
        "cameras_moved",
    ),
)
OVERRIDE = codec.record(
    "Who uses the rig although this verification failed; `spherecal override` writes it.",
    Override,
    codec.field("by", codec.text("The name.")),
    codec.field("reason", codec.text("The reason.")),
    codec.field("at", codec.time("Since when.")),
)
VERIFICATION = codec.FileFormat(
    "spherecal/verification",
    "verification.json",
    "The verification of a rig with check bars; single lengths are in bars.csv.",
    codec.record(
        "",
        _bar_report,
        codec.field("lengths", codec.items("Each certified length over its poses.", _LENGTH)),
        _OVERALL,
        _DECISION,
        codec.optional("cameras", codec.items("The cameras.", _CAMERA)),
        codec.optional("findings", codec.items("What was found.", FINDING)),
        codec.optional("procedure", PROCEDURE, lambda of: None if of.procedure is None else of, "procedure", omit=None),
        codec.optional("override", OVERRIDE, lambda _: None, "override", omit=None),
        codec.software(),
    ),
    more="verification.md",
)
