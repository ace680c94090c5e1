"""The bench while somebody describes it: what was typed, what is wrong with it in plain words, what it means."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import date
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase
from spherecal.data.session import STANDARD_PLACEMENTS, Bar
from spherecal.targets.family import FAMILY, make_target_set
from spherecal.targets.target_set import TargetSet
from spherecal_files.bar_registry import MARKS, REGISTERED_BAR, RegisteredBar, read_lengths
from spherecal_files.filesystem import as_id
from spherecal_files.json_file import JsonValue, printable
from spherecal_gui import languages
from spherecal_gui.languages import translate
from spherecal_gui.presenters.bars_presenter import state_words
from spherecal_gui.project import FEW_PLACEMENTS
from spherecal_gui.standing import Level
from spherecal_rigs.ball_registry import (
    USUAL_PRINT,
    WORST_PRINT,
    Bench,
    BenchBar,
    PrintedSpacing,
    RegisteredBall,
    longest_spacing,
    print_error,
)

if TYPE_CHECKING:  # imports scipy
    from spherecal_cameras.plan import CapturePlan

# A marble and a room; what is meant in metres or inches is outside for most balls.
_DIAMETERS_MM = (5.0, 5000.0)
_MOST_PLACEMENTS = 50
_SCALE_POSES, _CHECK_POSES = 2, 3  # of the bar that gives the scale; of one that verifies, until the engine guides them


@dataclass(frozen=True)
class LengthDraft:
    """A certified length as it is typed: two marks with their stickers (`201`, `201:E`), figures in mm, k."""

    from_mark: str = ""
    from_sticker: str = ""
    to_mark: str = ""
    to_sticker: str = ""
    nominal: str = ""
    certified: str = ""
    uncertainty: str = ""
    factor: str = ""


@dataclass(frozen=True)
class BarDraft:
    """A bar as it is typed; `kept` is the serial that the library has it by, `expansion` in millionths per kelvin."""

    serial: str = ""
    description: str = ""
    lengths: tuple[LengthDraft, ...] = (LengthDraft("A1", "", "A2", ""),)
    expansion: str = ""
    reference: str = ""
    certificate: str = ""
    laboratory: str = ""
    issued: str = ""
    valid_until: str = ""
    role: str = "none"
    id: str = ""
    kept: str = ""


@dataclass(frozen=True)
class BallDraft:
    """A ball as it is typed; `own` targets come from a file and stand in the place of first, last and width."""

    name: str = ""
    diameter: str = ""
    first: str = "1"
    last: str = "208"
    width: str = "28"
    measured: str = ""
    own: TargetSet | None = field(default=None, compare=False)
    own_file: str = ""

    @property
    def empty(self) -> bool:
        """Whether nothing was said of a ball."""
        return not (self.name.strip() or self.diameter.strip() or self.measured.strip())


@dataclass(frozen=True)
class BenchDraft:
    """Everything on the bench as it is typed."""

    ball: BallDraft = BallDraft()
    bars: tuple[BarDraft, ...] = ()
    placements: str = str(STANDARD_PLACEMENTS)
    celsius: str = ""


Problems = dict[str, str]
Marks = dict[str, dict[str, int | str]]  # by name: target and point, as files have them


# --- words in, words out ---------------------------------------------------------------------------------------------


def number_of(text: str) -> float | None:
    """A number as people type it, with a decimal point or comma; None where it is none."""
    plain = "".join(text.split()).replace("\u2212", "-").replace(",", ".")
    try:
        value = float(plain)
    except ValueError:
        return None
    return value if abs(value) < 1e30 else None


def shown(value: float | None) -> str:
    """A number as it is typed again."""
    return "" if value is None else f"{value:.12g}"


def said(problem: object) -> str:
    """A problem of the engine's as a sentence of its own, in the reader's language."""
    text = phrase(problem, languages.now()) if isinstance(problem, Phrase) else str(problem)
    return f"{text[:1].upper()}{text[1:]}{'。' if languages.now().startswith('zh') else '.'}"


def _number(
    text: str, key: str, problems: Problems, low: float | None = None, high: float | None = None
) -> float | None:
    value = number_of(text)
    if value is None:
        problems[key] = said(Phrase("problem-cell-number", {"text": printable(text.strip())}))
    elif (low is not None and value < low) or (high is not None and value > high):
        words = translate("Bench", "Must be from {low} to {high}.")
        problems[key] = words.format(low=shown(low), high=shown(high))
        return None
    return value


# --- bars ------------------------------------------------------------------------------------------------------------

_LENGTH_FIELDS = {
    "length_mm": "certified", "nominal_mm": "nominal", "expanded_uncertainty_mm": "uncertainty",
    "coverage_factor": "factor", "from": "from_mark", "to": "to_mark",
}  # fmt: skip
_BAR_FIELDS = {
    "serial": "serial", "description": "description", "expansion_per_kelvin": "expansion",
    "reference_temperature_c": "reference", "number": "certificate", "laboratory": "laboratory", "date": "issued",
    "valid_until": "valid_until",
}  # fmt: skip


def bar_draft(bar: RegisteredBar, role: str = "none", id: str = "") -> BarDraft:
    """A bar of the library, to be changed."""
    c, own = bar.certificate, bar.assumed
    lengths = []
    for one in bar.lengths:
        ends = one.from_mark, _sticker(bar, one.from_mark), one.to_mark, _sticker(bar, one.to_mark)
        uncertainty = "" if "expanded_uncertainty_mm" in one.assumed else shown(one.expanded_uncertainty_mm)
        factor = "" if "coverage_factor" in one.assumed else shown(one.coverage_factor)
        lengths.append(LengthDraft(*ends, shown(one.nominal_mm), shown(one.length_mm), uncertainty, factor))
    expansion = "" if "expansion_per_kelvin" in own else shown(1e6 * bar.expansion_per_kelvin)
    reference = "" if "reference_temperature_c" in own else shown(bar.reference_temperature_c)
    paper = (c.number, c.laboratory, str(c.date or ""), str(c.valid_until or "")) if c else ("", "", "", "")
    about = bar.serial, bar.description, tuple(lengths), expansion, reference
    return BarDraft(*about, *paper, role, id, bar.serial)


def _sticker(bar: RegisteredBar, name: str) -> str:
    mark = bar.marks[name]
    return str(mark.target) if mark.point == "centre" else f"{mark.target}:{mark.point}"


def registered(bar: Bar) -> RegisteredBar:
    """A bar of a session as the library would have it, by its serial, else by its id."""
    material = bar.expansion_per_kelvin, bar.reference_temperature_c
    return RegisteredBar(bar.serial or bar.id, bar.marks, bar.lengths, *material, "", bar.certificate, bar.assumed)


def read_bar(draft: BarDraft) -> tuple[RegisteredBar | None, Problems]:
    """The bar that is meant (None where something is wrong), and what is wrong, by field."""
    problems: Problems = {}
    marks: Marks = {}
    lengths = [_length_entry(one, number, marks, problems) for number, one in enumerate(draft.lengths)]
    entry: dict[str, object] = {"serial": draft.serial.strip(), "marks": marks, "lengths": lengths}
    if draft.description.strip():
        entry["description"] = draft.description.strip()
    if draft.expansion.strip() and (value := _number(draft.expansion, "expansion", problems)) is not None:
        entry["expansion_per_kelvin"] = float(f"{1e-6 * value:.12g}")
    if draft.reference.strip() and (value := _number(draft.reference, "reference", problems)) is not None:
        entry["reference_temperature_c"] = value
    about = {"laboratory": draft.laboratory, "date": draft.issued, "valid_until": draft.valid_until}
    about = {key: text.strip() for key, text in about.items() if text.strip()}
    if draft.certificate.strip():
        entry["certificate"] = {"number": draft.certificate.strip(), **about}
    elif about:
        problems["certificate"] = translate("Bench", "The certificate's number is missing.")
    if not draft.lengths:
        problems["lengths"] = translate("Bench", "At least one certified length is needed.")
    return _checked(entry, problems), problems


def _length_entry(draft: LengthDraft, number: int, marks: Marks, problems: Problems) -> dict[str, object]:
    """A length as files have it; its marks join those of the bar."""
    place = f"length.{number}"
    entry: dict[str, object] = {}
    ends: list[str] = []
    for end, name, text, key in (
        ("from", draft.from_mark, draft.from_sticker, "from_sticker"),
        ("to", draft.to_mark, draft.to_sticker, "to_sticker"),
    ):
        target, _, point = text.strip().partition(":")
        if not target.isdecimal():
            problems[f"{place}.{key}"] = translate("Bench", "The number printed at the sticker, such as 201.")
            continue
        called = name.strip() or f"T{int(target)}"
        mark: dict[str, int | str] = {"target": int(target), "point": point.strip() or "centre"}
        if marks.setdefault(called, mark) != mark:
            known = marks[called]["target"]
            problems[f"{place}.{key}"] = said(Phrase("problem-cell-mark", {"mark": called, "target": known}))
        entry[end] = called
        ends.append(called)
    if not draft.certified.strip():
        problems[f"{place}.certified"] = translate("Bench", "The length on the certificate, in mm.")
    for key in ("length_mm", "nominal_mm", "expanded_uncertainty_mm", "coverage_factor"):
        text, where = getattr(draft, _LENGTH_FIELDS[key]), f"{place}.{_LENGTH_FIELDS[key]}"
        if text.strip() and (value := _number(text, where, problems)) is not None:
            entry[key] = value
    if not any(key.startswith(place) for key in problems):
        try:
            own = {name: marks[name] for name in ends}
            read_lengths(JsonValue([entry], Path()), MARKS.read(JsonValue(own, Path())))
        except InputError as error:
            problems.update(_by_field(error, _LENGTH_FIELDS, f"{place}."))
    return entry


def _checked(entry: Mapping[str, object], problems: Problems) -> RegisteredBar | None:
    """What the registry's own reader says of the whole bar."""
    if problems:  # then only what does not depend on what is wrong already
        entry = {
            "marks": {"a": {"target": 1, "point": "centre"}, "b": {"target": 2, "point": "centre"}},
            "lengths": [{"from": "a", "to": "b", "length_mm": 1.0}],
            **{key: value for key, value in entry.items() if key not in ("marks", "lengths")},
        }
    whole = not problems
    try:
        bar = REGISTERED_BAR.read(JsonValue(dict(entry), Path()))
    except InputError as error:
        for key, text in _by_field(error, _BAR_FIELDS).items():
            problems.setdefault(key, text)
        return None
    return bar if whole else None


