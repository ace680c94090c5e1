"""docs/command-line.md: the tests that it names exist; what no other test holds of it."""

import io
import re

import pytest
from conftest import ROOT
from rich.console import Console

PAGE = ROOT / "docs" / "command-line.md"


def test_every_test_that_the_page_names_exists() -> None:
    named = re.findall(r"`(test_\w+\.py)::(test_\w+)`", PAGE.read_text(encoding="utf-8"))
    assert len(named) > 20
    for file, name in named:
        assert f"def {name}(" in next((ROOT / "tests").rglob(file)).read_text(encoding="utf-8"), f"{file}::{name}"


@pytest.mark.parametrize(("variable", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_no_colour_where_none_is_wanted(monkeypatch: pytest.MonkeyPatch, variable: str, value: str) -> None:
    """On a terminal; our console is one of rich's, made with the same settings."""

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")

    def printed() -> str:
        from spherecal_app.cli.console import out

        stream = Terminal()
        type(out)(file=stream, highlight=False, soft_wrap=True).print("[green]VALID[/]")
        return stream.getvalue()

    assert isinstance(Console(), Console) and "\x1b[32m" in printed()
    monkeypatch.setenv(variable, value)
    assert "\x1b[32m" not in printed()
