"""A question that a working thread asks somebody at the window, and waits for the answer."""

import threading

from spherecal.base.context import Context

_LOOK_S = 0.1


class DriverQuestion:
    """Whether a driver file may be loaded: which one, the hash of its contents, whether it was another one before."""

    def __init__(self, file: str, sha256: str, changed: bool) -> None:
        self.file, self.sha256, self.changed = file, sha256, changed
        self._answered = threading.Event()
        self._answer = False

    def answer(self, yes: bool) -> None:
        """Say yes or no; the first answer counts."""
        if not self._answered.is_set():
            self._answer = yes
            self._answered.set()

    def wait(self, context: Context) -> bool:
        """The answer; Cancelled where the work is to stop."""
        while not self._answered.wait(_LOOK_S):
            context.check()
        return self._answer
