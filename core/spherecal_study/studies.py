"""All studies by name, and how one is run: trials, results, page, pictures, figures as JSON, and the index of all."""

from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import Any

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.filesystem import remove_below
from spherecal.files.atomic import write_file_whole
from spherecal.files.json_file import json_bytes
from spherecal_documents.report.style import report_style
from spherecal_study import camera_count as cameras
from spherecal_study import compare_methods as compare
from spherecal_study import layouts, noise, rig_b, wand
from spherecal_study import path_study as path
from spherecal_study.executor import Trial, Workers, kept_result, run_trials
from spherecal_study.paper import write_paper
from spherecal_study.rendered import renderings
from spherecal_study.study_page import Options, Results, StudyPage

STUDIES: dict[str, ModuleType] = {
    "layouts": layouts, "path": path, "noise": noise, "cameras": cameras, "compare": compare, "rigB": rig_b,
    "bar": wand,
}  # fmt: skip
_DPI = 130  # of the pictures of pages: small print can be read


def run_study(
    name: str, options: Options, folder: Path, workers: Workers, context: Context, kept_only: bool = False
) -> Path:
    """Run a study and write its page (see `write_page`) and the index of all pages into the folder; the page's path."""
    _check(name, options)
    study = STUDIES[name]
    listed = study.trials(options)
    if kept_only:
        listed, results = _kept(name, listed, folder / "trials")
    else:
        run_trials(renderings(listed), folder / "trials", workers, context)
        results = run_trials(listed, folder / "trials", workers, context)
    context.report("drawing the page", 0.0)
    with report_style():
        page: StudyPage = study.page(listed, results, options)
        return write_page(name, study.TITLE, page, asdict(options), listed, results, folder)


def _kept(name: str, listed: list[Trial], folder: Path) -> tuple[list[Trial], Results]:
    """The trials whose results are kept, with these."""
    both = [(trial, result) for trial in listed if (result := kept_result(folder, trial)) is not None]
    if not both:
        raise InputError(f"{folder}: holds no results of the study {name}.", "Run it without --kept.")
    return [trial for trial, _ in both], [result for _, result in both]


def _check(name: str, options: Options) -> None:
    if name == "bar" and options.images:
        raise InputError(
            "The study of the waved bar needs thousands of frames, which are not rendered.",
            "Leave out --images; `compare --images` has a rendered bar of forty frames.",
        )
    if name == "rigB" and options.preset:
        raise InputError("The study rigB compares rigs A and B.", "Leave out --rig.")


def write_page(
    name: str, title: str, page: StudyPage, options: dict[str, Any], listed: list[Trial], results: Results, folder: Path
) -> Path:
    """Write a study's page as PDF, pictures and JSON, and `paper.md`, within `report_style`; the PDF's path."""
    figures = [
        {"kind": t.kind, "settings": dict(t.settings), "result": r} for t, r in zip(listed, results, strict=True)
    ]
    for old in folder.glob(f"{name}-*.png"):
        remove_below(folder, old.name)
    pictures = []
    write_file_whole(folder / f"{name}.pdf", page.document.pdf())
    for number, picture in enumerate(page.document.pictures(_DPI), 1):
        pictures.append(f"{name}-{number}.png")
        write_file_whole(folder / pictures[-1], picture)
    document = {
        "format": "spherecal/study",
        "version": 1,
        "study": name,
        "title": title,
        "options": options,
        "pdf": f"{name}.pdf",
        "pictures": pictures,
        "compared": [asdict(row) for row in page.compared],
        "trials": figures,
    }
    write_file_whole(folder / f"{name}.json", json_bytes(document))
    write_paper(folder)
    return folder / f"{name}.pdf"
