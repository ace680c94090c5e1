"""Findings: what a result says about itself, as codes with values; `spherecal.base.messages` has the words."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from spherecal.base.messages.catalogue import Part, fill, template
from spherecal.base.messages.values import plain

Severity = Literal["info", "warning", "error"]
RepairKind = Literal["leave-out", "split", "swap"]


def counted(number: int, noun: str, plural: str | None = None) -> str:
    """A number and its noun: `1 camera`, `2 cameras`; `plural` where it is not formed with an s."""
    return f"{number} {noun}" if number == 1 else f"{number} {plural or noun + 's'}"


@dataclass(frozen=True)
class AdvisedRepair:
    """A repair of the session that a finding advises: an option of `calibrate` and its value, such as `C05@P3`."""

    kind: RepairKind
    target: str

    @property
    def option(self) -> str:
        """As it is typed on the command line."""
        return f"--{self.kind} {self.target}"


def leave_out(*targets: str) -> tuple[AdvisedRepair, ...]:
    """That these be left out, each as `C05@P3`, `camera:C05` or `placement:P3`."""
    return tuple(AdvisedRepair("leave-out", target) for target in targets)


@dataclass(frozen=True, eq=False)
class Finding:
    """One statement about a result: a code, and the numbers and names that go with it.

    `where`: ids concerned (cameras, placements, bars); `repairs`: what the session could be repaired by; `kind`: which
    of the code's messages it is. `written`: message and hint of a file whose values are not known. Two findings are
    equal where they say the same.
    """

    code: str
    severity: Severity
    values: Mapping[str, Any] = field(default_factory=dict)
    where: tuple[str, ...] = ()
    repairs: tuple[AdvisedRepair, ...] = ()
    kind: str = ""
    written: tuple[str, str] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", plain(self.values))

    def __repr__(self) -> str:
        return f"<Finding {self.code} ({self.severity}): {self.message}>"

    @property
    def message(self) -> str:
        """What was found, in English, as files have it."""
        return self.words("message", "en")

    @property
    def hint(self) -> str:
        """What to do about it, in English, as files have it."""
        return self.words("hint", "en")

    def words(self, part: Part, language: str, *, with_options: bool = True) -> str:
        """Title, message or hint in a language.

        A finding that was read without its values keeps its message and hint as they were written.

        Parameters
        ----------
        part
            Which of the three.
        language
            A language of the catalogue.
        with_options
            Whether a hint's text in brackets, about the options of its repairs, is kept. Without repairs it never is.
        """
        if self.written is not None and part != "title":
            return self.written[0 if part == "message" else 1]
        words = template(self.code, self.kind, part, language)
        if words is None:
            return self.code.replace("-", " ") if part == "title" else ""
        values = {**self.values, "where": self.where, "repairs": " ".join(repair.option for repair in self.repairs)}
        return fill(words, values, language, with_options=with_options and bool(self.repairs))

    def _key(self) -> tuple[object, ...]:
        return self.severity, self.code, self.message, self.hint, self.where

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Finding) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())


Findings = tuple[Finding, ...]
