"""Every input of the functions that say what a step says (spherecal_gui/presenters/step_states.py)."""

import functools
import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from spherecal_gui import languages
from spherecal_gui.presenters import step_states as st
from spherecal_gui.presenters.bars_presenter import lay_text, pose_name
from spherecal_gui.presenters.connect_presenter import CameraLine, connect_summary
from spherecal_gui.presenters.look_presenter import TileState, summary
from spherecal_gui.presenters.placement_presenter import Scene
from spherecal_gui.standing import Level
from spherecal_gui.tasks.ghost import ToGo
from spherecal_gui.workflow import Status

ON = (False, True)
SCENES = tuple(
    Scene(counts, still, lost, board, made_up)
    for counts in ({}, {"C01": 0, "C02": 0}, {"C01": 200, "C02": 30}, {"C01": 200, "C02": 300})
    for still in (None, False, True)
    for lost in ((), ("C02",))
    for board in ON
    for made_up in ON
)
FAR = ToGo(560.0, 45.0, near=False, level_mm=500.0, up_mm=200.0, towards="C02")
WORKS = ("", "exposing", "computing", "other")
VERDICTS = ("valid", "use with care", "not valid")


def every(facts: Any, **values: tuple) -> list:
    """The facts with every combination of these values."""
    return [facts(**dict(zip(values, row, strict=True))) for row in itertools.product(*values.values())]


def _connected() -> list[tuple[str, Level]]:
    """What Connect says of its cameras."""
    one, other = (CameraLine(name, "", name, "", "good", "1", listed=True) for name in ("C01", "C02"))
    lines: tuple[tuple[list[CameraLine], bool, str], ...] = (
        ([], True, ""), ([], False, ""), ([one, other], False, ""), ([one, replace(other, level="caution")], False, ""),
        ([one, replace(other, level="bad")], False, ""), ([replace(one, level="bad")], False, "It failed."),
    )  # fmt: skip
    return [("", "none"), *(connect_summary(*three) for three in lines)]


def _looked() -> list[tuple[str, Level]]:
    """What Camera check says of its images."""
    levels: tuple[tuple[Level, ...], ...] = (("good", "good"), ("good", "caution"), ("good", "bad"), ("good", "none"))
    tiles = [[TileState(f"C0{n}", level, dots=200) for n, level in enumerate(row, 1)] for row in levels]
    lost = [replace(tiles[2][1], lost=True), tiles[2][0]]
    return [summary(states, True) for states in (*tiles, lost)] + [summary(tiles[-1], False)]


@functools.cache
def _facts(_: str) -> dict[Any, list]:
    pose = pose_name("B-01", ("B-01", "B-02"))
    laid = lay_text(SimpleNamespace(bar="A", near=("C01", "C04")))  # type: ignore[arg-type]
    bars = every(
        st.BarFacts,
        pose=(None, pose),
        seeing=(0, 2, 3),
        work=WORKS,
        connected=ON,
        guide=(None, (laid, "caution", False), (laid, "good", True)),
        recorded=ON,
    )
    return {
        st.connect_says: every(
            st.ConnectFacts, summary=tuple(_connected()), cameras=ON, confirmed=ON, busy=ON, described=ON
        ),
        st.look_says: [
            st.LookFacts(("", "none")),
            *every(st.LookFacts, summary=tuple(_looked()), images=ON, searched=ON, accepted=ON, moved=ON),
        ],
        st.placement_says: every(
            st.PlacementFacts,
            scene=SCENES,
            taken=ON,
            flawed=ON,
            work=WORKS,
            connected=ON,
            as_before=ON,
            to_go=(None, ToGo(10.0, 3.0, near=True), FAR),
            enough=ON,
            recorded=ON,
        )
        + every(st.PlacementFacts, taken=ON, work=WORKS, spare=ON, moved=ON, undo=ON, movable=ON, to_go=(None, FAR)),
        st.bar_says: bars,
        st.verify_says: every(
            st.VerifyFacts,
            bar=tuple(bars),
            outcome=(None, ("PASS", "good"), ("FAIL", "bad")),
            measuring=ON,
            current=ON,
            taken=ON,
            outdated=ON,
            empty=ON,
        ),
        st.calibrate_says: every(
            st.CalibrateFacts,
            status=tuple(Status),
            reason=("A reason.",),
            error=ON,
            verdict=("", *VERDICTS),
            run=("", "running", "stopping", "keeping"),
            busy=ON,
            taken=(2, 4),
            planned=(4,),
            left=("9 s",),
        ),
        st.results_says: every(
            st.ResultFacts,
            verdict=(None, ("VALID", "good", True), ("NOT VALID", "bad", False)),
            stale=ON,
            accepted=ON,
            running=("", "calibrate", "save"),
            stopped=ON,
        ),
        st.save_says: every(
            st.SaveFacts,
            status=tuple(Status),
            calibration=VERDICTS,
            verified=ON,
            undecided=ON,
            kept=ON,
            stale=ON,
            apply=ON,
            why_not=("", "Not verified."),
            report=ON,
            running=("", "save", "verify"),
            stopping=ON,
        ),
        st.check_says: every(
            st.CheckFacts,
            status=tuple(Status),
            verdict=(None, ("OK", "good"), ("WATCH", "caution")),
            reason=("Why.",),  # a step that is blocked, stale or failed has one
            well=ON,
            running=("", "check", "save"),
            repaired=ON,
        )
        + every(st.CheckFacts, status=(Status.READY, Status.DONE), well=ON),
        st.measure_says: every(
            st.MeasureFacts, trust=(("", "none"), ("Agree.", "good")), measuring=ON, recorded=(None, 0, 9)
        ),
    }


def all_facts() -> dict[Any, list]:
    """Every input of every step in the language in use, by the function that says what it is."""
    return _facts(languages.now())