def _by_field(error: InputError, fields: Mapping[str, str], before: str = "") -> Problems:
    """The engine's complaint, at the field that it is about."""
    what = error.parts[0]
    values = what.values if isinstance(what, Phrase) else {}
    key = str(values.get("place", "")).rstrip("]").replace("]", ".").replace("[", ".").split(".")[-1]
    return {f"{before}{fields.get(key, 'serial' if not before else 'certified')}": said(values.get("problem", what))}


# --- the ball --------------------------------------------------------------------------------------------------------


def ball_draft(ball: RegisteredBall) -> BallDraft:
    """A ball of the library, to be changed."""
    measured = shown(ball.spacing.distance_mm) if ball.spacing is not None else ""
    return _with_targets(BallDraft(ball.name, shown(ball.nominal_diameter_mm), measured=measured), ball.target_set)


def _with_targets(draft: BallDraft, targets: TargetSet) -> BallDraft:
    """The draft with these targets, by their numbers and width where they are of our own family, else as they are."""
    ids = sorted(targets.layouts)
    typed = replace(draft, first=str(ids[0]), last=str(ids[-1]), width=shown(targets.size_mm))
    numbered = targets.family == FAMILY and ids == list(range(ids[0], ids[-1] + 1))
    with suppress(InputError):
        if numbered and make_target_set(len(ids), targets.size_mm, start_id=ids[0]) == targets:
            return typed
    return replace(typed, own=targets, own_file=targets_words(targets))


