"""The verification as sections: conformity, budgets, artefacts and certificates, temperatures, departures."""

from spherecal.report.language import said
from spherecal.report.procedure_file import AcceptanceReport, BudgetReport, ProcedureReport
from spherecal.report.result_folder import Result
from spherecal.report.style import NONE, TO, count, number, significant
from spherecal.report.tables import Section, Table
from spherecal.report.verification_file import BarReport


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


def name_of(bar: str, start: str, end: str) -> str:
    """A certified length's name."""
    return f"{bar} {start}{TO}{end}"


def _cameras(bars: BarReport) -> Section:
    """What each camera saw of the marks, and how it fits."""
    rows = [(c.id, str(c.seen), str(c.used), number(c.rms_px, 4), c.state) for c in bars.cameras]
    columns = ("camera", "views of\nmarks", "used", "rms\npx", "state")
    table = Table("", columns, (30.0, 22.0, 20.0, 22.0, 28.0), tuple(rows))
    text = (
        "Views of marks that another camera sees too, how many of them were used, and how they fit. A camera that saw "
        "no mark is not verified; one most of whose views were rejected contradicts the calibration."
    )
    return Section("bar-cameras", "Cameras in the verification", (text,), (table,))


def _statistics(bars: BarReport) -> Section:
    rows = [
        (
            name_of(*x.key), str(x.n), number(x.mean_error_mm, 4, sign=True), number(x.sd_mm, 4),
            number(x.max_abs_error_mm, 4), number(x.expanded_mm, 4), number(x.coverage_factor, 2),
        )
        for x in bars.lengths
    ]  # fmt: skip
    columns = ("length", "n", "mean error\nmm", "sd\nmm", "largest |error|\nmm", "U of the mean\nmm", "k")
    table = Table("", columns, (42.0, 12.0, 22.0, 20.0, 24.0, 22.0, 9.0), tuple(rows))
    return Section("bar-errors", "Length errors", (f"Rule: {bars.rule}. Verdict: {bars.verdict}.",), (table,))


_MANY = 10_000
_DOUBTS = {
    "camera-moved": "a camera has moved",
    "certificate-expired": "a certificate has expired",
    "temperatures-differ": "temperatures differ",
    "bars-disagree": "bars disagree",
    "length-doubtful": "a length contradicts its bar",
    "rig-not-valid": "the calibration is not valid",
    "camera-contradicts": "a camera contradicts the others",
    "camera-not-verified": "a camera saw no mark",
    "outlying-views": "many views were left out",
}


def doubts_in_words(acceptance: AcceptanceReport) -> str:
    """What speaks against the means of proof."""
    return ", ".join(said(_DOUBTS.get(code, code)) for code in acceptance.doubts)


def _conformity(procedure: ProcedureReport) -> Section | None:
    acceptance = procedure.acceptance
    if acceptance is None:
        return None
    doubts = f" In doubt because: {doubts_in_words(acceptance)}." if acceptance.doubts else ""
    rows = [
        (
            name_of(*x.key), x.worst_pose, number(x.worst_error_mm, 4, sign=True), number(x.expanded_mm, 4),
            number(x.limit_mm, 4), x.verdict,
        )
        for x in acceptance.lengths
    ]  # fmt: skip
    columns = ("length", "pose", "largest error\nmm", "U\nmm", "limit\nmm", "verdict")
    table = Table("", columns, (42.0, 26.0, 24.0, 22.0, 22.0, 24.0), tuple(rows), 2)
    text = f"{acceptance.words}: {acceptance.verdict.upper()}.{doubts} {acceptance.rule}."
    return Section("conformity", "Conformity with the limit", (text,), (table,))


def _budgets(procedure: ProcedureReport) -> Section | None:
    if not procedure.budgets:
        return None
    text = (
        "Uncertainty of a single measured error after the GUM: standard uncertainties, evaluation (type A or B), "
        "degrees of freedom, and share of the variance, largest first. Effective degrees of freedom after "
        "Welch-Satterthwaite, k for 95.45 %."
    )
    return Section("budget", "Uncertainty budget", (text,), tuple(_budget(b) for b in procedure.budgets))


