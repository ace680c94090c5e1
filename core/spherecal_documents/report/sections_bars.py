"""The verification as sections: conformity, budgets, artefacts and certificates, temperatures, departures."""

from spherecal.verify.verification_file import AcceptanceReport, BarReport, BudgetReport, ProcedureReport
from spherecal_documents.report.language import label, word, written
from spherecal_documents.report.style import NONE, TO, count, number, significant
from spherecal_documents.report.tables import ReportTable, Section
from spherecal_rigs.result_folder import Result

_MANY = 10_000
# The words for what verification.json names.
_VERDICTS = {
    "pass": "verdict-pass",
    "fail": "verdict-fail",
    "cannot tell": "verdict-cannot-tell",
    "consistent": "verdict-consistent",
    "inconsistent": "verdict-inconsistent",
    "no data": "verdict-no-data",
}
_STATES = {"verified": "state-verified", "not seen": "state-not-seen", "rejected": "state-rejected"}
_DISTRIBUTIONS = {"normal": "distribution-normal", "rectangular": "distribution-rectangular"}
_SHARES = {
    "certificate": "share-certificate",
    "thermometer": "share-thermometer",
    "expansion": "share-expansion",
    "temperature": "share-temperature",
    "calibration": "share-calibration",
    "scale": "share-scale",
    "centring": "share-centring",
    "repeatability": "share-repeatability",
    "resolution": "share-resolution",
}
_DOUBTS = {
    "camera-moved": "doubt-camera-moved",
    "certificate-expired": "doubt-certificate-expired",
    "temperatures-differ": "doubt-temperatures-differ",
    "bars-disagree": "doubt-bars-disagree",
    "length-doubtful": "doubt-length-doubtful",
    "rig-not-valid": "doubt-rig-not-valid",
    "camera-contradicts": "doubt-camera-contradicts",
    "camera-not-verified": "doubt-camera-not-verified",
    "outlying-views": "doubt-outlying-views",
}


def bar_sections(result: Result) -> tuple[Section, ...]:
    """All sections about the reference bars; none where nothing was verified."""
    bars = result.bars
    if bars is None:
        return ()
    procedure = bars.procedure
    found = [_statistics(bars), *([_cameras(bars)] if bars.cameras else [])]
    if procedure is not None:
        found += [
            section
            for section in (
                _conformity(procedure),
                _budgets(procedure),
                _artefacts(procedure),
                _temperatures(procedure),
            )
            if section is not None
        ]
        found.append(_departures(procedure))
    return (*found, _measured(bars))


def verdict_word(verdict: str) -> str:
    """A verdict of verification.json as the report calls it."""
    return word(_VERDICTS, verdict)


def name_of(bar: str, start: str, end: str) -> str:
    """A certified length's name: bar and both marks."""
    return f"{bar} {start}{TO}{end}"


def _cameras(bars: BarReport) -> Section:
    """What each camera saw of the marks, and how it fits."""
    rows = [(c.id, str(c.seen), str(c.used), number(c.rms_px, 4), word(_STATES, c.state)) for c in bars.cameras]
    columns = (
        label("report-camera"),
        label("report-views-of-marks"),
        label("report-used"),
        label("report-rms-px"),
        label("report-state"),
    )
    table = ReportTable("", columns, (30.0, 22.0, 20.0, 22.0, 28.0), tuple(rows))
    text = label("report-views-of-marks-that-another")
    return Section("bar-cameras", label("report-cameras-in-the-verification"), (text,), (table,))


def _statistics(bars: BarReport) -> Section:
    rows = [
        (
            name_of(*x.key),
            str(x.n),
            number(x.mean_error_mm, 4, sign=True),
            number(x.sd_mm, 4),
            number(x.max_abs_error_mm, 4),
            number(x.expanded_mm, 4),
            number(x.coverage_factor, 2),
        )
        for x in bars.lengths
    ]
    columns = (
        label("report-length"),
        "n",
        label("report-mean-error-mm"),
        label("report-sd-mm"),
        label("report-largest-error-mm"),
        label("report-u-of-the-mean-mm"),
        "k",
    )
    table = ReportTable("", columns, (42.0, 12.0, 22.0, 20.0, 24.0, 22.0, 9.0), tuple(rows))
    rule = label("report-rule", rule=written(bars.rule))
    text = label("report-rule-verdict", rule=rule, verdict=word(_VERDICTS, bars.verdict))
    return Section("bar-errors", label("report-length-errors"), (text,), (table,))


def doubts_in_words(acceptance: AcceptanceReport) -> str:
    """What casts doubt on a pass, in words."""
    return ", ".join(word(_DOUBTS, code) for code in acceptance.doubts)


def _conformity(procedure: ProcedureReport) -> Section | None:
    acceptance = procedure.acceptance
    if acceptance is None:
        return None
    doubts = label("report-in-doubt", doubts=doubts_in_words(acceptance)) if acceptance.doubts else ""
    rows = [
        (
            name_of(*x.key),
            x.worst_pose,
            number(x.worst_error_mm, 4, sign=True),
            number(x.expanded_uncertainty_mm, 4),
            number(x.limit_mm, 4),
            word(_VERDICTS, x.verdict),
        )
        for x in acceptance.lengths
    ]
    columns = (
        label("report-length"),
        label("report-pose"),
        label("report-worst-error-mm"),
        "U\nmm",
        label("report-limit-mm"),
        label("report-verdict"),
    )
    table = ReportTable("", columns, (42.0, 26.0, 24.0, 22.0, 22.0, 24.0), tuple(rows), 2)
    verdict = word(_VERDICTS, acceptance.verdict).upper()
    rule = label("report-iso-rule")
    text = label("report-conformity", limit=acceptance.words, verdict=verdict, doubts=doubts, rule=rule)
    return Section("conformity", label("report-conformity-with-the-limit"), (text,), (table,))