def targets_words(targets: TargetSet) -> str:
    """How many targets, which numbers, how wide."""
    ids = sorted(targets.layouts)
    words = translate("Bench", "{count} targets, nos. {first}-{last}, {width} mm")
    return words.format(count=len(ids), first=ids[0], last=ids[-1], width=shown(targets.size_mm))


@lru_cache(maxsize=8)
def _numbered(first: int, last: int, width: float) -> TargetSet:
    """The targets of our own family; asked for with every letter that is typed."""
    return make_target_set(last - first + 1, width, start_id=first)


def read_targets(draft: BallDraft, problems: Problems) -> TargetSet | None:
    """The targets that are meant."""
    if draft.own is not None:
        return draft.own
    numbers: dict[str, int] = {}
    for key, text in (("first", draft.first), ("last", draft.last)):
        if not text.strip().isdecimal():
            problems[f"ball.{key}"] = translate("Bench", "A whole number, as printed at the stickers.")
        else:
            numbers[key] = int(text)
    width = _number(draft.width, "ball.width", problems, 1.0, 1000.0)
    if len(numbers) < 2 or width is None:
        return None
    try:
        return _numbered(numbers["first"], numbers["last"], width)
    except InputError as error:
        problems["ball.last"] = error.words(languages.now())[0]
        return None


