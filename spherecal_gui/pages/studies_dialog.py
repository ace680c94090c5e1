"""Compare methods: the studies of the paper, run here on simulated rigs, each a page to read."""

from pathlib import Path

from PySide6.QtCore import Qt, QTimer, QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QDialog, QHBoxLayout, QProgressBar, QVBoxLayout, QWidget

from spherecal.base.context import Context
from spherecal_gui import languages
from spherecal_gui.tasks.task import Runner
from spherecal_gui.texts import error_text
from spherecal_gui.widgets.basic import button, enable, label, set_level
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
        self._rows: dict[str, tuple[QWidget, QWidget]] = {}
        for name, study in STUDIES.items():
            row = QHBoxLayout()
            row.addWidget(label(study.TITLE), 1)
            run, read = button(self.tr("Run"), f"run-{name}"), button(self.tr("Read"), f"read-{name}")
            for one, act in ((run, self._run), (read, self._read)):
                one.setProperty("study", name)
                one.clicked.connect(act)
                row.addWidget(one)
            self._rows[name] = (run, read)
            column.addLayout(row)
        self.bar = QProgressBar()
        self.bar.setRange(0, 1000)
        self.bar.setTextVisible(False)
        column.addWidget(self.bar)
        self.doing = label("", "soft")
        column.addWidget(self.doing)
        last = QHBoxLayout()
        self.cancel = button(self.tr("Cancel"), "cancel-study", act=self.runner.cancel)
        last.addStretch(1)
        last.addWidget(self.cancel)
        column.addLayout(last)
        self._timer = QTimer(self)
        self._timer.setInterval(_TICK_MS)
        self._timer.timeout.connect(self._tick)
        self._timer.start()
        self.setWindowFlag(Qt.WindowType.WindowContextHelpButtonHint, False)
        self._refresh()

    def _refresh(self) -> None:
        running = self.runner.running
        for name, (run, read) in self._rows.items():
            enable(run, running is None, self.tr("Work is running."))  # type: ignore[arg-type]
            enable(read, (self._folder / f"{name}.pdf").is_file(), self.tr("It was not run yet."))  # type: ignore[arg-type]
        self.cancel.setEnabled(running is not None)
        self.bar.setVisible(running is not None)

    def _run(self) -> None:
        sender = self.sender()
        if sender is None:
            return
        name = str(sender.property("study"))
        self.runner.start(
            name, lambda context: run_one(name, self._folder, context), self._done, self._failed, self._stopped
        )
        self._refresh()

    def _done(self, page: Path) -> None:
        self.doing.setText(self.tr("The page is {path}.").format(path=page))
        set_level(self.doing, "good")
        self._refresh()

    def _failed(self, error: BaseException) -> None:
        self.doing.setText(" ".join(error_text(error)).strip())
        set_level(self.doing, "bad")
        self._refresh()

    def _stopped(self) -> None:
        self.doing.setText(self.tr("Stopped; what was computed is kept."))
        set_level(self.doing, "none")
        self._refresh()

    def _tick(self) -> None:
        task = self.runner.task
        if task is None:
            return
        news = task.take_news()
        if news:
            self.bar.setValue(int(1000 * news[-1].fraction))
            self.doing.setText(f"{news[-1].stage} {news[-1].words(languages.now())}".strip())

    def _read(self) -> None:
        sender = self.sender()
        if sender is not None:
            page = self._folder / f"{sender.property('study')}.pdf"
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(page)))

    def close_work(self) -> bool:
        """Stop what runs and wait for it; whether it has ended."""
        self._timer.stop()
        return self.runner.close(_PATIENCE_MS)


def run_one(name: str, folder: Path, context: Context) -> Path:
    """Run one study as `spherecal study NAME -o FOLDER --workers 0` does; the file of its page."""
    asked = Options(STUDIES[name].RUNS, 0.04, 1)
    return run_study(name, asked, folder, workers_for(0, None), context)
