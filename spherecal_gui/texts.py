"""Words for what the workflow says by code; all that people read passes through Qt's translation."""

from typing import TYPE_CHECKING

from spherecal.base.errors import OutputError, SpherecalError, reason
from spherecal.base.messages.values import Phrase
from spherecal_gui import languages
from spherecal_gui.languages import translate, word
from spherecal_gui.workflow import Reason, Status, Step, StepKind

if TYPE_CHECKING:  # the window is shown before cameras are loaded
    from spherecal_cameras.protocol import CameraStatus

Cell = str | float | int | None  # what a table sorts by


def step_title(step: Step) -> str:
    """The step's name on the rail."""
    return word("steps", step.kind, name=(step.set_id or "").removeprefix("P"))


def status_word(status: Status, kind: StepKind | None = None) -> str:
    """The state in a word; of a placement that is not there yet that it is not. `kind` None: of any step."""
    return word("statuses", "not captured" if status is Status.READY and kind in ("placement", "scale") else status)


def reason_text(reason: Reason | None) -> str:
    """Why a step is blocked, stale or failed: one plain sentence."""
    if reason is None:
        return ""
    values = tuple(word("inputs", value, value) for value in reason.values)
    return word("reasons", reason.code, names=values, first=values[:1], others=values[1:])


def moved_text(cameras: tuple[str, ...], here: bool = True) -> str:
    """That cameras were moved, and what to do; `here`: the page has the button."""
    return word("reasons", "moved" if here else "moved elsewhere", names=cameras)


def camera_trouble(status: "CameraStatus") -> str:
    """What is wrong with a camera and what to do, by its state; the engine's own words are `camera_details`."""
    return word("states", status.state.value, camera_details(status))


def camera_details(status: "CameraStatus") -> str:
    """The engine's own words on a camera, which are English."""
    return f"{status.state.value}. {status.cause} {status.remedy}".strip()


def verdict_word(verdict: str) -> str:
    """A verdict of the engine, for people."""
    return word("verdicts", verdict, verdict)


def error_text(error: BaseException) -> tuple[str, str]:
    """What happened and what to do, for people; bugs say that they are ours."""
    if isinstance(error, SpherecalError):
        return error.words(languages.now())
    if isinstance(error, OSError) and error.strerror:
        file = error.filename or Phrase("error-the-disk")
        what = Phrase("error-cannot-write", {"file": file, "why": reason(error)})
        return OutputError(what, Phrase("error-free-disk-again")).words(languages.now())
    what = translate("Errors", "Something went wrong inside the program ({kind}: {text}).")
    hint = translate("Errors", "What was recorded is safe. Try again; if it happens again, send the log to us.")
    return what.format(kind=type(error).__name__, text=error), hint


def error_line(error: BaseException) -> str:
    """What happened and what to do in one line, in the interface's language as far as the error is one of ours."""
    return " ".join(error.words(languages.now())).strip() if isinstance(error, SpherecalError) else str(error)


def figure(value: float | None, digits: int, level: str = "") -> tuple[str, Cell, str]:
    """The cell of a number in a table; a dash, sorted as the largest, where there is none."""
    return ("-", float("inf"), level) if value is None else (f"{value:.{digits}f}", value, level)
