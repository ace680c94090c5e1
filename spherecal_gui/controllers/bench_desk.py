"""The library of bars and balls and the rig's bench, while somebody changes them: undo, import, saving."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from spherecal.base.errors import InputError, SpherecalError
from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase
from spherecal_cameras.plan import CapturePlan, read_plan
from spherecal_files.bar_registry import BAR_REGISTRY, RegisteredBar
from spherecal_files.target_set_file import read_target_set
from spherecal_gui import languages
from spherecal_gui.languages import error_line, translate
from spherecal_gui.presenters.bench_presenter import (
    BallDraft,
    BarDraft,
    BenchDraft,
    Problems,
    ball_draft,
    bar_draft,
    bench_draft,
    read_bench,
    targets_words,
)
from spherecal_gui.project_folder import rig_bench
from spherecal_rigs.ball_registry import BALL_REGISTRY, Bench, write_bench
from spherecal_rigs.bars_table import arrivals, read_bars_table, write_bars_table

_MOST_STEPS = 500

T = TypeVar("T")


@dataclass(frozen=True)
class Imported:
    """What became of a table: bars that came in, that were there with other figures, lines that could not be used."""

    entered: tuple[str, ...]
    other: tuple[str, ...]
    lines: tuple[str, ...]

    @property
    def text(self) -> str:
        """In words, the first lines with their problems."""
        parts = [translate("Bench", "Bars taken over: {count}.").format(count=len(self.entered))]
        if self.other:
            message = translate("Bench", "With other figures than the library's, which can be undone: {bars}.")
            parts.append(message.format(bars=languages.listed(self.other)))
        if self.lines:
            parts.append(translate("Bench", "Lines that could not be used: {count}.").format(count=len(self.lines)))
        return " ".join(parts) + "".join(f"\n{line}" for line in self.lines)


class BenchDesk:
    """What is described, with its history; nothing is on disk before it is saved."""

    def __init__(self, projects: Path, plan: CapturePlan | None = None) -> None:
        """`plan` is what is there now (spherecal_cameras.plan); without one the rig's bench, if there is one."""
        self.projects = projects
        self.trouble = ""  # why the library could not be read
        self._known = self._read(BAR_REGISTRY.read, {})
        self.balls = self._read(BALL_REGISTRY.read, {})  # of the library
        if plan is None and rig_bench(projects).is_file():
            plan = self._read(lambda: read_plan(rig_bench(projects)), None)
        self.draft = bench_draft(plan, self.balls, self._known)
        self._saved = self.draft
        self.past: list[tuple[str, BenchDraft]] = []  # what was changed, and the draft before
        self.future: list[tuple[str, BenchDraft]] = []  # what was undone
        self.on_change: Callable[[], None] = lambda: None  # who shows the draft

    def _read(self, read: Callable[[], T], otherwise: T) -> T:
        try:
            return read()
        except SpherecalError as error:
            self.trouble = f"{self.trouble} {error_line(error)}".strip()
            return otherwise

    def change(self, what: str, draft: BenchDraft) -> None:
        """Another draft; changes of the same `what` in a row are one step."""
        if draft != self.draft or draft.ball.own is not self.draft.ball.own:
            if not (what and self.past and self.past[-1][0] == what):
                self.past.append((what, self.draft))
                del self.past[:-_MOST_STEPS]
            self.future.clear()
            self.draft = draft
        self.on_change()

    def undo(self) -> None:
        """One step back."""
        self._step(self.past, self.future)

    def redo(self) -> None:
        """One step forward again."""
        self._step(self.future, self.past)

    def _step(self, steps: list[tuple[str, BenchDraft]], others: list[tuple[str, BenchDraft]]) -> None:
        if steps:
            what, draft = steps.pop()
            others.append((what, self.draft))
            self.draft = draft
            self.on_change()

    @property
    def changed(self) -> bool:
        """Whether something is not on disk."""
        return self.draft != self._saved or self.draft.ball.own is not self._saved.ball.own

    def take_ball(self, name: str) -> None:
        """A ball of the library; an empty name begins a new one."""
        ball = ball_draft(self.balls[name]) if name in self.balls else BallDraft()
        self.change("", replace(self.draft, ball=ball))

    def take_targets(self, path: Path) -> str:
        """The target set of a file in place of numbers and width; what is wrong with it."""
        try:
            targets = read_target_set(path)
        except SpherecalError as error:
            return error_line(error)
        ball = replace(self.draft.ball, own=targets, own_file=f"{path.name}: {targets_words(targets)}")
        self.change("", replace(self.draft, ball=ball))
        return ""

    def own_targets(self) -> None:
        """Numbers and width again."""
        self.change("", replace(self.draft, ball=replace(self.draft.ball, own=None, own_file="")))

    def add_bar(self) -> None:
        """One more bar, behind the others."""
        self.change("", replace(self.draft, bars=(*self.draft.bars, BarDraft(role="check"))))

    def remove_bar(self, number: int) -> None:
        """Take a bar out of the library; it can be undone until the end, and is on disk until it is saved."""
        bars = self.draft.bars
        self.change("", replace(self.draft, bars=(*bars[:number], *bars[number + 1 :])))

    def import_table(self, path: Path) -> Imported | str:
        """Take the bars of a table into the draft; or why it is no such table."""
        try:
            table = read_bars_table(path)
        except SpherecalError as error:
            return error_line(error)
        found = arrivals(table, self._known)
        bars = list(self.draft.bars)
        places = {one.serial.strip(): place for place, one in enumerate(bars)}
        for bar in (*found.new, *found.other):
            place = places.get(bar.serial)
            if place is None:
                bars.append(replace(bar_draft(bar), kept=""))
            else:
                before = bars[place]
                bars[place] = replace(bar_draft(bar, before.role, before.id), kept=before.kept)
        self.change("", replace(self.draft, bars=tuple(bars)))
        lines = tuple(f"{one.serial or '-'}: {phrase(one.message, languages.now())}" for one in table.problems)
        entered = tuple(bar.serial for bar in (*found.new, *found.other))
        return Imported(entered, tuple(bar.serial for bar in found.other), lines)

    def export_table(self, path: Path) -> str:
        """Write the bars that are whole as a table; what is wrong."""
        _, bars, _ = read_bench(self.draft)
        try:
            write_bars_table([bar for bar in bars if bar is not None], path)
        except SpherecalError as error:
            return error_line(error)
        return ""

    def checked(self) -> tuple[Bench | None, Problems]:
        """The bench, where it is whole, and what is wrong."""
        bench, _, problems = read_bench(self.draft)
        return bench, problems

    def save(self) -> tuple[Path | None, str]:
        """Write library and bench; the bench's file (None without a ball) and what is wrong: then nothing is lost."""
        bench, bars, problems = read_bench(self.draft)
        if problems or any(bar is None for bar in bars):
            return None, next(iter(problems.values()), "")
        whole = [bar for bar in bars if bar is not None]
        try:
            with ExitStack() as stack:
                stack.enter_context(BAR_REGISTRY.changing(BAR_REGISTRY.path()))
                stack.enter_context(BALL_REGISTRY.changing())
                registry = self._merged(whole)
                balls = BALL_REGISTRY.read()
                if bench is not None:
                    balls = {**balls, bench.ball.name: bench.ball}
                if registry or self._known:
                    BAR_REGISTRY.write(registry)
                if balls != self.balls and balls:
                    BALL_REGISTRY.write(balls)
                path = write_bench(bench, rig_bench(self.projects).parent) if bench is not None else None
        except SpherecalError as error:
            return None, error_line(error)
        self._known, self.balls = registry, balls
        kept = tuple(  # one that only another program has changed is shown as it is now
            replace(one, kept=bar.serial)
            if registry.get(bar.serial) == bar
            else bar_draft(registry[bar.serial], one.role, one.id)
            for one, bar in zip(self.draft.bars, whole, strict=True)
            if bar.serial in registry
        )
        self.draft = replace(self.draft, bars=kept)
        self._saved = self.draft
        return path, ""

    def _merged(self, whole: list[RegisteredBar]) -> dict[str, RegisteredBar]:
        """The registry as it is on disk now with what was changed here; InputError where both changed one bar."""
        now = BAR_REGISTRY.read()
        mine = {bar.serial: bar for bar in whole}
        kept = {one.kept for one in self.draft.bars if one.kept}
        for serial, bar in self._known.items():
            touched = mine.get(serial) != bar or serial not in kept
            if touched and now.get(serial) != bar:
                raise InputError(Phrase("error-bar-changed", {"serial": serial, "file": BAR_REGISTRY.path()}))
        gone = {serial for serial in self._known if serial not in mine}
        changed = {serial: bar for serial, bar in mine.items() if self._known.get(serial) != bar}
        merged = {serial: bar for serial, bar in now.items() if serial not in gone}
        for serial, bar in mine.items():
            if serial not in self._known and now.get(serial, bar) != bar:
                raise InputError(Phrase("error-bar-changed", {"serial": serial, "file": BAR_REGISTRY.path()}))
        return {**merged, **changed}

    @property
    def library(self) -> str:
        """Where the library is."""
        return f"{BAR_REGISTRY.path()}, {BALL_REGISTRY.path()}"
