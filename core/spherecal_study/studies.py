"""All studies by name, how one is run and written, and the table of every figure of the paper beside ours."""

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal_documents.report.style import report_style
from spherecal_files.atomic import write_file_whole
from spherecal_files.filesystem import remove_below
from spherecal_files.json_file import json_bytes
from spherecal_sim.rigs import rig_design
from spherecal_study import camera_count as cameras
from spherecal_study import compare_methods as compare
from spherecal_study import layouts, noise, rig_b, wand
from spherecal_study import path_study as path
from spherecal_study.executor import Trial, Workers, kept_result, run_trials
from spherecal_study.rendered import renderings
from spherecal_study.study_agreement import LEAST_RUNS, TESTS, Results
from spherecal_study.study_page import Document, Options

ORDER = ("compare", "layouts", "path", "noise", "cameras", "rigB", "bar")


@dataclass(frozen=True)
class KeptPage:
    """One study's page: PDF, a picture of each of its pages, its table paper / ours, and its options."""

    name: str
    title: str
    pdf: Path
    pictures: tuple[Path, ...]
    compared: tuple[dict[str, Any], ...]  # `what`, `paper`, `ours`, `agrees` (or None), `why`
    options: dict[str, Any]  # `runs`, `sigma_px` (None: images), `seed`, `preset` (None: the paper's), or `session`


def pages(folder: Path) -> tuple[KeptPage, ...]:
    """The complete pages in a folder of `spherecal study -o FOLDER`, the comparison of methods first."""
    found = [page for path in sorted(folder.glob("*.json")) if (page := _read(path)) is not None]
    place = {name: i for i, name in enumerate(ORDER)}
    return tuple(sorted(found, key=lambda page: (place.get(page.name, len(ORDER)), page.name)))


def _read(path: Path) -> KeptPage | None:
    try:
        d = json.loads(path.read_bytes())
        if d["format"] != "spherecal/study":
            return None
        page = KeptPage(
            d["study"], d["title"], path.parent / d["pdf"], tuple(path.parent / name for name in d["pictures"]),
            tuple(d["compared"]), d["options"],
        )  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return page if all(file.is_file() for file in (page.pdf, *page.pictures)) else None


FILE = "paper.md"
_PLACES = {
    "layouts": "Fig. 8", "path": "Figs. 9, 10", "noise": "Table II", "cameras": "Fig. 13",
    "compare": "Figs. 16, 17, 19, Table III", "rigB": "Fig. 16, second system", "bar": "1-D method alone",
}  # fmt: skip
_AGREES = {"yes": "yes", "differs": "**differs**", "cannot tell": "cannot tell", None: ""}


def write_paper(folder: Path) -> None:
    """Write `paper.md`: the tables paper / ours of the studies run so far on the paper's own simulated rigs."""
    kept = {page.name: page for page in pages(folder) if _as_in_the_paper(page)}
    if kept:
        write_file_whole(folder / FILE, paper_table_text(kept).encode())


def _as_in_the_paper(page: KeptPage) -> bool:
    o = page.options
    usual = o.get("preset") is None and not o.get("known") and o.get("paths") is None
    if not all("test" in row for row in page.compared):
        return False  # an older version's page, without stated tests
    return page.name in _PLACES and "session" not in o and o.get("sigma_px") is not None and usual


def paper_table_text(kept: dict[str, KeptPage]) -> str:
    """The page as Markdown, of the pages by study."""
    lines = [
        "# The paper's figures and ours",
        "",
        "Written by `spherecal study`. Paper: L. Tao et al., IEEE Trans. Instrum. Meas. 70 (2021) 5016715, on real "
        "rigs; ours: the same experiments on simulated rigs. 0.0465(47) is a mean over the runs of 0.0465 with a "
        "standard error of 0.0047.",
        "",
        "A row agrees by one of these tests (80 % was chosen after the first 30 runs of one row):",
        "",
        *(f"- {words}." for words in TESTS.values()),
        "- An interval on the other side differs. "
        f"Fewer than {LEAST_RUNS} runs cannot tell, nor can an interval that lies on both sides.",
        "",
        "The rigs:",
        "",
        *_rigs(),
    ]
    for name, place in _PLACES.items():
        if name not in kept:
            lines += ["", f"## {place} (run `spherecal study {name}`)"]
            continue
        page, o = kept[name], kept[name].options
        has_runs = len({c["runs"] for c in page.compared}) > 1  # what all rows share is said above the table
        pipelines = ", ".join(dict.fromkeys(c["pipeline"] for c in page.compared if c.get("pipeline")))
        notes = list(dict.fromkeys(c["why"] for c in page.compared if c["why"]))
        lines += [
            "",
            f"## [{page.title}]({page.pdf.name})",
            "",
            f"`spherecal study {name} --runs {o['runs']}`, seed {o['seed']}, image noise {o['sigma_px']:g} px, "
            f"pipeline {pipelines}: {_done(page)}.",
            "",
            *_table(
                ["quantity", *["runs"] * has_runs, "paper", "ours", "agrees"],
                [(c["what"], *[str(c["runs"])] * has_runs, c["paper"], *_found(c, notes)) for c in page.compared],
            ),
        ]
        if notes:
            lines += ["", *(f"{number}. {note}" for number, note in enumerate(notes, 1))]
    return "\n".join(lines) + "\n"


