"""The bench editor: typing, undo, import, saving, the library, what the wizard makes of it; certificates."""

import json
import os
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QMessageBox, QPushButton

from spherecal.data.session import BarLength, Certificate, Mark
from spherecal.targets.family import make_target_set
from spherecal_cameras.plan import read_plan
from spherecal_files.bar_registry import BAR_REGISTRY, RegisteredBar
from spherecal_gui.controllers.bench_desk import BenchDesk
from spherecal_gui.pages.bench_dialog import BenchDialog
from spherecal_gui.presenters.bars_presenter import bench_reminder, reminder, state_words
from spherecal_gui.presenters.bench_presenter import (
    BarDraft,
    BenchDraft,
    LengthDraft,
    bar_draft,
    number_of,
    read_bar,
    read_bench,
)
from spherecal_gui.presenters.connect_presenter import bench_rows
from spherecal_gui.project import Project
from spherecal_gui.project_folder import rig_bench
from spherecal_gui.tasks import jobs
from spherecal_rigs.ball_registry import BALL_REGISTRY

TODAY = date(2026, 11, 23)


@pytest.fixture(autouse=True)
def library(tmp_path, monkeypatch):
    monkeypatch.setenv("SPHERECAL_BARS", str(tmp_path / "library" / "bars.json"))
    monkeypatch.setenv("SPHERECAL_BALLS", str(tmp_path / "library" / "balls.json"))
    return tmp_path / "library"


def registered(serial="B-1", first=201, certificate=None, length=500.012):
    marks = {"A1": Mark(first, "centre"), "A2": Mark(first + 1, "E")}
    lengths = (BarLength("A1", "A2", length, 0.004, 2.0, round(length)),)
    return RegisteredBar(serial, marks, lengths, 1.15e-5, 20.0, "steel", certificate)


@pytest.fixture
def dialog(qtbot, tmp_path):
    made = BenchDialog(BenchDesk(tmp_path / "projects"))
    qtbot.addWidget(made)
    made.show()
    return made


def key(dialog, name):
    return next(one for one in dialog.findChildren(QPushButton) if one.property("key") == name)


def press(qtbot, dialog, name):
    QTest.mouseClick(key(dialog, name), Qt.MouseButton.LeftButton)


def typed(line, text):
    line.setFocus()
    line.selectAll()
    QTest.keyClicks(line, text)


def fill(qtbot, dialog, serial="B-7", role="check"):
    """A ball and a bar as somebody enters them."""
    for name, text in (("name", "Ball hall 3"), ("diameter", "500")):
        typed(dialog.ball.fields[name].line, text)
    dialog.tabs.setCurrentIndex(1)
    press(qtbot, dialog, "add-bar")
    typed(dialog.bars.fields["serial"].line, serial)
    for name, text in (
        ("from_sticker", "201"),
        ("to_sticker", "202"),
        ("certified", "500,012"),
        ("uncertainty", "0.004"),
        ("factor", "2"),
    ):
        typed(dialog.bars._rows[0][name], text)
    dialog.bars.role.setCurrentIndex(dialog.bars.role.findData(role))
    dialog.bars.role.activated.emit(0)


# --- what is typed ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("500.012", 500.012),
        ("500,012", 500.012),
        (" 1 000 ", 1000.0),
        ("1e-3", 0.001),
        ("x", None),
        ("", None),
        ("nan", None),
    ],
)
def test_numbers_as_people_type_them(text, value):
    assert number_of(text) == value


def test_a_bar_comes_back_as_it_was():
    bar = registered(certificate=Certificate("K", "lab", date(2025, 1, 2), date(2027, 1, 2)))
    bare = RegisteredBar(
        "B-2",
        bar.marks,
        (replace(bar.lengths[0], nominal_mm=None),),
        1.15e-5,
        assumed=("expansion_per_kelvin", "reference_temperature_c"),
    )
    for one in (bar, bare):
        assert read_bar(bar_draft(one)) == (one, {})


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        ({"serial": ""}, "serial", "empty"),
        ({"serial": "B/1"}, "serial", "slash"),
        ({"expansion": "hot"}, "expansion", "Must be a number"),
        ({"expansion": "11500"}, "expansion", "from"),
        ({"reference": "500"}, "reference", "from -50"),
        ({"issued": "21.11.2026"}, "issued", "date"),
        ({"valid_until": "2020-01-01"}, "valid_until", "before"),
        ({"certificate": "", "laboratory": "lab"}, "certificate", "number is missing"),
        ({"lengths": ()}, "lengths", "At least one"),
        ({"certified": ""}, "length.0.certified", "certificate"),
        ({"certified": "-5"}, "length.0.certified", "above 0"),
        ({"nominal": "412"}, "length.0.nominal", "1 %"),
        ({"uncertainty": "40"}, "length.0.uncertainty", "5 % of the length"),
        ({"factor": "0.2"}, "length.0.factor", "from 1"),
        ({"from_sticker": "twenty"}, "length.0.from_sticker", "number printed"),
        ({"to_sticker": "201"}, "length.0.to_mark", "same mark"),
        ({"to_mark": "A1"}, "length.0.to_sticker", "different sticker"),
    ],
)
def test_what_is_wrong_is_said_at_its_field_in_plain_words(change, field, words):
    draft = bar_draft(registered(certificate=Certificate("K", "lab", date(2025, 1, 2), date(2027, 1, 2))))
    of_length = {name: text for name, text in change.items() if hasattr(draft.lengths[0], name)}
    if of_length:
        if "to_sticker" in of_length:
            of_length["to_sticker"] = "201:centre"
        draft = replace(draft, lengths=(replace(draft.lengths[0], **of_length),))
    else:
        draft = replace(draft, **change)
    bar, problems = read_bar(draft)
    assert bar is None and words in problems[field] and problems[field].endswith(".")


