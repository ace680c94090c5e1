"""The verification as sections: conformity, budgets, artefacts and certificates, temperatures, departures."""

import math

from spherecal_documents.report.language import columns, label, word, written
from spherecal_documents.report.model import Cell, Paragraph, Section, Strong, Table, Verdict, finding_texts
from spherecal_documents.report.residual_drawings import error_figures, lengths_in_order, name_of
from spherecal_documents.report.style import BAD, INK, NONE, count, number, significant
from spherecal_files import verification_file
from spherecal_rigs.result_folder import Result
from spherecal_verify.budget import Budget
from spherecal_verify.limit import Acceptance
from spherecal_verify.verification import LengthStatistics

_MANY = 10_000
# The words for what verification.json names.
_VERDICTS = {
    "pass": "verdict-pass", "fail": "verdict-fail", "cannot tell": "verdict-cannot-tell",
    "consistent": "verdict-consistent", "inconsistent": "verdict-inconsistent", "no data": "verdict-no-data",
}  # fmt: skip
_STATES = {"verified": "state-verified", "not seen": "state-not-seen", "rejected": "state-rejected"}
_DISTRIBUTIONS = {"normal": "distribution-normal", "rectangular": "distribution-rectangular"}
_SHARES = {
    "certificate": "share-certificate", "thermometer": "share-thermometer", "expansion": "share-expansion",
    "temperature": "share-temperature", "calibration": "share-calibration", "scale": "share-scale",
    "centring": "share-centring", "repeatability": "share-repeatability", "resolution": "share-resolution",
}  # fmt: skip
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


def bar_sections(result: Result, verdict: Verdict) -> tuple[Section, ...]:
    """All sections about the reference bars, of which `verdict` is; none where nothing was verified."""
    bars = result.bars
    if bars is None:
        return ()
    found = [_statistics(bars, verdict), *_cameras(bars)]
    if bars.procedure is not None:
        parts = (_conformity, _budgets, _artefacts, _temperatures, _departures)
        found += [section for part in parts for section in part(bars.procedure)]
    if bars.findings:
        title = label("report-findings-of-the-verification")
        found.append(Section("bar-findings", title, finding_texts(bars.findings)))
    rows: list[tuple[Cell, ...]] = []
    for row in bars.measured:
        error = number(row.error_mm, 4, sign=True)
        ratio = number(row.error_mm / row.u_mm, 1, sign=True) if row.u_mm else NONE
        lengths = number(row.length_mm, 4), number(row.reference_mm, 4)
        shown = Strong(error, BAD) if bars.broken(row) else error
        rows.append((row.pose, name_of(row.key), *lengths, shown, number(row.u_mm, 4), ratio, str(row.views)))
    heads = columns("pose length measured-mm reference-mm error-mm")
    table = Table((*heads, "u (k = 1)\nmm", *columns("error-u views")), tuple(rows), 2)
    note = Paragraph(label("report-views-the-number-of-cameras"), "note")
    return (*found, Section("measured", label("report-all-measured-lengths"), (note, table)))


def verdict_word(verdict: str) -> str:
    """A verdict of verification.json as the report calls it."""
    return word(_VERDICTS, verdict)


def _section(key: str, title: str, text: str, *tables: Table) -> list[Section]:
    return [Section(key, title, (Paragraph(text, "note"), *tables))]


def _statistics(bars: verification_file.BarReport, verdict: Verdict) -> Section:
    """The verdict and its rule, the errors drawn and by length."""
    rule = label("report-rule", rule=written(bars.rule))
    texts = [label("report-rule-verdict", rule=rule, verdict=word(_VERDICTS, bars.verdict))]
    if bars.measured:
        texts.append(label("report-error-measured-minus-reference-length"))
        if bars.procedure is not None and bars.procedure.acceptance is not None:
            texts.append(label("report-amber-lines-the-limit-amber"))
    reference = {row.key: row.reference_mm for row in reversed(bars.measured)}
    rows: list[tuple[Cell, ...]] = [
        (name_of(x.key), number(reference.get(x.key), 3), str(x.n), number(x.mean_error_mm, 4, sign=True),
         number(x.sd_mm, 4), number(x.max_abs_error_mm, 4), number(x.expanded_uncertainty_mm, 4),
         number(x.coverage_factor, 2))
        for x in _by_length(bars)
    ]  # fmt: skip
    mean, largest = number(bars.mean_error_mm, 4, sign=True), number(bars.max_abs_error_mm, 4)
    rows.append((Strong(label("report-all"), INK), "", str(bars.n), mean, number(bars.sd_mm, 4), largest, "", ""))
    heads = columns("length reference-mm =n mean-error-mm sd-mm largest-error-mm u-of-the-mean-mm =k")
    notes = [Paragraph(text, "note") for text in texts]
    figures = error_figures(bars) if bars.measured else ()
    title = label("report-length-errors")
    return Section("bar-errors", title, (verdict, *notes, *figures, Table(heads, tuple(rows))), new_page=True)


def _by_length(bars: verification_file.BarReport) -> list[LengthStatistics]:
    """The statistics in the order of the drawing."""
    place = {key: i for i, key in enumerate(lengths_in_order(bars))}
    return sorted(bars.lengths, key=lambda x: (place.get(x.key, len(place)), x.key))


