"""Where the ball goes next: the engine's advice from the dots at hand, in words and as a picture."""

import os
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from spherecal.base.context import Context
from spherecal.base.errors import Cancelled
from spherecal_files.session_json import session_json
from spherecal_gui import coverage as cov
from spherecal_gui.presenters.placement_presenter import next_text, now_text
from spherecal_gui.rig_scenes import GuidanceView
from spherecal_gui.tasks.placement_advice import plan_next, printed_scale, session_of_dots
from tests.networks import one_thread, simulated

__all__ = ["one_thread"]


@pytest.fixture(scope="module")
def demo():
    """The demo's session as json, its targets, and the dots of its placements by camera."""
    session, _ = simulated("demo", 1)
    o = session.observations
    assert o is not None
    sizes = [camera.image_size for camera in session.cameras]
    dots = {}
    for p, placement in enumerate(session.placements):
        rows = {name: (o.placement == p) & (o.camera == c) for c, name in enumerate(o.cameras)}
        dots[placement.id] = {
            name: cov.Dots(o.target[r], o.point[r], o.uv[r], sizes[c]) for c, (name, r) in enumerate(rows.items())
        }
    return session_json(session, session.folder), session.target_set, dots


def first(dots, count):
    return {name: dots[name] for name in list(dots)[:count]}


def test_every_placement_is_said_to_help_and_stopping_gets_better(demo):
    document, targets, dots = demo
    told: list[Any] = [plan_next(document, targets, first(dots, count), Context()) for count in (1, 2, 3)]
    assert all(one is not None for one in told)
    assert told[0].now_mm > told[1].now_mm > told[2].now_mm > told[2].next_mm > 0.01
    names = [one.name for one in told[2].scene.scene.placements]
    assert names == ["P1", "P2", "P3"], "every place of the ball"
    assert 100 < told[1].ghost.body.radius_mm < 400, "a bar gives the scale later; until then the printed targets do"
    assert now_text(told[0]) == ("If you stop now: not determined yet", "bad")
    assert now_text(told[1])[0] == f"If you stop now: 500 ± {told[1].now_mm:.3f} mm"


def test_the_session_behind_it_is_that_of_the_images(demo):
    document, targets, dots = demo
    session = session_of_dots(document, targets, first(dots, 2))
    real, _ = simulated("demo", 1)
    assert session.observations is not None and real.observations is not None
    assert len(session.observations) == int((real.observations.placement < 2).sum())
    np.testing.assert_allclose(session.cameras[2].prior, real.cameras[2].prior)
    assert session.scale is not None and session.scale.kind == "target_spacing"


def test_cancelling_is_heard(demo):
    document, targets, dots = demo
    with pytest.raises(Cancelled):
        plan_next(document, targets, first(dots, 2), Context(is_cancelled=lambda: True))


def test_the_printed_scale_is_a_distance_that_all_targets_share(demo):
    _, targets, _ = demo
    scale = printed_scale(targets)
    assert scale is not None
    for layout in targets.layouts.values():
        assert np.linalg.norm(layout[scale["from"]] - layout[scale["to"]]) == pytest.approx(scale["distance_mm"])


BASE = GuidanceView(0.2, 0.1)


def test_the_forecast_turns_green_when_more_would_not_help():
    assert now_text(BASE) == ("If you stop now: 500 ± 0.200 mm", "caution")
    assert now_text(replace(BASE, next_mm=0.19))[1] == "good"
    assert now_text(replace(BASE, next_mm=None))[1] == "none", "green under the order to move the ball"
    assert next_text(BASE) == "With this placement: 500 ± 0.100 mm"
    assert next_text(replace(BASE, next_mm=None)) == ""