def _budget(budget: BudgetReport) -> Table:
    freedom = _freedom(budget.freedom)
    title = (
        f"{name_of(budget.bar, budget.start, budget.end)}: u = {number(budget.combined_mm, 4)} mm, effective degrees "
        f"of freedom {freedom}, k = {number(budget.coverage_factor, 2)}, U = {number(budget.expanded_mm, 4)} mm"
        + (f". To lessen it: {budget.remedy}." if budget.remedy else ".")
    )
    rows = []
    for c in sorted(budget.contributions, key=lambda c: -c.share):
        note = "" if c.contained_mm is None else f"{number(c.contained_mm, 4)} mm, within repeatability"
        cells = (
            c.name,
            c.distribution,
            c.evaluation,
            number(c.standard_mm, 5),
            _freedom(c.freedom),
            f"{100 * c.share:.0f} %",
            note,
        )
        rows.append(cells)
    columns = ("contribution", "distribution", "type", "u\nmm", "degrees of\nfreedom", "share", "")
    return Table(title, columns, (30.0, 26.0, 12.0, 22.0, 22.0, 16.0, 48.0), tuple(rows), 2)


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
            bar.id, bar.serial or NONE, bar.certificate or NONE, bar.laboratory or NONE, bar.issued or NONE,
            bar.valid_until or NONE, f"{1e6 * bar.expansion_per_kelvin:.2f}",
        )
        for bar in procedure.bars
    ]  # fmt: skip
    columns = ("bar", "serial", "certificate", "laboratory", "issued", "valid until", "expansion\n10⁻⁶/K")
    about = Table("", columns, (16.0, 28.0, 32.0, 36.0, 22.0, 22.0, 18.0), tuple(rows), 6)
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
    columns = ("length", "certified\nmm", "U\nmm", "k", "at °C")
    certified = Table("", columns, (46.0, 30.0, 22.0, 12.0, 14.0), tuple(lengths))
    text = "Reference bars of this verification. None of them gave the scale."
    return Section("artefacts", "Artefacts and certificates", (text,), (about, certified))


def _temperatures(procedure: ProcedureReport) -> Section | None:
    if not procedure.poses:
        return None
    known = [pose.temperature_c for pose in procedure.poses if pose.temperature_c is not None]
    text = (
        f"Of the bars: {min(known):.1f} to {max(known):.1f} °C. Lengths are corrected to them from the certificates' "
        "reference temperature."
        if known
        else "The bars' temperatures were not measured."
    )
    rows = tuple((pose.id, pose.bar, number(pose.temperature_c, 2)) for pose in procedure.poses)
    table = Table("", ("pose", "bar", "temperature\n°C"), (40.0, 30.0, 30.0), rows, 2)
    return Section("temperatures", "Temperatures", (text,), (table,))


def _departures(procedure: ProcedureReport) -> Section:
    volume = ""
    if procedure.volume is not None:
        sides = " x ".join(f"{side:.0f}" for side in procedure.volume[0])
        volume = f"Volume {sides} mm, space diagonal {procedure.volume[1]:.0f} mm. "
    return Section(
        "departures", procedure.title, (f"{volume}It departs from the guideline as follows.", *procedure.departures)
    )


def _measured(bars: BarReport) -> Section:
    rows = [
        (
            row.pose, name_of(*row.key), number(row.length_mm, 4), number(row.reference_mm, 4),
            number(row.error_mm, 4, sign=True), number(row.u_mm, 4), str(row.views),
        )
        for row in bars.measured
    ]  # fmt: skip
    columns = ("pose", "length", "measured\nmm", "reference\nmm", "error\nmm", "u (k = 1)\nmm", "views")
    table = Table("", columns, (26.0, 36.0, 25.0, 25.0, 20.0, 18.0, 11.0), tuple(rows), 2)
    return Section("measured", "All measured lengths", (), (table,))
