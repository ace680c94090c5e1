"""The ghost of the ball: where it is drawn, how far the ball is from it, how the advice ends."""

import os
from dataclasses import replace

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from benchmarks.studies.ghost import errors, recorded_dots, seen_dots
from spherecal.base.context import Context
from spherecal.geometry.camera import image_reach, project
from spherecal.geometry.rotation import exp_rotation
from spherecal_files.session_json import session_json
from spherecal_gui.coverage import Dots, same_place
from spherecal_gui.presenters.placement_presenter import Scene, is_enough, need_text, now_text
from spherecal_gui.presenters.step_states import PlacementFacts, move_text, placement_says
from spherecal_gui.tasks.ghost import Lenses, ToGo, drawn, drawn_bar, lying_ball, outline, thinned, to_go
from spherecal_gui.tasks.placement_advice import plan_coarse, plan_next
from spherecal_gui.widgets.tile import CameraTile
from spherecal_sim.simulate_session import simulate_session


@pytest.fixture(scope="module")
def demo():
    session, truth = simulate_session("demo", 1)
    return session, truth, recorded_dots(session), session_json(session, session.folder)


@pytest.fixture(scope="module")
def told(demo):
    """The coarse and the full answer after one placement, and the full one after two."""
    session, _, dots, document = demo
    one, two = {"P1": dots["P1"]}, {name: dots[name] for name in ("P1", "P2")}
    return (
        plan_coarse(document, session.target_set, one, Context()),
        plan_next(document, session.target_set, one, Context()),
        plan_next(document, session.target_set, two, Context()),
    )


def test_the_ghost_is_where_the_ball_then_stands(demo, told):
    """Measured: 14, 2.4 and 0.5 px at a ball of 190 px; a rig of 12 cameras 10, 0.7 and 0.1 px."""
    _, truth, _, _ = demo
    for found, last, most_px, most_mm in zip(told, (0, 0, 1), (25.0, 8.0, 2.0), (25.0, 6.0, 1.5), strict=True):
        middle, worst, mm, _ = errors(found.ghost, truth, last, np.random.default_rng(1))
        assert middle <= worst < most_px and mm < most_mm
    assert told[0].coarse and not told[1].coarse
    assert now_text(told[0])[1] == "none", "nothing is predicted yet"


def test_what_is_left_to_go_is_what_the_ball_was_moved_by(demo, told):
    _, truth, _, _ = demo
    ghost = told[2].ghost
    rng = np.random.default_rng(3)
    rotation, place = truth.ball_rotations[1], truth.ball_places_mm[1]
    here = lying_ball(ghost.lenses, ghost.body, seen_dots(truth, rotation, place, rng))
    assert here is not None and np.linalg.norm(here.centre - ghost.body.centre) < 0.5
    there = replace(ghost, centre=here.centre, turn=here.turn)
    assert here.turn is not None
    assert to_go(there, here).near and to_go(there, here).away_mm == 0.0
    moved = place + np.array([60.0, 0.0, 0.0])
    turned = exp_rotation(np.deg2rad([0.0, 0.0, 20.0])) @ rotation
    now = lying_ball(ghost.lenses, ghost.body, seen_dots(truth, turned, moved, rng))
    assert now is not None
    left = to_go(there, now)
    assert left.away_mm == pytest.approx(60.0, abs=1.0) and left.turn_deg == pytest.approx(20.0, abs=0.3)
    assert not left.near
    assert left.level_mm**2 + left.up_mm**2 == pytest.approx(60.0**2, rel=0.05) and left.towards in ghost.lenses.names
    assert "20°" in move_text(left), "by how much it is still to be turned"


def test_a_ball_that_shows_its_other_side_is_found_by_its_size(demo, told):
    _, _, dots, _ = demo
    ghost = told[1].ghost
    other = {name: Dots(one.target + 10_000, one.point, one.uv, one.image_size) for name, one in dots["P1"].items()}
    found = lying_ball(ghost.lenses, ghost.body, other)
    assert found is not None and found.turn is None
    assert np.linalg.norm(found.centre - ghost.body.centre) < 2.0
    assert "°" not in move_text(to_go(ghost, found))
    assert lying_ball(ghost.lenses, ghost.body, {}) is None
    alone = {"C01": dots["P1"]["C01"]}
    assert lying_ball(ghost.lenses, ghost.body, alone) is None, "one camera does not tell where"


def test_misread_dots_do_not_move_the_ball(demo, told):
    _, _, dots, _ = demo
    ghost, rng = told[1].ghost, np.random.default_rng(5)
    spoilt = {}
    for name, one in dots["P1"].items():
        wrong = rng.random(len(one)) < 0.1
        uv = one.uv + wrong[:, None] * rng.uniform(-40, 40, (len(one), 2))
        spoilt[name] = Dots(one.target, one.point, uv, one.image_size)
    found = lying_ball(ghost.lenses, ghost.body, spoilt)
    assert found is not None and np.linalg.norm(found.centre - ghost.body.centre) < 1.0


