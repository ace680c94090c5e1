"""Compare methods: the studies of the paper, run here on simulated rigs, each a page to read."""

from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, QTimer, QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QDialog, QHBoxLayout, QProgressBar, QPushButton, QVBoxLayout, QWidget

from spherecal.base.context import Context
from spherecal_gui import languages
from spherecal_gui.languages import error_line
from spherecal_gui.tasks.task import Runner
from spherecal_gui.widgets.basic import add, button, enable, label, say
from spherecal_study.executor import workers_for
from spherecal_study.studies import STUDIES, run_study
from spherecal_study.study_page import Options

_TICK_MS = 200
_PATIENCE_MS = 20_000


class StudiesDialog(QDialog):
    """One row for each study: run it, read it."""

    def __init__(self, folder: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._folder = folder
        self.setWindowTitle(self.tr("Compare methods"))
        self.runner = Runner(self)
        column = QVBoxLayout(self)
        message = self.tr(
            "Each study repeats an experiment of the paper on simulated rigs; it takes minutes. Stopped ones go on."
        )
        column.addWidget(label(message, "soft"))
        self._rows: dict[str, tuple[QPushButton, QPushButton]] = {}
        for name, study in STUDIES.items():
            run = button(self.tr("Run"), f"run-{name}", act=partial(self._run, name))
            read = button(self.tr("Read"), f"read-{name}", act=partial(self._read, name))
            self._rows[name] = (run, read)
            column.addLayout(add(QHBoxLayout(), (label(study.TITLE), 1), run, read))
        self.bar = QProgressBar(maximum=1000, textVisible=False)
        self.doing = label("", "soft")
        self.cancel = button(self.tr("Cancel"), "cancel-study", act=self.runner.cancel)
        add(column, self.bar, self.doing, add(QHBoxLayout(), None, self.cancel))
        self._timer = QTimer(self, interval=_TICK_MS)
        self._timer.timeout.connect(self._tick)
        self._timer.start()
        self.setWindowFlag(Qt.WindowType.WindowContextHelpButtonHint, False)
        self._refresh()

    def _refresh(self) -> None:
        running = self.runner.running
        for name, (run, read) in self._rows.items():
            enable(run, running is None, self.tr("Work is running."))
            enable(read, (self._folder / f"{name}.pdf").is_file(), self.tr("It was not run yet."))
        self.cancel.setEnabled(running is not None)
        self.bar.setVisible(running is not None)

    def _run(self, name: str, _: bool = False) -> None:
        self.runner.start(
            name, lambda context: run_one(name, self._folder, context), self._done, self._failed, self._stopped
        )
        self._refresh()

    def _done(self, page: Path) -> None:
        self._say(self.tr("The page is {path}.").format(path=page), "good")

    def _failed(self, error: BaseException) -> None:
        self._say(error_line(error), "bad")

    def _stopped(self) -> None:
        self._say(self.tr("Stopped; what was computed is kept."), "none")

    def _say(self, text: str, level: str) -> None:
        say(self.doing, text, level, hides=False)
        self._refresh()

    def _tick(self) -> None:
        task = self.runner.task
        if task is None:
            return
        news = task.take_news()
        if news:
            self.bar.setValue(int(1000 * news[-1].fraction))
            self.doing.setText(f"{news[-1].stage} {news[-1].words(languages.now())}".strip())

    def _read(self, name: str, _: bool = False) -> None:
        QDesktopServices.openUrl(QUrl.fromLocalFile(str(self._folder / f"{name}.pdf")))

    def close_work(self) -> bool:
        """Stop what runs and wait for it; whether it has ended."""
        self._timer.stop()
        return self.runner.close(_PATIENCE_MS)


def run_one(name: str, folder: Path, context: Context) -> Path:
    """Run one study as `spherecal study NAME -o FOLDER --workers 0` does; the file of its page."""
    return run_study(name, Options(STUDIES[name].RUNS, 0.04, 1), folder, workers_for(0, None), context)