def _budgets(procedure: ProcedureReport) -> Section | None:
    if not procedure.budgets:
        return None
    text = label("report-uncertainty-of-a-single-measured")
    return Section("budget", label("report-uncertainty-budget"), (text,), tuple(_budget(b) for b in procedure.budgets))


def _budget(budget: BudgetReport) -> ReportTable:
    title = label(
        "report-budget",
        length=name_of(budget.bar, budget.start, budget.end),
        u=number(budget.combined_mm, 4),
        freedom=_freedom(budget.freedom),
        k=number(budget.coverage_factor, 2),
        expanded=number(budget.expanded_mm, 4),
    )
    largest_first = sorted(budget.contributions, key=lambda c: -c.share)
    if budget.remedy.text:
        title = label("report-to-lessen", budget=title, remedy=written(budget.remedy))
    rows = []
    for c in largest_first:
        note = (
            ""
            if c.contained_mm is None
            else label("report-mm-within-repeatability", contained_mm=number(c.contained_mm, 4))
        )
        cells = (
            word(_SHARES, c.name),
            word(_DISTRIBUTIONS, c.distribution),
            c.evaluation,
            number(c.standard_mm, 5),
            _freedom(c.freedom),
            f"{100 * c.share:.0f} %",
            note,
        )
        rows.append(cells)
    columns = (
        label("report-contribution"),
        label("report-distribution"),
        label("report-type"),
        "u\nmm",
        label("report-degrees-of-freedom"),
        label("report-share"),
        "",
    )
    return ReportTable(title, columns, (30.0, 26.0, 12.0, 22.0, 22.0, 16.0, 48.0), tuple(rows), 2)


def _freedom(value: float | None) -> str:
    """Degrees of freedom; k no longer depends on them above some hundred."""
    if value is None:
        return "∞"
    return f"{value:.0f}" if value < _MANY else f"> {count(_MANY)}"


def _artefacts(procedure: ProcedureReport) -> Section | None:
    if not procedure.bars:
        return None
    rows = [
        (
            bar.id,
            bar.serial or NONE,
            bar.certificate or NONE,
            bar.laboratory or NONE,
            bar.issued or NONE,
            bar.valid_until or NONE,
            f"{1e6 * bar.expansion_per_kelvin:.2f}",
        )
        for bar in procedure.bars
    ]
    columns = (
        label("report-bar"),
        label("report-serial"),
        label("report-certificate"),
        label("report-laboratory"),
        label("report-issued"),
        label("report-valid-until"),
        label("report-expansion-10-k"),
    )
    about = ReportTable("", columns, (16.0, 28.0, 32.0, 36.0, 22.0, 22.0, 18.0), tuple(rows), 6)
    lengths = [
        (
            name_of(bar.id, start, end),
            number(length, 4),
            significant(expanded),
            NONE if k is None else f"{k:g}",
            f"{bar.reference_temperature_c:g}",
        )
        for bar in procedure.bars
        for start, end, length, expanded, k in bar.lengths
    ]
    columns = (label("report-length"), label("report-certified-mm"), "U\nmm", "k", "at °C")
    certified = ReportTable("", columns, (46.0, 30.0, 22.0, 12.0, 14.0), tuple(lengths))
    text = label("report-reference-bars-of-this-verification")
    return Section("artefacts", label("report-artefacts-and-certificates"), (text,), (about, certified))


def _temperatures(procedure: ProcedureReport) -> Section | None:
    if not procedure.poses:
        return None
    known = [pose.temperature_c for pose in procedure.poses if pose.temperature_c is not None]
    text = (
        label("report-of-the-bars-to-c", low=min(known), high=max(known))
        if known
        else label("report-the-bars-temperatures-were-not")
    )
    rows = tuple((pose.id, pose.bar, number(pose.temperature_c, 2)) for pose in procedure.poses)
    table = ReportTable(
        "", (label("report-pose"), label("report-bar"), label("report-temperature-c")), (40.0, 30.0, 30.0), rows, 2
    )
    return Section("temperatures", label("report-temperatures"), (text,), (table,))


def _departures(procedure: ProcedureReport) -> Section:
    first = label("report-departs")
    if procedure.volume is not None:
        sides = " x ".join(f"{side:.0f}" for side in procedure.volume[0])
        first = label("report-volume", sides=sides, diagonal=procedure.volume[1])
    return Section("departures", label("report-procedure-title"), (first, *map(written, procedure.departures)))


def _measured(bars: BarReport) -> Section:
    rows = [
        (
            row.pose,
            name_of(*row.key),
            number(row.length_mm, 4),
            number(row.reference_mm, 4),
            number(row.error_mm, 4, sign=True),
            number(row.u_mm, 4),
            str(row.views),
        )
        for row in bars.measured
    ]
    columns = (
        label("report-pose"),
        label("report-length"),
        label("report-measured-mm"),
        label("report-reference-mm"),
        label("report-error-mm"),
        "u (k = 1)\nmm",
        label("report-views"),
    )
    table = ReportTable("", columns, (26.0, 36.0, 25.0, 25.0, 20.0, 18.0, 11.0), tuple(rows), 2)
    return Section("measured", label("report-all-measured-lengths"), (), (table,))
