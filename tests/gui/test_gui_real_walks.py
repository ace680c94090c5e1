"""The whole walk of the training in a real window: by keys alone, and with what the window captures by itself."""

import os
import shutil
import sys
from pathlib import Path

import pytest

from installer.walk import walk
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

if not sys.platform.startswith("linux"):
    pytest.skip("real keys need X11", allow_module_level=True)
for name in ("Xvfb", "xdotool"):
    if shutil.which(name) is None:
        pytest.skip(f"{name} is not installed (Debian: apt-get install xvfb xdotool)", allow_module_level=True)
pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

if not os.environ.get("SPHERECAL_REAL_WALKS"):
    pytest.skip("five minutes of real keys and clicks: set SPHERECAL_REAL_WALKS=1", allow_module_level=True)

MOST_CLICKS = 20


@pytest.fixture
def program(monkeypatch) -> list[str]:
    """The window as the source has it; a walk starts it with hardly any environment."""
    monkeypatch.setenv("SPHERECAL_KERNELS", "")
    path = os.pathsep.join([str(ROOT / "core"), str(ROOT)])
    return ["/usr/bin/env", f"PYTHONPATH={path}", "OPENBLAS_NUM_THREADS=1", sys.executable, "-m", "spherecal_gui"]


def test_from_the_start_page_to_the_report_by_the_keyboard_alone(program: list[str], tmp_path: Path) -> None:
    """Space for all that is the page's own, Tab and Enter for the rest; the mouse is never moved."""
    assert walk(program, tmp_path, keys=True).pressed > MOST_CLICKS, "the walk was made by these keys"


def test_with_capture_by_itself_twenty_clicks_are_enough(program: list[str], tmp_path: Path) -> None:
    assert walk(program, tmp_path, by_itself=True).pressed <= MOST_CLICKS
