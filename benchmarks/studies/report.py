"""A study's report: figures, goals met or missed, and what they were computed with, as a Markdown page."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

_PACKAGES = ("spherecal", "numpy", "scipy", "numba", "opencv-python-headless")


@dataclass
class Report:
    """Collects a page; `verdicts` holds (goal, met) for whoever wants to test them."""

    title: str
    command: str
    _body: list[str] = field(default_factory=list)
    verdicts: list[tuple[str, bool]] = field(default_factory=list)

    def text(self, *lines: str) -> None:
        """A paragraph."""
        self._body += [*lines, ""]

    def heading(self, title: str) -> None:
        """A section."""
        self._body += [f"## {title}", ""]

    def table(self, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """A table; floats in four figures."""
        self._body.append("| " + " | ".join(header) + " |")
        self._body.append("|" + "---|" * len(header))
        self._body += ["| " + " | ".join(figure(cell) for cell in row) + " |" for row in rows]
        self._body.append("")

    def verdict(self, goal: str, met: bool, value: str) -> None:
        """One goal, whether it was met, and by what figure."""
        self.verdicts.append((goal, met))
        self._body += [f"- {'**met**' if met else '**MISSED**'}: {goal}: {value}"]

    def page(self) -> str:
        """The whole page."""
        packages = ", ".join(f"{name} {version(name)}" for name in _PACKAGES)
        made = f"`{self.command}`; Python {platform.python_version()}, {packages}."
        return "\n".join([f"# {self.title}", "", made, "", *self._body]).rstrip() + "\n"

    def write(self, folder: Path, name: str) -> Path:
        """Write NAME.md."""
        path = folder / f"{name}.md"
        path.write_text(self.page(), encoding="utf-8")
        return path


def figure(value: object) -> str:
    """A number as the tables show it."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
