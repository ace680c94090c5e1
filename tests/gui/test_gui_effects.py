"""Fields of lenses and drifts of cameras in Results: read from a result as it is written, and drawn."""

import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from pytestqt.qtbot import QtBot

from spherecal.data.rig import ImageMotion
from spherecal.geometry.field_table import FieldTable
from spherecal_files.write_result import MOTION_COLUMNS, MOTIONS_FILE, _motion_row, write_table
from spherecal_gui.presenters.results_presenter import drift_text, field_text
from spherecal_gui.tasks.outcome import MOTIONS, effects_of
from spherecal_gui.widgets.results_views import EffectsView


def rig(field: FieldTable | None) -> SimpleNamespace:
    """Two cameras, the second with a field."""
    camera = SimpleNamespace(
        id="C01", field=None, image_size=(1280, 1024), intrinsics=np.array([1000.0, 1000.0, 640.0, 512.0])
    )
    other = SimpleNamespace(**{**vars(camera), "id": "C02", "field": field})
    return SimpleNamespace(cameras=(camera, other))


def bowl() -> FieldTable:
    """0.1 px at its corner, 0 in the middle."""
    v, u = np.mgrid[-1:1:9j, -1:1:11j]
    return FieldTable(128.0, np.zeros(2), 0.1 * u / np.sqrt(2), 0.1 * v / np.sqrt(2))


def test_maps_and_lines_are_of_the_result(tmp_path: Path, qtbot: QtBot) -> None:
    """A turn of 1 mrad about x moves the image by a thousandth of the focal length."""
    assert MOTIONS == MOTIONS_FILE
    turns = [("P1", "C01", 0.0), ("P1", "C02", 0.0), ("P2", "C01", 0.1), ("P2", "C02", 1.0)]
    rows = [ImageMotion(p, c, np.array([np.rad2deg(1e-3 * mrad), 0, 0]), np.zeros(3)) for p, c, mrad in turns]
    write_table(tmp_path / MOTIONS, MOTION_COLUMNS, map(_motion_row, rows))
    effects = effects_of(rig(bowl()), tmp_path)  # type: ignore[arg-type]
    assert effects[0].field_px is None and effects[1].field_px is not None
    assert effects[1].field_px.max() == pytest.approx(0.1)
    assert effects[1].drift_px == pytest.approx([0.0, 1.0], abs=1e-4)
    assert effects[0].drift_px == pytest.approx([0.0, 0.1], abs=1e-4)
    assert "C02" in field_text(effects)
    assert drift_text(effects).startswith("C02 turned most over the placements: 1.00 px")
    view = EffectsView()
    qtbot.addWidget(view)
    view.resize(500, 500)
    view.show_effects(effects)
    view.show()
    drawn = view.maps.grab().toImage()
    colours = {drawn.pixel(x, y) for x in range(0, drawn.width(), 4) for y in range(0, drawn.height(), 4)}
    assert len(colours) > 5, "the field is a map, not one colour"


def test_there_is_nothing_to_show_of_a_result_without_them(tmp_path: Path, qtbot: QtBot) -> None:
    effects = effects_of(rig(None), tmp_path)  # type: ignore[arg-type]
    assert effects == ()
    view = EffectsView()
    qtbot.addWidget(view)
    view.show_effects(effects)
    assert not view.maps.isVisible() and not view.field.text()
    only = effects_of(rig(bowl()), tmp_path)  # type: ignore[arg-type]
    assert drift_text(only) == "No camera turned over the placements."
    assert field_text(tuple(replace(one, field_px=None) for one in only)) == "Every lens does what its model says."