def read_ball(draft: BallDraft) -> tuple[RegisteredBall | None, Problems]:
    """The ball that is meant (None where something is wrong or nothing is said), and what is wrong."""
    problems: Problems = {}
    if draft.empty:
        return None, problems
    if not draft.name.strip():
        problems["ball.name"] = translate("Bench", "A name by which you know the ball.")
    else:
        try:
            JsonValue(draft.name.strip(), Path()).name()
        except InputError as error:
            problems.update(_by_field(error, {}, "ball."))
            problems["ball.name"] = problems.pop("ball.certified", "")
    if not draft.diameter.strip():
        problems["ball.diameter"] = translate("Bench", "Measure it with a tape: a centimetre is near enough.")
        diameter = None
    else:
        diameter = _number(draft.diameter, "ball.diameter", problems, *_DIAMETERS_MM)
    targets = read_targets(draft, problems)
    spacing = _spacing(draft, targets, problems)
    if problems or targets is None or diameter is None:
        return None, problems
    return RegisteredBall(draft.name.strip(), diameter, targets, spacing), problems


def _spacing(draft: BallDraft, targets: TargetSet | None, problems: Problems) -> PrintedSpacing | None:
    pair = longest_spacing(targets) if targets is not None else None
    if not draft.measured.strip() or pair is None or targets is None:
        return None
    measured = _number(draft.measured, "ball.measured", problems)
    if measured is None:
        return None
    spacing = PrintedSpacing(pair[0], pair[1], measured)
    error = print_error(targets, spacing) if measured > 0 else None
    if error is None or abs(error) > WORST_PRINT:
        words = translate("Bench", "{first} and {second} are {mm:.2f} mm apart as designed: measure these two, in mm.")
        problems["ball.measured"] = words.format(first=pair[0], second=pair[1], mm=pair[2])
        return None
    return spacing


def print_text(draft: BallDraft) -> tuple[str, Level]:
    """What the printed-scale check says."""
    targets = read_targets(draft, {})
    pair = longest_spacing(targets) if targets is not None else None
    if targets is None or pair is None:
        return "", "none"
    spacing = _spacing(draft, targets, {})
    if spacing is None:
        words = translate(
            "Bench", "Measure from dot {first} to dot {second} of a sticker with a caliper: {mm:.2f} mm as designed."
        )
        return words.format(first=pair[0], second=pair[1], mm=pair[2]), "none"
    error = print_error(targets, spacing) or 0.0
    text = translate("Bench", "Printed {percent:.2f} % too large.")
    if error < 0:
        text = translate("Bench", "Printed {percent:.2f} % too small.")
    text = text.format(percent=100 * abs(error))
    if abs(error) <= USUAL_PRINT:
        usual = translate("Bench", "Printers err by 0.5 % at most: this is as usual.")
        return f"{text} {usual}", "good"
    more = translate(
        "Bench", "More than printers err: print at 100 %, without fitting to the page, or give the width as printed."
    )
    return f"{text} {more}", "caution"


# --- the whole -------------------------------------------------------------------------------------------------------


def read_bench(draft: BenchDraft) -> tuple[Bench | None, tuple[RegisteredBar | None, ...], Problems]:
    """The bench (None where it is not whole), its bars in the draft's order, and all that is wrong, by field."""
    ball, problems = read_ball(draft.ball)
    bars = []
    for number, one in enumerate(draft.bars):
        bar, wrong = read_bar(one)
        bars.append(bar)
        problems |= {f"bar.{number}.{key}": text for key, text in wrong.items()}
    problems |= {key: text for key, text in _together(draft, bars).items() if key not in problems}
    placements = draft.placements.strip()
    if not placements.isdecimal() or not FEW_PLACEMENTS <= int(placements) <= _MOST_PLACEMENTS:
        words = translate("Bench", "From {low} to {high} placements of the ball.")
        problems["placements"] = words.format(low=FEW_PLACEMENTS, high=_MOST_PLACEMENTS)
    celsius = _number(draft.celsius, "celsius", problems, -20.0, 60.0) if draft.celsius.strip() else None
    if problems or ball is None:
        return None, tuple(bars), problems
    chosen = []
    for number, (one, bar) in enumerate(zip(draft.bars, bars, strict=True), start=1):
        if bar is not None and one.role != "none":
            name = one.id or as_id(one.serial.strip(), f"bar{number}")
            poses = _SCALE_POSES if one.role == "scale" else _CHECK_POSES
            chosen.append(BenchBar(name, bar.serial, "scale" if one.role == "scale" else "check", poses))
    return Bench(ball, tuple(chosen), int(placements), celsius), tuple(bars), problems