def test_bars_must_fit_each_other_and_the_ball():
    one, other = bar_draft(registered(), "scale"), bar_draft(registered("B-2", 202), "scale")
    ball = replace(BenchDraft().ball, name="b", diameter="500", last="150")
    _, _, problems = read_bench(BenchDraft(ball, (one, other)))
    assert "none of the ball's target set" in problems["bar.0.role"]
    _, _, problems = read_bench(BenchDraft(replace(ball, last="208"), (one, other)))
    assert set(problems) == {"bar.1.role"} and "B-1" in problems["bar.1.role"]
    _, _, problems = read_bench(BenchDraft(replace(ball, last="208"), (one, replace(other, role="check"))))
    assert "Sticker 202 is on bar B-1 as well" in problems["bar.1.role"]
    _, _, problems = read_bench(BenchDraft(replace(ball, last="208"), (one, replace(other, role="none", serial="B-1"))))
    assert "Another bar" in problems["bar.1.serial"]


# --- the window ------------------------------------------------------------------------------------------------------


def test_a_bench_is_entered_saved_and_used(qtbot, dialog, tmp_path, library):
    saved = []
    dialog.saved.connect(saved.append)
    assert not dialog.save.isEnabled()
    fill(qtbot, dialog)
    assert dialog.save.isEnabled(), dialog.desk.judge()[1]
    QTest.keyClick(dialog.bars.fields["serial"].line, Qt.Key.Key_S, Qt.KeyboardModifier.ControlModifier)
    assert saved == [str(rig_bench(tmp_path / "projects"))]
    assert BAR_REGISTRY.read()["B-7"].lengths[0].length_mm == 500.012 and "Ball hall 3" in BALL_REGISTRY.read()
    plan = read_plan(Path(saved[0]))
    assert [bar.role for bar in plan.bars] == ["check"] and plan.target_set == make_target_set(208)
    nothing: Any = SimpleNamespace()
    connected = jobs._plan(nothing, Project(tmp_path / "p", "genicam", saved[0]))
    assert connected.fields["bars"][0]["lengths"][0]["length_mm"] == 500.012, "a project keeps its figures"
    connection: Any = SimpleNamespace(plan=connected)
    assert [row.value for row in bench_rows(connection, None)][1] == "500 mm"
    assert not dialog.desk.changed and dialog.close_button.text() == "Close"


