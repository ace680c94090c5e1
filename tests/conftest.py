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


@pytest.fixture(scope="session", autouse=True)
def _nothing_of_the_user(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Allowed drivers, reference bars, cameras' settings: of the tests' own, never those of whoever runs them."""
    folder = tmp_path_factory.mktemp("user")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(folder / "config"))
        patch.setenv("SPHERECAL_DRIVERS", str(folder / "drivers.json"))
        patch.setenv("SPHERECAL_BARS", str(folder / "bars.json"))
        patch.setenv("SPHERECAL_LIMITS", str(folder / "limits.json"))
        patch.setenv("SPHERECAL_SETTINGS", str(folder / "settings.ini"))
        yield


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for a wizard's projects, its settings, and a scene that needs no OpenGL."""
    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    monkeypatch.setenv("SPHERECAL_3D", "2d")
    return tmp_path


@pytest.fixture(autouse=True)
def _no_lost_exceptions(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail the test when a thread or a Qt slot raises: neither reaches the test by itself."""
    lost: list[BaseException | None] = []
    monkeypatch.setattr(sys, "excepthook", lambda _kind, value, _traceback: lost.append(value))
    monkeypatch.setattr(threading, "excepthook", lambda args: lost.append(args.exc_value))
    yield
    if lost:
        pytest.fail("lost in a thread or slot: " + "; ".join(map(repr, lost)))


def pytest_assertrepr_compare(op: str, left: object, right: object) -> list[str] | None:
    """Long bytes by where they first differ: pytest's own comparison of two files of 300 kB takes an hour."""
    if op != "==" or not isinstance(left, bytes) or not isinstance(right, bytes) or len(left) + len(right) < 2000:
        return None
    at = next(
        (k for k, pair in enumerate(zip(left, right, strict=False)) if pair[0] != pair[1]), min(len(left), len(right))
    )
    around = slice(max(0, at - 60), at + 60)
    return [
        f"{len(left)} and {len(right)} bytes that differ from byte {at} on", f"{left[around]!r}", f"{right[around]!r}",
    ]  # fmt: skip