def _cameras(bars: verification_file.BarReport) -> list[Section]:
    """What each camera saw of the marks, and how it fits."""
    if not bars.cameras:
        return []
    rows = [(c.id, str(c.seen), str(c.used), number(c.rms_px, 4), word(_STATES, c.state)) for c in bars.cameras]
    table = Table(columns("camera views-of-marks used rms-px state"), tuple(rows))
    text = label("report-views-of-marks-that-another")
    return _section("bar-cameras", label("report-cameras-in-the-verification"), text, table)


def doubts_in_words(acceptance: Acceptance) -> str:
    """What casts doubt on a pass, in words."""
    return ", ".join(word(_DOUBTS, code) for code in acceptance.doubts)


def _conformity(procedure: verification_file.ProcedureReport) -> list[Section]:
    acceptance = procedure.acceptance
    if acceptance is None:
        return []
    doubts = label("report-in-doubt", doubts=doubts_in_words(acceptance)) if acceptance.doubts else ""
    rows = [
        (name_of(x.key), x.worst_pose, number(x.worst_error_mm, 4, sign=True), number(x.expanded_uncertainty_mm, 4),
         number(x.limit_mm, 4), word(_VERDICTS, x.verdict))
        for x in acceptance.lengths
    ]  # fmt: skip
    table = Table((*columns("length pose worst-error-mm"), "U\nmm", *columns("limit-mm verdict")), tuple(rows), 2)
    verdict, rule = word(_VERDICTS, acceptance.verdict or "no data").upper(), label("report-iso-rule")
    text = label("report-conformity", limit=acceptance.limit.words(), verdict=verdict, doubts=doubts, rule=rule)
    return _section("conformity", label("report-conformity-with-the-limit"), text, table)


def _budgets(procedure: verification_file.ProcedureReport) -> list[Section]:
    if not procedure.budgets:
        return []
    text = label("report-uncertainty-of-a-single-measured")
    return _section("budget", label("report-uncertainty-budget"), text, *map(_budget, procedure.budgets))


def _budget(budget: Budget) -> Table:
    title = label(
        "report-budget", length=name_of(budget.key), u=number(budget.combined_mm, 4),
        freedom=_freedom(budget.freedom), k=number(budget.coverage_factor, 2), expanded=number(budget.expanded_mm, 4),
    )  # fmt: skip
    if (remedy := budget.remedy()) is not None:
        title = label("report-to-lessen", budget=title, remedy=remedy)
    rows = []
    for c in sorted(budget.contributions, key=lambda c: -c.share):
        name, shape = word(_SHARES, c.name), word(_DISTRIBUTIONS, c.distribution)
        standard, share = number(c.standard_mm, 5), f"{100 * c.share:.0f} %"
        rows.append((name, shape, c.evaluation, standard, _freedom(c.freedom), share))
    heads = (*columns("contribution distribution type"), "u\nmm", *columns("degrees-of-freedom share"))
    return Table(heads, tuple(rows), 2, title)


def _freedom(value: float) -> str:
    """Degrees of freedom; k no longer depends on them above some hundred."""
    if math.isinf(value):
        return "∞"
    return f"{value:.0f}" if value < _MANY else f"> {count(_MANY)}"


def _artefacts(procedure: verification_file.ProcedureReport) -> list[Section]:
    if not procedure.bars:
        return []
    rows = []
    for bar in procedure.bars:
        said = (bar.serial, bar.certificate, bar.laboratory, bar.issued, bar.valid_until)
        rows.append((bar.id, *(one or NONE for one in said), f"{1e6 * bar.expansion_per_kelvin:.2f}"))
    heads = columns("bar serial certificate laboratory issued valid-until expansion-10-k")
    lengths = [
        (name_of((bar.id, start, end)), number(length, 4), significant(expanded), NONE if k is None else f"{k:g}",
         f"{bar.reference_temperature_c:g}")
        for bar in procedure.bars
        for start, end, length, expanded, k in bar.lengths
    ]  # fmt: skip
    certified = Table((*columns("length certified-mm"), "U\nmm", "k", "at °C"), tuple(lengths))
    text, title = label("report-reference-bars-of-this-verification"), label("report-artefacts-and-certificates")
    return _section("artefacts", title, text, Table(heads, tuple(rows), 6), certified)


def _temperatures(procedure: verification_file.ProcedureReport) -> list[Section]:
    if not procedure.poses:
        return []
    known = [pose.temperature_c for pose in procedure.poses if pose.temperature_c is not None]
    text = label("report-the-bars-temperatures-were-not")
    if known:
        text = label("report-of-the-bars-to-c", low=min(known), high=max(known))
    rows = tuple((pose.id, pose.bar, number(pose.temperature_c, 2)) for pose in procedure.poses)
    table = Table(columns("pose bar temperature-c"), rows, 2)
    return _section("temperatures", label("report-temperatures"), text, table)


def _departures(procedure: verification_file.ProcedureReport) -> list[Section]:
    first = label("report-departs")
    if procedure.volume is not None:
        sides = " x ".join(f"{side:.0f}" for side in procedure.volume[0])
        first = label("report-volume", sides=sides, diagonal=procedure.volume[1])
    items = (Paragraph(written(one), "item") for one in procedure.departures)
    return [Section("departures", label("report-procedure-title"), (Paragraph(first), *items))]