def test_an_outline_touches_the_ball_and_never_folds_into_the_image(told):
    lenses = told[1].ghost.lenses
    for c in range(len(lenses.names)):
        middle = lenses.rotation[c].T @ (np.array([20.0, -30.0, 900.0]) - lenses.translation[c])
        ring = outline(lenses, c, middle, 100.0)
        inside = project(np.array([[20.0, -30.0, 900.0]]), lenses.intrinsics[c])[0]
        assert len(ring) == 72 and (ring.min(axis=0) < inside).all() and (inside < ring.max(axis=0)).all()
        reach = float(image_reach(lenses.intrinsics[c : c + 1], lenses.size[c : c + 1])[0])
        far = lenses.rotation[c].T @ (np.array([5 * reach * 900, 0.0, 900.0]) - lenses.translation[c])
        assert not len(outline(lenses, c, far, 100.0)), "beyond what the lens model knows"
        behind = lenses.rotation[c].T @ (np.array([0.0, 0.0, -900.0]) - lenses.translation[c])
        assert not len(outline(lenses, c, behind, 100.0))


def test_the_ghost_is_drawn_into_the_image(qtbot, told):
    ghost = told[1].ghost
    tile = CameraTile("S1", "C01")
    qtbot.addWidget(tile)
    tile.resize(640, 520)
    size = ghost.lenses.size[0].astype(int)
    tile.show_image(np.full((size[1], size[0]), 30, np.uint8), 8, 1.0)
    before = tile.grab().toImage()
    tile.show_ghost(drawn(ghost, None)["C01"], near=False)
    with_ghost = tile.grab().toImage()
    assert with_ghost != before
    tile.show_ghost(drawn(ghost, None)["C01"], near=True)
    assert tile.grab().toImage() != with_ghost, "green once it is there"
    tile.show_ghost(None, near=False)
    assert tile.grab().toImage() == before


def test_a_bars_ghost_is_its_line(told):
    lenses = told[1].ghost.lenses
    ends = np.stack([told[1].ghost.centre, told[1].ghost.centre + np.array([50.0, 0, 0])])
    found = drawn_bar(lenses, ends, None)
    assert found["C01"].wanted.shape == (2, 2) and not len(found["C01"].lying)


def test_the_advice_says_enough_and_names_no_move_worth_less_than_a_tenth(told):
    good = replace(told[2], now_mm=0.100, next_mm=0.095)
    assert is_enough(good, planned_taken=True) and not is_enough(good, planned_taken=False)
    better = replace(told[2], now_mm=0.100, next_mm=0.080)
    assert not is_enough(better, planned_taken=True)
    assert not is_enough(told[0], planned_taken=True), "nothing is predicted yet"


def test_a_ball_that_was_not_moved_is_not_ready(demo):
    _, _, dots, _ = demo
    assert same_place(dots["P1"], dots["P1"])
    assert not same_place(dots["P1"], dots["P2"])
    assert not same_place(dots["P1"], {})
    one_moved = {**dots["P1"], "C01": dots["P2"]["C01"]}
    assert same_place(dots["P1"], one_moved), "one camera was knocked: that is told elsewhere"
    facts = PlacementFacts(Scene({"A": 300, "B": 300}, True), as_before=True)
    assert "Move the ball" in placement_says(facts).text


def test_the_headline_says_what_the_ghost_says():
    """Green and ready beside half a metre to go were two advices at once."""
    facts = PlacementFacts(Scene({"C01": 100, "C02": 100}, True), to_go=ToGo(500.0, None, False, 500.0, 0.0, "C02"))
    assert placement_says(facts).level == "none" and "500 mm towards C02" in placement_says(facts).text
    assert placement_says(replace(facts, to_go=None)).level == "good"
    assert placement_says(replace(facts, taken=True)).level == "good", "what is captured is captured"


def test_thinned_dots_are_the_same_in_all_cameras(demo):
    _, _, dots, _ = demo
    few = thinned(dots["P1"], 80)
    kept = [set(zip(one.target.tolist(), one.point.tolist(), strict=True)) for one in few.values()]
    everything = [set(zip(one.target.tolist(), one.point.tolist(), strict=True)) for one in dots["P1"].values()]
    for mine, own in zip(kept, everything, strict=True):
        assert 20 < len(mine) < 130 and mine <= own
        assert all((dot in mine) == (dot in other) for other in [set().union(*kept)] for dot in own)
    assert thinned(dots["P1"], 100_000) is dots["P1"]


def test_what_a_camera_needs_is_said():
    cells = np.ones((10, 10), int)
    cells[:, :3] = 0
    assert need_text("spread", cells) == "no dots on the left"
    assert need_text("more", cells) == "needs more dots"
    cells[5, 1] = 1
    assert need_text("spread", cells) == "few dots on the left"


def test_lenses_are_those_of_the_rig(told):
    assert len(told[1].ghost.lenses.names) == 6
    assert isinstance(told[1].ghost.lenses, Lenses) and isinstance(to_go(told[1].ghost, _there(told[1].ghost)), ToGo)


def _there(ghost):
    from spherecal_gui.tasks.ghost import Lying

    return Lying(ghost.centre, ghost.turn)