def _found(c: dict[str, Any], notes: list[str]) -> tuple[str, str]:
    """Our figures as in GUM 7.2.2, `0.0465(47)`, whether they agree by which test, and the number of the note."""
    ours = re.sub(r" \+- ([\d.]+)", lambda error: f"({int(error[1].replace('.', ''))})", c["ours"])
    words = f"{_AGREES[c['agrees']]} ({c['test']})" if c["agrees"] else ""
    return ours, f"{words} [{notes.index(c['why']) + 1}]".strip() if c["why"] else words or "-"


def _done(page: KeptPage) -> str:
    """How many of the requested runs are there; a series that was stopped continues by the same command."""
    least = min((c["runs"] for c in page.compared), default=0)
    if least >= page.options["runs"]:
        return "complete"
    return f"not complete, {least} runs in some lines (the same command goes on where it was stopped)"


def _rigs() -> list[str]:
    """The two systems as the paper describes, and what it does not say as we simulate it."""
    return [
        f"- {name}: {len(design.places_mm)} {design.kind.model} {frame}. Not given: {missing}; simulated: "
        + f"{' x '.join(map(str, design.kind.image_size))} at {design.kind.pixel_pitch_um:g} um, "
        + f"{design.kind.focal_length_mm:g} mm lenses."
        for name, design, frame, missing in (
            ("Rig A", rig_design("rigA"), "in two rows on top of 1500 x 1000 x 1200 mm", "focal length"),
            ("Rig B", rig_design("rigB"), "in two parallel planes, 1290 x 1150 x 990 mm", "sensor size"),
        )
    ]


def _table(head: list[str], rows: Sequence[tuple[str, ...]]) -> list[str]:
    lines = (tuple(text.replace("|", "\\|") for text in row) for row in (tuple(head), *rows))
    first, *others = ("| " + " | ".join(row) + " |" for row in lines)
    return [first, "|---" * len(head) + "|", *others]


STUDIES: dict[str, ModuleType] = {
    "layouts": layouts, "path": path, "noise": noise, "cameras": cameras, "compare": compare, "rigB": rig_b,
    "bar": wand,
}  # fmt: skip
_DPI = 130  # of the pictures of pages: small print can be read


def run_study(
    name: str, options: Options, folder: Path, workers: Workers, context: Context, kept_only: bool = False
) -> Path:
    """Run a study and write its page (see `write_page`) and the index of all pages into the folder; the page's path."""
    if name == "bar" and options.images:
        raise InputError(
            "The study of the waved bar needs thousands of frames, which are not rendered.",
            "Leave out --images; `compare --images` has a rendered bar of forty frames.",
        )
    if name == "rigB" and options.preset:
        raise InputError("The study rigB compares rigs A and B.", "Leave out --rig.")
    study = STUDIES[name]
    listed = study.trials(options)
    if kept_only:
        listed, results = _kept(name, listed, folder / "trials")
    else:
        run_trials(renderings(listed), folder / "trials", workers, context)
        results = run_trials(listed, folder / "trials", workers, context)
    context.report("drawing the page", 0.0)
    with report_style():
        page: Document = study.page(listed, results, options)
        return write_page(name, page, asdict(options), listed, results, folder)


def _kept(name: str, listed: list[Trial], folder: Path) -> tuple[list[Trial], Results]:
    """The trials whose results are kept, with these."""
    both = [(trial, result) for trial in listed if (result := kept_result(folder, trial)) is not None]
    if not both:
        raise InputError(f"{folder}: holds no results of the study {name}.", "Run it without --kept.")
    return [trial for trial, _ in both], [result for _, result in both]


def write_page(
    name: str, page: Document, options: dict[str, Any], listed: list[Trial], results: Results, folder: Path
) -> Path:
    """Write a study's page as PDF, pictures and JSON, and `paper.md`, within `report_style`; the PDF's path."""
    figures = [
        {"kind": t.kind, "settings": dict(t.settings), "result": r} for t, r in zip(listed, results, strict=True)
    ]
    for old in folder.glob(f"{name}-*.png"):
        remove_below(folder, old.name)
    pictures = []
    write_file_whole(folder / f"{name}.pdf", page.pdf())
    for number, picture in enumerate(page.pictures(_DPI), 1):
        pictures.append(f"{name}-{number}.png")
        write_file_whole(folder / pictures[-1], picture)
    document = {
        "format": "spherecal/study",
        "version": 1,
        "study": name,
        "title": page.heading,
        "options": options,
        "pdf": f"{name}.pdf",
        "pictures": pictures,
        "compared": [
            {"what": row.what, "paper": row.paper, "ours": row.ours, "why": row.why, "pipeline": row.pipeline}
            | asdict(row.judged)
            for row in page.compared
        ],
        "trials": figures,
    }
    write_file_whole(folder / f"{name}.json", json_bytes(document))
    write_paper(folder)
    return folder / f"{name}.pdf"
