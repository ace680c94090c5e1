"""One state: what each step says over all its inputs, and that no page makes a sentence about its state beside it."""

import ast
import functools
import itertools
import os
from dataclasses import replace

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from spherecal_gui.presenters import step_states as st
from spherecal_gui.presenters.placement_presenter import Scene
from spherecal_gui.standing import Said
from spherecal_gui.tasks.ghost import ToGo
from spherecal_gui.workflow import Status
from tests.conftest import ROOT

ON = (False, True)
LEVELS = ("none", "good", "caution", "bad")
SCENES = [
    Scene(counts, still, lost, board, made_up)
    for counts in ({}, {"C01": 0, "C02": 0}, {"C01": 200, "C02": 30}, {"C01": 200, "C02": 300})
    for still in (None, False, True)
    for lost in ((), ("C02",))
    for board in ON
    for made_up in ON
]
WAYS = (None, ToGo(10.0, 3.0, near=True), ToGo(560.0, 45.0, near=False, level_mm=500.0, up_mm=200.0, towards="C02"))


@functools.cache
def all_facts() -> tuple:
    """Every input of every step, once."""
    return tuple(_all_facts())


def _all_facts():
    """Every input of every step."""
    for words in (("", "none"), ("2 of 2 cameras ready", "good"), ("No cameras yet", "bad")):
        for three in itertools.product(ON, repeat=3):
            yield st.connect_says, st.ConnectFacts(words, *three)
    for level, four in itertools.product(LEVELS, itertools.product(ON, repeat=4)):
        yield st.look_says, st.LookFacts(("Words", level), *four)
    works = ("", "exposing", "computing", "other")
    for scene, way, work in itertools.product(SCENES, WAYS, works):
        for taken, flawed, connected, before, enough, recorded in itertools.product(ON, repeat=6):
            yield st.placement_says, st.PlacementFacts(
                scene, taken, taken and flawed, work, connected, before, way, enough, recorded, spare=before
            )
    guides = (None, ("Lay it", "caution", False), ("Ready", "good", True))
    bars = [
        st.BarFacts(pose, count, work, connected, guide if pose else None, recorded)
        for pose, count, work in itertools.product((None, "A-01"), (0, 2, 3), works)
        for connected, guide, recorded in itertools.product(ON, guides, ON)
    ]
    for one in bars:
        yield st.bar_says, one
        for outcome, three in itertools.product((None, ("PASS", "good"), ("FAIL", "bad")), itertools.product(ON, repeat=3)):
            yield st.verify_says, st.VerifyFacts(one, outcome, *three)
    for status, verdict, run in itertools.product(
        Status, ("", "valid", "use with care", "not valid"), ("", "running", "stopping", "keeping")
    ):
        for error, busy, taken in itertools.product(ON, ON, (2, 4)):
            yield st.calibrate_says, st.CalibrateFacts(status, "A reason.", error, verdict, run, busy, taken, 4, "9 s")
    found = (None, ("VALID", "good", True), ("NOT VALID", "bad", False))
    for verdict, stale, accepted, running in itertools.product(found, ON, ON, ("", "calibrate", "save")):
        yield st.results_says, st.ResultFacts(verdict, stale, accepted, running)
    for status, verdict, running in itertools.product(Status, ("valid", "use with care", "not valid"), ("", "save", "x")):
        for five in itertools.product(ON, repeat=5):
            for why in ("", "Not verified."):
                yield st.save_says, st.SaveFacts(status, verdict, *five[:4], why, five[4], running)
    for status, verdict, reason in itertools.product(Status, (None, ("OK", "good"), ("WATCH", "caution")), ("", "Why.")):
        if status is Status.BLOCKED and not reason:
            continue  # a blocked step has a reason
        for well, running in itertools.product(ON, ("", "check", "x")):
            yield st.check_says, st.CheckFacts(status, verdict, reason, well, running)
    for trust, measuring, count in itertools.product((("", "none"), ("Agree.", "good")), ON, (None, 0, 9)):
        yield st.measure_says, st.MeasureFacts(trust, measuring, count)


def test_every_state_has_one_instruction_and_a_button_that_says_why_not():
    """Where nothing can be pressed it is said why; a state that is red is never done; "away" never says "ready"."""
    seen: dict[str, set[Said]] = {}
    for says, facts in all_facts():
        said = says(facts)
        seen.setdefault(says.__name__, set()).add(said)
        button = said.button
        told = said.text or (button is not None and button.why) or facts in (st.ConnectFacts(("", "none")),)
        if says is not st.connect_says and says is not st.measure_says:
            assert told, facts
        assert button is None or button.text
        if button is not None and not button.enabled and not button.done and button.text != "Stopping":
            assert button.why, (facts, button)
        assert not (button is not None and button.enabled and button.done), facts
        if button is not None and button.enabled:
            assert button.does, facts
    assert len(seen) == 10
    assert len(seen["placement_says"]) > 150


def placements():
    return [(facts, says(facts)) for says, facts in all_facts() if says is st.placement_says]


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
    for says, facts in all_facts():
        if says is st.calibrate_says and facts.verdict and not facts.run:
            button = says(facts).button
            assert button is None or button.does == "results"
        if says is st.results_says and facts.running == "calibrate":
            assert not says(facts).button.enabled, "nothing is accepted while it is computed again"


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
    left = [st.seconds_left(t, t / 20, 20.0) for t in range(1, 20)]
    assert all(b < a for a, b in itertools.pairwise(left))


def test_no_page_makes_a_sentence_about_its_state():
    """The only callers of setText on a headline, and the only makers of buttons, are the base and the pure functions."""
    found = []
    for path in sorted((ROOT / "spherecal_gui").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in ("Button", "Said", "PageAction") and path.name not in ("step_states.py", "standing.py"):
                empty = name == "Said" and all(isinstance(a, ast.Constant) and a.value in ("none", "") for a in node.args)
                if not empty:
                    found.append(f"{path.name}:{node.lineno} {name}")
    assert not found
