"""Cameras that still get warmer are told at Look, coarse and noisy sensors' steps and jitter are not."""

import os
import time
from typing import Any

import numpy as np
import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from spherecal_gui.presenters.look_presenter import warm_up_text
from spherecal_gui.tasks.live_detection import WarmUp
from spherecal_gui.wizard.window import WizardWindow
from tests.gui_walking import pump, settle


def fed(celsius: np.ndarray, every_s: float = 5.0) -> WarmUp:
    watch = WarmUp()
    for number, value in enumerate(celsius):
        watch.feed("S1", number * every_s, float(value))
    return watch


def heating(k_per_min: float, minutes: float, resolution: float) -> np.ndarray:
    at = np.arange(0.0, 60 * minutes, 5.0)
    return 30 + np.round(k_per_min * at / 60 / resolution) * resolution


@pytest.mark.parametrize("resolution", [0.0625, 0.1, 0.5])
def test_a_camera_just_switched_on_is_told(resolution: float) -> None:
    rate = fed(heating(0.8, 4, resolution)).rate_k_per_min("S1")
    assert rate is not None and 0.4 < rate <= 0.85
    assert fed(-heating(0.8, 4, resolution)).rate_k_per_min("S1") == pytest.approx(-rate)


@pytest.mark.parametrize("resolution", [0.0625, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("k_per_min", [0.0, 0.05])
def test_a_warm_camera_is_not(k_per_min: float, resolution: float) -> None:
    values = heating(k_per_min, 10, resolution)
    for end in range(13, len(values)):
        assert not fed(values[:end]).unsteady()


@pytest.mark.parametrize(("jitter", "digits"), [(0.05, 1), (0.3, 3)])
def test_a_jittering_sensor_is_not(jitter: float, digits: int) -> None:
    values = 41.0 + np.round(np.random.default_rng(1).normal(0, jitter, 200), digits)
    for end in range(13, len(values)):
        assert not fed(values[:end]).unsteady()


def test_nothing_is_said_too_soon_or_without_a_sensor() -> None:
    assert fed(heating(3.0, 0.9, 0.1)).rate_k_per_min("S1") is None
    watch = WarmUp()
    for number in range(100):
        watch.feed("S1", 5.0 * number, None)
    assert watch.rate_k_per_min("S1") is None and watch.unsteady() == {}


def test_only_the_last_minutes_count() -> None:
    values = np.concatenate([heating(1.0, 3, 0.1), np.full(50, 33.0)])
    assert not fed(values).unsteady()


def test_it_stands_below_the_sentence(qtbot, home):
    window: Any = WizardWindow(home / "projects")
    qtbot.addWidget(window)
    window.show()
    window.new_project("simulated:demo")
    settle(window.controller)
    window.controller.recording.confirm_bench()
    window.controller.go("look")
    pump(lambda: window.controller.cameras.live is not None)
    page, live = window.page, window.controller.cameras.live
    page.tick()
    assert not page.warm_up.isVisible()
    serial = next(s for s, name in window.controller.cameras.connection.names.items() if name == "C02")
    start = time.perf_counter() + 1000.0  # later than what the live images say meanwhile: that is left out
    for number, value in enumerate(heating(0.8, 4, 0.1)):
        live.warm_up.feed(serial, start + 5.0 * number, float(value))
    page.tick()
    assert page.warm_up.isVisible() and "C02 +0.8" in page.warm_up.text()
    assert page.warm_up.text() == warm_up_text({"C02": live.warm_up.rate_k_per_min(serial)})
    window.close()