def test_letters_are_one_step_back_and_forth(qtbot, dialog):
    fill(qtbot, dialog)
    serial = dialog.bars.fields["serial"].line
    typed(serial, "B-99")
    assert dialog.desk.draft.bars[0].serial == "B-99"
    QTest.keyClick(serial, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert (dialog.desk.draft.bars[0].serial, serial.text()) == ("B-7", "B-7")
    press(qtbot, dialog, "redo-bench")
    assert serial.text() == "B-99"
    while dialog.desk.past:
        dialog.desk.undo()
    assert dialog.desk.draft == BenchDraft()


def test_what_is_wrong_shows_while_typing_and_nothing_is_saved(qtbot, dialog, library):
    fill(qtbot, dialog)
    typed(dialog.bars._rows[0]["uncertainty"], "99")
    assert "5 % of the length" in dialog.bars._row_problems[0].text() and not dialog.save.isEnabled()
    assert dialog.tabs.tabText(1).endswith("✕") and "1" in dialog.summary.text()
    assert not dialog.save_bench() and not library.exists()
    typed(dialog.ball.fields["diameter"].line, "big")
    assert "Must be a number" in dialog.ball.fields["diameter"].problem.text()


def test_closing_asks_before_anything_is_lost(qtbot, dialog):
    fill(qtbot, dialog)
    QTest.keyClick(dialog, Qt.Key.Key_Escape)
    (box,) = dialog.findChildren(QMessageBox)
    assert dialog.isVisible()
    press(qtbot, box, "ask-stay")
    assert dialog.isVisible() and dialog.desk.draft.bars
    press(qtbot, dialog, "close-bench")
    box = [one for one in dialog.findChildren(QMessageBox) if one.isVisible()][-1]
    press(qtbot, box, "ask-save")
    assert not dialog.isVisible() and "B-7" in BAR_REGISTRY.read()


def test_a_table_comes_in_with_its_bad_lines_named(qtbot, dialog, tmp_path):
    BAR_REGISTRY.write({"B-1": registered()})
    desk = BenchDesk(tmp_path / "projects")
    made = BenchDialog(desk)
    qtbot.addWidget(made)
    table = tmp_path / "bars.csv"
    table.write_text(
        "serial,from_target,to_target,length [mm],uncertainty [mm]\nB-1,201,202,500.5,0.004\nB-2,203,204,400,0.004\n"
        "B-3,205,206,x,0.004\n"
    )
    made.bars.import_table(table)
    assert "Line 4" in made.message.text() and "B-1" in made.message.text()
    assert [one.serial for one in desk.draft.bars] == ["B-1", "B-2"]
    assert BAR_REGISTRY.read()["B-1"] == registered(), "nothing is on disk before it is saved"
    desk.undo()
    assert desk.draft.bars[0].lengths[0].certified == "500.012"
    desk.redo()
    assert made.save_bench() and BAR_REGISTRY.read()["B-1"].lengths[0].length_mm == 500.5
    assert desk.export_table(tmp_path / "out.csv") == "" and "B-2" in (tmp_path / "out.csv").read_text()
    (tmp_path / "broken.csv").write_bytes(b"PK\x03\x04")
    made.bars.import_table(tmp_path / "broken.csv")
    assert "save it as CSV" in made.message.text() and len(desk.draft.bars) == 2


def test_another_program_changes_the_library_meanwhile(tmp_path):
    BAR_REGISTRY.write({"B-1": registered(), "B-2": registered("B-2", 203)})
    desk = BenchDesk(tmp_path / "projects")
    BAR_REGISTRY.write(
        {"B-1": registered(), "B-2": registered("B-2", 203, length=400.0), "B-3": registered("B-3", 205)}
    )
    bars = desk.draft.bars
    desk.change("", replace(desk.draft, bars=(replace(bars[0], description="mine"), bars[1])))
    path, problem = desk.save()
    assert path is None and problem == "" and set(BAR_REGISTRY.read()) == {"B-1", "B-2", "B-3"}
    assert BAR_REGISTRY.read()["B-1"].description == "mine" and BAR_REGISTRY.read()["B-2"].lengths[0].length_mm == 400.0
    assert desk.draft.bars[1].lengths[0].certified == "400" and not desk.changed
    desk.change(
        "", replace(desk.draft, bars=(replace(desk.draft.bars[0], description="mine too"), *desk.draft.bars[1:]))
    )
    assert desk.save()[1] == "" and BAR_REGISTRY.read()["B-2"].lengths[0].length_mm == 400.0
    desk = BenchDesk(tmp_path / "projects")
    BAR_REGISTRY.write({**BAR_REGISTRY.read(), "B-1": replace(registered(), description="theirs")})
    desk.change("", replace(desk.draft, bars=(replace(desk.draft.bars[0], description="again"), *desk.draft.bars[1:])))
    assert "another program" in desk.save()[1] and BAR_REGISTRY.read()["B-1"].description == "theirs"


def test_a_broken_library_is_named_and_never_overwritten(qtbot, tmp_path, library):
    library.mkdir()
    (library / "bars.json").write_text("{")
    made = BenchDialog(BenchDesk(tmp_path / "projects"))
    qtbot.addWidget(made)
    assert "bars.json" in made.message.text()
    fill(qtbot, made)
    assert not made.save_bench() and (library / "bars.json").read_text() == "{"


def test_a_bar_that_is_renamed_or_removed_leaves_no_double(tmp_path):
    BAR_REGISTRY.write({"B-1": registered(), "B-2": registered("B-2", 203)})
    desk = BenchDesk(tmp_path / "projects")
    desk.change("", replace(desk.draft, bars=(replace(desk.draft.bars[0], serial="B-10"), desk.draft.bars[1])))
    desk.remove_bar(1)
    assert desk.save()[1] == "" and list(BAR_REGISTRY.read()) == ["B-10"]


def test_a_handwritten_bench_is_taken_up_with_its_bars_and_their_ids(tmp_path):
    bench = rig_bench(tmp_path)
    bench.parent.mkdir()
    from spherecal_files.target_set_file import write_target_set

    write_target_set(bench.parent / "targets.json", make_target_set(208))
    length = {"from": "A1", "to": "A2", "length_mm": 412.345, "expanded_uncertainty_mm": 0.004}
    marks = {"A1": {"target": 201, "point": "centre"}, "A2": {"target": 202, "point": "centre"}}
    document = {
        "format": "spherecal/session", "version": 1, "target_set": "targets.json",
        "sphere": {"nominal_diameter_mm": 300},
        "bars": [{"id": "A", "role": "check", "marks": marks, "lengths": [length]}],
        "placements": [{"id": "P1"}, {"id": "P2"}, {"id": "P3"}],
        "scale": {"kind": "target_spacing", "from": "A", "to": "E", "distance_mm": 28.2, "surface": "sphere"},
    }  # fmt: skip
    bench.write_text(json.dumps(document))
    desk = BenchDesk(tmp_path)
    ball, (bar,) = desk.draft.ball, desk.draft.bars
    assert (ball.diameter, ball.measured, ball.last, desk.draft.placements) == ("300", "28.2", "208", "3")
    assert (bar.serial, bar.id, bar.role, bar.lengths[0].certified) == ("A", "A", "check", "412.345")
    path, problem = desk.save()
    assert problem == "" and path is not None and [one.id for one in read_plan(path).bars] == ["A"]


def test_targets_of_another_family_come_from_a_file(qtbot, dialog, tmp_path):
    from spherecal_files.target_set_file import make_marker_set, write_target_set

    write_target_set(tmp_path / "markers.json", make_marker_set("DICT_4X4_50", 30.0, None, "dark-on-light"))
    dialog.ball.take_targets(tmp_path / "markers.json")
    assert dialog.desk.draft.ball.own is not None and not dialog.ball.fields["first"].line.isEnabled()
    fill(qtbot, dialog)
    assert "is none of the ball's target set" in dialog.bars.role_problem.text()
    dialog.desk.undo()
    press(qtbot, dialog, "targets-number")
    assert dialog.ball.fields["first"].line.isEnabled()
    (tmp_path / "x.json").write_text("{}")
    dialog.ball.take_targets(tmp_path / "x.json")
    assert "x.json" in dialog.ball.own.text()


def test_the_print_is_judged_while_it_is_typed(dialog):
    for text, words in (("28.3", "this is as usual"), ("28.0", "print at 100 %"), ("", "28.28 mm as designed")):
        line = dialog.ball.fields["measured"].line
        typed(line, text) if text else (line.clear(), line.textEdited.emit(""))
        assert words in dialog.ball.print_said.text()
    typed(dialog.ball.fields["measured"].line, "20")
    assert "28.28 mm apart as designed" in dialog.ball.fields["measured"].problem.text()


def test_one_more_length_and_one_less(qtbot, dialog):
    fill(qtbot, dialog)
    press(qtbot, dialog, "add-length")
    assert len(dialog.bars._rows) == 2 and dialog.desk.draft.bars[0].lengths[1] == LengthDraft("A1", "201", factor="2")
    press(qtbot, dialog, "remove-length-0")
    assert len(dialog.desk.draft.bars[0].lengths) == 1 and dialog.desk.draft.bars[0].lengths[0].to_mark == ""


# --- reminders -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("days", "level", "words"), [(-1, "bad", "expired"), (10, "caution", "expires on"), (400, "good", "valid until")]
)
def test_a_certificate_is_remembered(days, level, words):
    certificate = Certificate("K", "", date(2020, 1, 1), TODAY + timedelta(days))
    text, found = state_words(certificate, TODAY)
    assert (found, words in text) == (level, True)
    told, worst = reminder([registered(certificate=certificate)], TODAY)
    assert (worst if told else "good") == level
    assert ("B-1" in told) == (level != "good")


def test_the_rigs_bench_is_reminded_of_its_own_bars_only(tmp_path):
    old = Certificate("K", "", date(2020, 1, 1), date(2021, 1, 1))
    BAR_REGISTRY.write({"B-1": registered(certificate=old), "B-2": registered("B-2", 203)})
    assert "B-1" in bench_reminder(rig_bench(tmp_path), TODAY)[0], "no bench yet: all bars of the library"
    desk = BenchDesk(tmp_path)
    ball = replace(desk.draft.ball, name="b", diameter="500")
    bars = (desk.draft.bars[0], replace(desk.draft.bars[1], role="check"))
    desk.change("", replace(desk.draft, ball=ball, bars=bars))
    assert desk.save()[1] == "" and bench_reminder(rig_bench(tmp_path), TODAY)[0] == ""
    (rig_bench(tmp_path)).write_text("{")
    assert bench_reminder(rig_bench(tmp_path), TODAY)[0] == "", "the start page comes up all the same"
    assert BarDraft().role == "none"
