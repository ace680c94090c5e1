"""Findings: what a result says about itself, in plain words."""

from dataclasses import dataclass
from typing import Literal

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Finding:
    """One statement about a result: code for programs, message, cause and remedy for people.

    `where` holds the ids concerned (cameras, placements, bars).
    """

    severity: Severity
    code: str
    message: str
    hint: str
    where: tuple[str, ...] = ()
