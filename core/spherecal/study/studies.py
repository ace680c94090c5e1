"""All studies by name, and how one is run: trials, results, page, figures as JSON."""

from pathlib import Path
from types import ModuleType

from spherecal.context import Context
from spherecal.report.style import report_style
from spherecal.session.atomic import write_file_whole
from spherecal.session.rig_file import json_bytes
from spherecal.study import cameras, compare, layouts, noise, path, rig_b
from spherecal.study.executor import Workers, run_trials
from spherecal.study.page import Options

STUDIES: dict[str, ModuleType] = {
    "layouts": layouts, "path": path, "noise": noise, "cameras": cameras, "compare": compare, "rigB": rig_b,
}  # fmt: skip


def run_study(name: str, options: Options, folder: Path, workers: Workers, context: Context) -> Path:
    """Run a study and write `NAME.pdf` and `NAME.json` (all results) into the folder; the page's path.

    Results of trials are kept in `trials` and taken from there if the study is run again.
    """
    study = STUDIES[name]
    listed = study.trials(options)
    results = run_trials(listed, folder / "trials", workers, context)
    context.report("drawing the page", 0.0)
    figures = [
        {"kind": t.kind, "settings": dict(t.settings), "result": r} for t, r in zip(listed, results, strict=True)
    ]  # fmt: skip
    with report_style():
        page = study.page(listed, results, options).pdf()
    write_file_whole(folder / f"{name}.json", json_bytes({"study": name, "trials": figures}))
    write_file_whole(folder / f"{name}.pdf", page)
    return folder / f"{name}.pdf"