def _together(draft: BenchDraft, bars: Iterable[RegisteredBar | None]) -> Problems:
    """What is wrong between bars, and between bars and ball."""
    problems: Problems = {}
    serials: dict[str, int] = {}
    stickers: dict[int, str] = {}
    scale: str | None = None
    targets = read_targets(draft.ball, {}) if not draft.ball.empty else None
    for number, (one, bar) in enumerate(zip(draft.bars, bars, strict=True)):
        serial = one.serial.strip()
        if serial and serials.setdefault(serial, number) != number:
            problems[f"bar.{number}.serial"] = translate("Bench", "Another bar has this serial number.")
        if one.role == "scale":
            if scale is not None:
                words = translate("Bench", "Only one bar gives the scale; {bar} does already.")
                problems[f"bar.{number}.role"] = words.format(bar=scale)
            scale = scale or serial
        if bar is None or one.role == "none":
            continue
        for mark in bar.marks.values():
            if targets is not None and mark.target not in targets.layouts:
                words = translate("Bench", "Sticker {number} is none of the ball's target set ({targets}).")
                problems[f"bar.{number}.role"] = words.format(number=mark.target, targets=targets_words(targets))
            if stickers.setdefault(mark.target, serial) != serial:
                words = translate("Bench", "Sticker {number} is on bar {bar} as well.")
                problems[f"bar.{number}.role"] = words.format(number=mark.target, bar=stickers[mark.target])
    return problems


def warnings(draft: BenchDraft) -> list[str]:
    """What may be as it is, but should be known."""
    roles = [one.role for one in draft.bars]
    found = []
    if draft.ball.empty:
        return found
    if "scale" not in roles and not draft.ball.measured.strip():
        found.append(translate("Bench", "Nothing gives the scale: lengths will be arbitrary."))
    if "check" not in roles:
        found.append(translate("Bench", "No bar verifies: the calibration cannot be verified."))
    return found


def bars_of(known: Mapping[str, RegisteredBar], on_bench: Iterable[Bar]) -> tuple[BarDraft, ...]:
    """All bars of the library and those that stand on a bench, which come first."""
    first = []
    for bar in on_bench:
        own = registered(bar)
        kept = known.get(own.serial)
        first.append(replace(bar_draft(kept or own, bar.role, bar.id), kept=own.serial if kept is not None else ""))
    there = {one.serial for one in first}
    return (*first, *(bar_draft(bar) for bar in known.values() if bar.serial not in there))


def bench_draft(
    plan: "CapturePlan | None", balls: Mapping[str, RegisteredBall], known: Mapping[str, RegisteredBar]
) -> BenchDraft:
    """The bench that a plan describes, beside all that the library has."""
    if plan is None or plan.target_set is None:
        ball = next((ball_draft(one) for one in balls.values()), BallDraft()) if len(balls) == 1 else BallDraft()
        return BenchDraft(ball, bars_of(known, ()))
    diameter = plan.fields.get("sphere", {}).get("nominal_diameter_mm")
    scale = plan.fields.get("scale") or {}
    spacing = scale.get("distance_mm") if scale.get("kind") == "target_spacing" else None
    same = (one for one in balls.values() if one.target_set == plan.target_set and one.nominal_diameter_mm == diameter)
    named = next(same, None)
    ball = _with_targets(BallDraft(named.name if named else "", shown(diameter)), plan.target_set)
    pair = longest_spacing(plan.target_set)
    if spacing is not None and pair is not None and {scale.get("from"), scale.get("to")} == set(pair[:2]):
        ball = replace(ball, measured=shown(spacing))
    elif named is not None and named.spacing is not None:
        ball = replace(ball, measured=shown(named.spacing.distance_mm))
    if not ball.name and diameter is not None:
        ball = replace(ball, name=translate("Bench", "Ball {mm} mm").format(mm=shown(diameter)))
    placements = sum(one.bar is None for one in plan.sets)
    warm = next((one.temperature_c for one in plan.sets if one.temperature_c is not None), None)
    return BenchDraft(ball, bars_of(known, plan.bars), str(max(placements, FEW_PLACEMENTS)), shown(warm))


def certificate_state(draft: BarDraft, today: date) -> tuple[str, Level]:
    """The state of a bar's certificate, in a few words."""
    bar, _ = read_bar(draft)
    return state_words(bar.certificate, today) if bar is not None else (translate("Bench", "incomplete"), "caution")
