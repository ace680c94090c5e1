"""Errors, typed by what the user can do about them."""


class SpherecalError(Exception):
    """Base of all errors meant for the user: a plain message and what to do about it."""

    exit_code = 2

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.message} {self.hint}".strip()


class InputError(SpherecalError):
    """A file, folder or option that cannot be used as it is; the message names it."""


class OutputError(SpherecalError):
    """A result that cannot be written where it was asked for."""


class MissingPackage(SpherecalError, ImportError):
    """A function needs a package that is not installed."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message, hint)


class StoppedHere(SpherecalError):
    """The user wants what there is so far; raised only where a partial result is held (`Context.holding`)."""

    def __init__(self, message: str = "Stopped.", hint: str = "") -> None:
        super().__init__(message, hint)


class Cancelled(SpherecalError):
    """The user stopped the work; nothing half-done is left behind."""

    exit_code = 130

    def __init__(self, message: str = "Cancelled.", hint: str = "") -> None:
        super().__init__(message, hint)
