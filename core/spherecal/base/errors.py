"""Errors, typed by what the user can do about them."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager

from spherecal.base.messages.catalogue import hint_of, phrase
from spherecal.base.messages.values import Phrase

Words = str | Phrase
_REASONS = {errno.ENOSPC: "no-space", errno.EACCES: "no-permission"}


def reason(error: OSError) -> Words:
    """Why the system refuses: a phrase for what people meet most often, else the system's own words."""
    known = _REASONS.get(error.errno or 0)
    return (error.strerror or str(error)).lower() if known is None else Phrase(known)


def _said(words: Words, language: str) -> str:
    if not isinstance(words, Phrase):
        return words
    try:
        return phrase(words, language)
    except OSError:  # no more files can be opened, say: the error must not be lost with its words
        return f"{words.key} {dict(words.values)}"


def advice(message: Words) -> Words:
    """The hint that the catalogue has beside a message, with the same values; empty where it has none."""
    if not isinstance(message, Phrase):
        return ""
    try:
        return hint_of(message) or ""
    except OSError:
        return ""


class SpherecalError(Exception):
    """Base of all errors meant for the user: what happened, and what to do about it.

    Parameters
    ----------
    message
        What happened: a phrase, or text, which is the same in every language.
    hint
        What to do about it. Empty: the phrase `KEY-hint` of the catalogue beside the message, if there is one.
    """

    exit_code = 2

    def __init__(self, message: Words, hint: Words = "") -> None:
        self.parts = message, hint or advice(message)
        self.message, self.hint = self.words("en")
        super().__init__(self.message)

    @property
    def code(self) -> str:
        """What happened, as the catalogue names it; empty for text."""
        message = self.parts[0]
        return message.key if isinstance(message, Phrase) else ""

    def words(self, language: str) -> tuple[str, str]:
        """Message and hint in a language, as far as they are phrases."""
        message, hint = self.parts
        return _said(message, language), _said(hint, language)

    def __str__(self) -> str:
        return f"{self.message} {self.hint}".strip()


class InputError(SpherecalError):
    """A file, folder or option that cannot be used as it is; the message names it."""


class OutputError(SpherecalError):
    """A result that cannot be written where it was asked for."""


class MissingPackage(SpherecalError, ImportError):
    """A function needs a package that is not installed."""


@contextmanager
def needing(package: str, what: Words) -> Iterator[None]:
    """A block that imports an optional package."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != package:
            raise
        raise MissingPackage(Phrase("error-needs-package", {"what": what, "package": package})) from None


class PartialResultAccepted(SpherecalError):
    """The user wants what there is so far; raised only where a partial result is held (`Context.accepting_partial`)."""

    def __init__(self, message: str = "Stopped.", hint: str = "") -> None:
        super().__init__(message, hint)


class Cancelled(SpherecalError):
    """The user stopped the work; nothing half-done is left behind."""

    exit_code = 130

    def __init__(self, message: str = "Cancelled.", hint: str = "") -> None:
        super().__init__(message, hint)
