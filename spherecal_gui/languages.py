"""The languages of the window; words for what the workflow says by code, for errors and for cells of tables."""

import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from PySide6.QtCore import QCoreApplication, QLibraryInfo, QLocale, QTranslator

from spherecal.base.errors import OutputError, SpherecalError, reason
from spherecal.base.messages.catalogue import LANGUAGES, fill, table
from spherecal.base.messages.values import Phrase, plain
from spherecal.base.resources import resource_path
from spherecal_gui.workflow import Reason, Status, Step, StepKind

if TYPE_CHECKING:
    from spherecal_cameras.protocol import CameraStatus


translate = QCoreApplication.translate  # (context, text): texts that belong to no widget

_LOCALES = {
    "en": (QLocale.Language.English, QLocale.Country.UnitedStates),
    "de": (QLocale.Language.German, QLocale.Country.Germany),
    "zh_CN": (QLocale.Language.Chinese, QLocale.Country.China),
}
_WITH_COMMA = ("de",)
_DECIMAL = re.compile(r"(?<![\w.,:/+-])([+-]?\d+)\.(\d+)(?![\w:/+]|\.\d)")
_IN_A_ROW = re.compile(r"(,\d+), (?=[+-]?\d+,\d)")
_UNITS = (
    "mm/s mm µm m ppm px pixels Pixeln Pixel 像素 % °C ° K degrees Grad 度 "
    "ms s min h 毫秒 秒 分钟 小时 Hz fps dB MP kB MB GB Mbit/s"
)
_BEFORE_UNIT = re.compile(
    rf"(?<=\d) (?=(?:{'|'.join(_UNITS.split())})(?![A-Za-zÄÖÜäöüß-]))|(?<=±) (?=\d)|(?<=\d) (?=±)"
)
_RATE = re.compile(r"\b(mm|Mbit)/s\b")
_installed: list[QTranslator] = []
_spoken = ["en"]


def now() -> str:
    """The language in use."""
    return _spoken[0]


def preferred() -> str:
    """The system's language where we speak it, else English."""
    name = QLocale.system().name()
    return next((code for code in LANGUAGES if name == code or name.split("_")[0] == code.split("_")[0]), "en")


def word(group: str, code: str, otherwise: str | None = None, **values: object) -> str:
    """What people read for a code: of the table `words.GROUP` of resources/messages; `otherwise` where it is new."""
    words = table(now())["words"][group]
    return otherwise if otherwise is not None and code not in words else fill(words[code], plain(values), now())


def by_locale(text: str) -> str:
    """A text with its decimal numbers as the language writes them, for the screen alone; not names such as `P1.5`."""
    if now() not in _WITH_COMMA:
        return text
    return _IN_A_ROW.sub(r"\1; ", _DECIMAL.sub(r"\1,\2", text))


def listed(names: Iterable[str]) -> str:
    """Names in a row within a sentence, parted as the language does it."""
    return ("、" if now() == "zh_CN" else ", ").join(names)  # as the catalogue of messages has it


def some(names: Sequence[str], most: int) -> str:
    """The first names in a row, and that there are more."""
    return listed(names[:most]) + (" …" if len(names) > most else "")


def unbroken(text: str) -> str:
    """A text for several lines: no-break spaces and word joiners keep numbers and units together."""
    return _RATE.sub("\\1/\u2060s", _BEFORE_UNIT.sub("\u00a0", text))


def use(language: str) -> str:
    """Speak this language from now on (English where it is not known); widgets that exist keep their words."""
    application = QCoreApplication.instance()
    assert application is not None
    for translator in _installed:
        application.removeTranslator(translator)
    _installed.clear()
    _spoken[0] = language if language in LANGUAGES else "en"
    made = QLocale(*_LOCALES[now()])
    made.setNumberOptions(QLocale.NumberOption.OmitGroupSeparator | QLocale.NumberOption.RejectGroupSeparator)
    QLocale.setDefault(made)
    if now() != "en":
        qt = QLibraryInfo.path(QLibraryInfo.LibraryPath.TranslationsPath)
        for name, folder in ((f"spherecal_{now()}", str(resource_path("translations"))), (f"qtbase_{now()}", qt)):
            translator = QTranslator(application)
            if translator.load(name, folder):
                application.installTranslator(translator)
                _installed.append(translator)
    return now()


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
        return error.words(now())
    if isinstance(error, OSError) and error.strerror:
        file = error.filename or Phrase("error-the-disk")
        what = Phrase("error-cannot-write", {"file": file, "why": reason(error)})
        return OutputError(what, Phrase("error-free-disk-again")).words(now())
    what = translate("Errors", "Something went wrong inside the program ({kind}: {text}).")
    hint = translate("Errors", "What was recorded is safe. Try again; if it happens again, send the log to us.")
    return what.format(kind=type(error).__name__, text=error), hint


def error_line(error: BaseException) -> str:
    """What happened and what to do in one line, in the interface's language as far as the error is one of ours."""
    return " ".join(error.words(now())).strip() if isinstance(error, SpherecalError) else str(error)


def figure(value: float | None, digits: int, level: str = "") -> tuple[str, Cell, str]:
    """The cell of a number in a table; a dash, sorted as the largest, where there is none."""
    return ("-", float("inf"), level) if value is None else (f"{value:.{digits}f}", value, level)
