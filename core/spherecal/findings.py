"""Findings: what a result says about itself, in plain words."""

from dataclasses import dataclass, field
from typing import Literal

Severity = Literal["info", "warning", "error"]


def counted(number: int, noun: str, plural: str | None = None) -> str:
    """`1 camera`, `2 cameras`; `plural` where it is not the noun with an s."""
    return f"{number} {noun}" if number == 1 else f"{number} {plural or noun + 's'}"


@dataclass(frozen=True)
class Finding:
    """One statement about a result: code for programs, message, cause and remedy for people.

    `where` holds the ids concerned (cameras, placements, bars); `values` a number for each of them, where the engine
    goes on with it (files do not have them).
    """

    severity: Severity
    code: str
    message: str
    hint: str
    where: tuple[str, ...] = ()
    values: tuple[float, ...] = field(default=(), compare=False)
