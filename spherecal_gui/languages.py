"""The languages of the window: Qt's translations of ours and of Qt's own words."""

from PySide6.QtCore import QCoreApplication, QLibraryInfo, QLocale, QTranslator

from spherecal.base.messages.catalogue import LANGUAGES
from spherecal.base.resources import resource_path

_installed: list[QTranslator] = []
_spoken = ["en"]


def now() -> str:
    """The language in use."""
    return _spoken[0]


def preferred() -> str:
    """The system's language where we speak it, else English."""
    name = QLocale.system().name()
    return next((code for code in LANGUAGES if name == code or name.split("_")[0] == code.split("_")[0]), "en")


def use(language: str) -> str:
    """Speak this language from now on (English where it is not known); widgets that exist keep their words."""
    application = QCoreApplication.instance()
    assert application is not None
    for translator in _installed:
        application.removeTranslator(translator)
    _installed.clear()
    _spoken[0] = language if language in LANGUAGES else "en"
    # numbers stay as they are in files and certificates: with a point
    QLocale.setDefault(QLocale(QLocale.Language.English, QLocale.Country.UnitedStates))
    if now() != "en":
        qt = QLibraryInfo.path(QLibraryInfo.LibraryPath.TranslationsPath)
        for name, folder in ((f"spherecal_{now()}", str(resource_path("translations"))), (f"qtbase_{now()}", qt)):
            translator = QTranslator(application)
            if translator.load(name, folder):
                application.installTranslator(translator)
                _installed.append(translator)
    return now()
