"""The table of every figure of the paper beside ours, from the pages in a folder."""

from pathlib import Path

from spherecal.files.atomic import write_file_whole
from spherecal_sim.rigs import rig_design
from spherecal_study.kept_pages import KeptPage, pages
from spherecal_study.study_agreement import LEAST_RUNS, TESTS

FILE = "paper.md"
_PLACES = {
    "layouts": "Fig. 8", "path": "Figs. 9, 10", "noise": "Table II", "cameras": "Fig. 13",
    "compare": "Figs. 16, 17, 19, Table III", "rigB": "Fig. 16, second system", "bar": "1-D method alone",
}  # fmt: skip
_HEAD = ("| quantity | pipeline | paper | ours | runs | test | agrees | remarks |", "|---|---|---|---|---|---|---|---|")
_AGREES = {"yes": "yes", "differs": "**differs**", "cannot tell": "cannot tell", None: "-"}


def write_paper(folder: Path) -> None:
    """Write `paper.md`: every line of the tables paper / ours of the studies run so far, and which are missing.

    Only studies on simulated observations of the paper's own rigs count; nothing is written where there is none.
    """
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
        "rigs; ours: the same experiments on simulated observations of the same rigs.",
        "",
        "Ours are means over independent runs with their standard errors. The tests, the same for all rows (the limit "
        "of 80 % was chosen after the first 30 runs of one):",
        "",
        *(f"- {words}." for words in TESTS.values()),
        f"- Fewer than {LEAST_RUNS} runs cannot tell, nor can an interval that holds the paper's figure and more.",
        "",
        "## The rigs",
        "",
        *_HEAD,
        *(_row(what, "-", said, ours, "-", "-", None, why) for what, said, ours, why in _rigs()),
    ]
    for name, place in _PLACES.items():
        if name not in kept:
            lines += ["", f"## {place} (run `spherecal study {name}`)"]
            continue
        page, o = kept[name], kept[name].options
        lines += [
            "",
            f"## [{page.title}]({page.pdf.name})",
            "",
            f"`spherecal study {name} --runs {o['runs']}`, from seed {o['seed']}, image noise {o['sigma_px']:g} px a "
            f"coordinate; {_done(page)}.",
            "",
            *_HEAD,
            *(
                _row(
                    c["what"],
                    c.get("pipeline") or "-",
                    c["paper"],
                    c["ours"],
                    str(c["runs"]),
                    c["test"] or "-",
                    _AGREES[c["agrees"]],
                    c["why"],
                )
                for c in page.compared
            ),
        ]
    return "\n".join(lines) + "\n"


def _done(page: KeptPage) -> str:
    """How many of the requested runs are there; a series that was stopped continues by the same command."""
    least = min((c["runs"] for c in page.compared), default=0)
    if least >= page.options["runs"]:
        return "complete"
    return f"not complete, {least} runs in some lines (the same command goes on where it was stopped)"


def _rigs() -> list[tuple[str, str, str, str]]:
    """The two systems as the paper describes and as we simulate them."""
    rows = []
    for name, preset, said, why in (
        (
            "rig A",
            "rigA",
            "10 AVT G-319B, 2064 x 1544 at 3.45 um, two rows on top of 1500 x 1000 x 1200 mm",
            "the paper gives no focal length; 8 mm is simulated.",
        ),
        (
            "rig B",
            "rigB",
            "12 MV-CA050-20GM, 12 mm lenses, two parallel planes, 1290 x 1150 x 990 mm",
            "the paper gives no sensor size; 2448 x 2048 at 3.45 um is simulated.",
        ),
    ):
        design = rig_design(preset)
        kind = design.kind
        size = " x ".join(map(str, kind.image_size))
        ours = (
            f"{len(design.places_mm)} {kind.model}, {size} at {kind.pixel_pitch_um:g} um, {kind.focal_length_mm:g} mm "
            "lenses, in the same frame"
        )
        rows.append((name, said, ours, why))
    return rows


def _row(*cells: str | None) -> str:
    texts = [cell if cell is not None else _AGREES[None] for cell in cells]
    return "| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |"
