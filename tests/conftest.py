"""What all tests share: the real data, and the rule that no exception may get lost."""

import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest

ROOT = Path(__file__).resolve().parents[1]

hypothesis.settings.register_profile("spherecal", deadline=None, derandomize=bool(os.environ.get("CI")))
hypothesis.settings.load_profile("spherecal")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real recordings: SPHERECAL_DATA, else ../shared/data beside the repository."""
    named = os.environ.get("SPHERECAL_DATA")
    folder = Path(named) if named else ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder} (set SPHERECAL_DATA to its folder)")
    return folder


@pytest.fixture(autouse=True)
def _no_lost_exceptions(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail the test when a thread or a Qt slot raises: neither reaches the test by itself."""
    lost: list[BaseException | None] = []
    monkeypatch.setattr(sys, "excepthook", lambda _kind, value, _traceback: lost.append(value))
    monkeypatch.setattr(threading, "excepthook", lambda args: lost.append(args.exc_value))
    yield
    if lost:
        pytest.fail("lost in a thread or slot: " + "; ".join(map(repr, lost)))
