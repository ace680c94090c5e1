"""One state: what each step says over all its inputs, and that no page makes a sentence about its state beside it."""

import ast
import itertools
import os
import re
from dataclasses import replace
from typing import Any

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from spherecal_gui import languages
from spherecal_gui.languages import moved_text
from spherecal_gui.presenters import step_states as st
from spherecal_gui.presenters.placement_presenter import Scene
from spherecal_gui.standing import Said
from spherecal_gui.tasks.ghost import ToGo
from tests.conftest import ROOT
from tests.gui_states import all_facts


def said_of(says) -> list[tuple[Any, Said]]:
    """All facts of a step with what it says."""
    return [(facts, says(facts)) for facts in all_facts()[says]]


@pytest.mark.parametrize("says", list(all_facts()), ids=lambda one: one.__name__)
def test_every_state_has_one_instruction_and_a_button_that_says_why_not(says):
    """Where nothing can be pressed it is said why; what can be pressed has a deed and is not done already."""
    found = set()
    for facts, said in said_of(says):
        found.add(said)
        button = said.button
        if says not in (st.connect_says, st.measure_says):  # before the first search, and the first set
            assert said.text or (button is not None and button.why), facts
        if button is None:
            continue
        assert button.text and not (button.enabled and button.done), facts
        assert button.enabled or button.done or button.why, (facts, button)
        assert button.does or not button.enabled, facts
    assert len(found) > 5, "all_facts (tests/gui_states.py) lacks inputs, or the step says too little of its state"


def test_names_in_a_row_are_parted_as_the_language_does_it(qapp):
    languages.use("zh_CN")
    try:
        for says, every in all_facts().items():
            for said in map(says, every):
                words = (said.text, said.stay, *((said.button.text, said.button.why) if said.button else ()))
                assert not any(re.search(r",(?!\d)", word) for word in words), words
        assert "C01、C02" in moved_text(("C01", "C02"))
    finally:
        languages.use("en")


def placements() -> list[tuple[Any, Said]]:
    """Of the placements."""
    return said_of(st.placement_says)


def test_nothing_is_ready_that_is_not_where_it_should_be():
    for facts, said in placements():
        if facts.away and not facts.taken and not facts.work and not facts.scene.board:
            assert not said.text.startswith(("Ready", "Captured")), facts
        if facts.scene.lost and not facts.taken and not facts.work:
            assert said.level == "bad" and "C02" in said.text
        if facts.recorded:
            assert "Move" not in said.text and "Turn" not in said.text and not facts.away
            assert "put-there" not in said.also and "was-turned" not in said.also
        if facts.work:
            assert not said.also
        if facts.work == "computing":
            assert "Hold still" not in said.text


def test_the_counter_never_counts_a_camera_that_sends_nothing():
    for facts, said in placements():
        if facts.scene.lost and len(facts.scene.counts) == 2:
            assert said.count in ("0 / 2", "1 / 2"), facts


def test_there_is_always_something_to_press_at_a_placement_or_a_reason():
    for facts, said in placements():
        button = said.button
        assert button is not None
        assert button.enabled or button.why or (facts.taken and button.done and not facts.scene.lost)


def test_one_goes_on_from_an_empty_placement_only_by_skipping_it():
    for facts, said in placements():
        assert bool(said.stay) == (not facts.taken)
        assert ("skip" in said.also) == (facts.spare and not facts.taken and not facts.work)


def test_no_start_where_cancel_was():
    """A computation that has ended never offers to begin again where "Cancel" was a moment ago."""
    for facts, said in said_of(st.calibrate_says):
        if facts.verdict and not facts.run:
            assert said.button is None or said.button.does == "results"
    for facts, said in said_of(st.results_says):
        if facts.running == "calibrate":
            assert not said.button.enabled, "nothing is accepted while it is computed again"


def test_where_the_ball_goes_is_one_sentence_from_where_it_lies():
    way = ToGo(590.0, 50.0, False, 560.0, 190.0, "C06", True)
    facts = st.PlacementFacts(Scene({"A": 300, "B": 300}, True), to_go=way)
    text = "Move the ball 560 mm towards C06 and 190 mm up, turn it 50° to the left, as on a turntable"
    assert st.placement_says(facts).text == text
    tipped = replace(way, up_mm=-60.0, tips_towards="C01")
    text = "Move the ball 560 mm towards C06 and 60 mm down, tip its top 50° towards C01"
    assert st.move_text(tipped) == text
    right = replace(way, level_mm=2.0, up_mm=1.0, to_the_left=False)
    assert st.move_text(right) == "Leave the ball where it is, turn it 50° to the right, as on a turntable"


@pytest.mark.parametrize(
    ("elapsed", "share", "usual", "text"),
    [
        (0.5, 0.0, None, ""),
        (3.0, 0.0, None, "3 s"),
        (2.0, 0.0, 18.0, "2 s, about 15 s left"),
        (8.0, 0.4, 18.0, "8 s, about 10 s left"),
        (16.0, 0.95, 18.0, "16 s, nearly done"),
        (19.0, 0.9, 18.0, "19 s, nearly done"),
        (30.0, 0.5, 18.0, "30 s, longer than usual (18 s)"),
        (60.0, 0.1, None, "60 s, about 9 min left"),
    ],
)
def test_the_time_left(elapsed, share, usual, text):
    assert st.left_text(elapsed, share, usual) == text


def test_the_time_left_falls():
    """A run of 20 s that took 20 s before, seen every second: it never says "of about" and never rises."""
    left = [st.seconds_left(t, t / 20, 20.0) or 0.0 for t in range(1, 20)]
    assert all(b < a for a, b in itertools.pairwise(left))


def test_every_state_has_its_words_in_three_languages():
    """The table of docs/make_states.py: one instruction a state, none of which lacks a word."""
    from docs.make_states import made_page

    rows = [
        line.split(" | ") for line in made_page().splitlines() if line.startswith("| ") and "instruction" not in line
    ]
    assert len(rows) > 60
    for row in rows:
        assert all(row[1:4]) or not any(cell.strip() for cell in row[1:4]), row


def test_no_page_makes_a_sentence_about_its_state():
    """The only makers of large buttons and of what a step says are the pure functions."""
    found = []
    for path in sorted((ROOT / "spherecal_gui").rglob("*.py")):
        if path.name in ("step_states.py", "standing.py"):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            name = getattr(node.func, "id", "") if isinstance(node, ast.Call) else ""
            if name in ("Button", "Said") and any(
                w for w in ast.walk(node) if getattr(w, "attr", "") in ("tr", "text")
            ):
                found.append(f"{path.name}: {ast.unparse(node)}")
    assert not found
