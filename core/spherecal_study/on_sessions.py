"""Studies on a recording of the user's own: fewer placements, fewer cameras, other paths."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.data.session import Session
from spherecal_documents.report.style import report_style
from spherecal_files.read_session import read_session
from spherecal_study.batch_of_sessions import fingerprint_of
from spherecal_study.executor import Result, Trial, Workers, run_trials
from spherecal_study.path_study import SEARCHES, draw_graph
from spherecal_study.studies import write_page
from spherecal_study.study_agreement import Results, all_errors, mean, pooled_rms
from spherecal_study.study_page import Document
from spherecal_study.trials import apart_mm, seen_along_the_thinnest

NAMES = ("layouts", "path", "cameras")
_WHY_NOT = {
    "noise": "It displaces points by known amounts and asks whether the truth is found",
    "compare": "It needs the same rig recorded with a ball, a board and a bar",
    "rigB": "It is about the paper's second rig",
    "bar": "It compares with the truth, which a recording does not have",
}
_MOST_STEPS = 8  # sizes of parts; more only fill the curve
RUNS = 5


@dataclass(frozen=True)
class SessionOptions:
    """Which recording, how many parts of each size are drawn, and the first seed of the drawing."""

    session: Path
    runs: int = RUNS
    seed: int = 1


def run_session_study(name: str, options: SessionOptions, folder: Path, workers: Workers, context: Context) -> Path:
    """Run `layouts`, `path` or `cameras` on a recorded session and write its page into the folder; the page's path."""
    if name not in NAMES:
        raise InputError(
            f"The study {name} makes no sense on a recorded session: {_WHY_NOT[name]}.",
            f"On recordings there are {', '.join(NAMES)}.",
        )
    session = read_session(options.session)
    _check(name, session, options.session)
    plain = {"session": str(options.session.resolve()), "fingerprint": fingerprint_of(options.session)}
    whole_trial = Trial("recorded", plain)
    whole = run_trials([whole_trial], folder / "trials", workers, context)[0]
    if not whole["valid"]:
        raise InputError(
            f"{options.session}: its calibration is not valid, so nothing can be learnt from parts of it.",
            "Run spherecal calibrate on it and see its findings.",
        )
    listed = _TRIALS[name](session, whole, plain, options)
    results = run_trials(listed, folder / "trials", workers, context)
    context.report("drawing the page", 0.0)
    with report_style():
        page = _PAGES[name](listed, results, whole, session, options)
        settings = {**asdict(options), "session": options.session.resolve().name}
        return write_page(f"{name}-session", page, settings, [whole_trial, *listed], [whole, *results], folder)


def _check(name: str, session: Session, path: Path) -> None:
    if len(session.placements) == 0 or session.board is not None:
        raise InputError(f"{path}: is no recording of a ball.", "The studies on recordings are about the ball.")
    if name == "layouts" and len(session.placements) < 3:
        raise InputError(
            f"{path}: has only {len(session.placements)} placements; there is nothing to leave out.",
            "Record three or more.",
        )
    if name == "cameras" and len(session.cameras) < 4:
        raise InputError(f"{path}: has only {len(session.cameras)} cameras; three are the least that can be.", "")


def _sizes(least: int, most: int) -> list[int]:
    """Sizes of parts from `least` to `most` (the whole), not too many."""
    count = min(_MOST_STEPS, most - least + 1)
    return sorted({int(n) for n in np.linspace(least, most, count).round()})


def _layouts(session: Session, whole: Result, plain: dict[str, Any], options: SessionOptions) -> list[Trial]:
    """Placements drawn at random, free and as rigid as the data allow; the whole with both forms."""
    names = [placement.id for placement in session.placements]
    rng = np.random.default_rng(options.seed)
    parts: list[list[str]] = []
    for n in _sizes(1, len(names)):
        drawn = {tuple(sorted(rng.choice(len(names), n, replace=False).tolist())) for _ in range(options.runs)}
        parts += [[names[i] for i in chosen] for chosen in sorted(drawn)]
    return [
        Trial("recorded", {**plain, "method": method, "without": [f"placement:{p}" for p in names if p not in part]})
        for method in ("free", "auto")
        for part in parts
    ]


def _cameras(session: Session, whole: Result, plain: dict[str, Any], options: SessionOptions) -> list[Trial]:
    """The cameras nearest to the rig's middle: they overlap most."""
    ids = list(whole["centres"])
    places = np.array(list(whole["centres"].values()))
    order = np.argsort(np.linalg.norm(places - places.mean(axis=0), axis=1), kind="stable")
    out = []
    for method in ("free", "auto"):
        for n in _sizes(3, len(ids)):
            kept = {ids[i] for i in order[:n]}
            without = [f"camera:{c.id}" for c in session.cameras if c.id not in kept]
            out.append(Trial("recorded", {**plain, "method": method, "without": without}))
    return out


def _path(session: Session, whole: Result, plain: dict[str, Any], options: SessionOptions) -> list[Trial]:
    return [Trial("recorded-paths", {**plain, "search": s}) for s in SEARCHES] + [
        Trial("recorded", {**plain, "search": s, "method": "tao2021"}) for s in SEARCHES
    ]


_FORMS = {"free": "free", "auto": "rigid where possible"}


def _page_of_parts(what: str, total: Callable[[Session], int]):
    """The page of a study that leaves placements or cameras out."""

    def page(
        listed: list[Trial], results: Results, whole: Result, session: Session, options: SessionOptions
    ) -> Document:
        text = (
            f"Parts of the recording are calibrated as if no more had been recorded: {_HOW[what]} Judged by the "
            "check bars, where there are any, and by how far the cameras then stand from where the whole recording "
            "has them. A part shares its data with the whole, so this understates its error where little is "
            "left out."
        )
        document = Document(f"Fewer {what} of {options.session.resolve().name}", [text])
        rows, px, bars, apart = [], {}, {}, {}
        for method, form in _FORMS.items():
            both = _of(listed, results, method)
            own = [(total(session) - len(t.settings["without"]), r) for t, r in both]
            _, largest = min(both, key=lambda pair: len(pair[0].settings["without"]))
            counts = sorted({n for n, _ in own})
            some = {n: [r for m, r in own if m == n and r["valid"]] for n in counts}
            px[form] = {n: mean([r["mean_px"] for r in part]) for n, part in some.items()}
            bars[form] = {n: pooled_rms([all_errors(r) for r in part]) for n, part in some.items()}
            apart[form] = {n: mean([apart_mm(r["centres"], largest["centres"]) for r in some[n]]) for n in counts[:-1]}
            for n, part in some.items():
                valid = f"{len(part)} of {sum(m == n for m, _ in own)}"
                rows.append([f"{form}, {n}", valid, px[form][n], bars[form][n], apart[form].get(n)])
        document.curves(px, what, "mean reprojection error, px")
        if any(np.isfinite(error) for found in bars.values() for error in found.values()):
            document.curves(bars, what, "rms error of check bars, mm")
        document.curves(apart, what, "cameras off the whole recording's, mm")
        document.table((f"form, {what}", "valid", "reprojection px", "bars rms mm", "cameras off mm"), rows)
        return document

    return page


_HOW = {
    "placements": "parts of each size are drawn at random.",
    "cameras": "the cameras nearest to the rig's middle stay.",
}


def _of(listed: list[Trial], results: Results, method: str) -> list[tuple[Trial, Result]]:
    return [(t, r) for t, r in zip(listed, results, strict=True) if t.settings.get("method") == method]


def _page_of_paths(
    listed: list[Trial], results: Results, whole: Result, session: Session, options: SessionOptions
) -> Document:
    text = (
        "OPT takes the path with the least b^m g by A*; none-OPT grows from the reference by the first triple that "
        "reaches a camera. Paths make the start; what the adjustment ends with is another matter, so both are shown."
    )
    document = Document(f"Paths through the cameras of {options.session.resolve().name}", [text])
    found = {(t.kind, t.settings["search"]): r for t, r in zip(listed, results, strict=True)}
    starts = {s: found["recorded-paths", s] for s in SEARCHES}
    lengths = {text: [mean(list(starts[s]["lengths"].values()))] for s, text in SEARCHES.items()}
    document.columns(["mean path length (edge weights)"], lengths, "", height=50.0)
    start_px = {text: [starts[s]["start_px"]] for s, text in SEARCHES.items()}
    document.columns(["start: median residual"], start_px, "px", height=50.0)
    document.paragraph("The graph: edges of OPT's paths dark, of none-OPT's red.")
    places = seen_along_the_thinnest(whole["centres"], starts["opt"]["ids"])
    draw_graph(
        document,
        {**starts["opt"], "places": places.tolist()},
        starts["first"],
        "Cameras in the plane in which they spread most",
    )
    rows = [
        [text, starts[s]["start_px"], found["recorded", s]["mean_px"], pooled_rms([all_errors(found["recorded", s])])]
        for s, text in SEARCHES.items()
    ]
    document.table(("search", "start px", "end px", "bars rms mm"), rows)
    return document


_TRIALS = {"layouts": _layouts, "cameras": _cameras, "path": _path}
_PAGES = {
    "layouts": _page_of_parts("placements", lambda session: len(session.placements)),
    "cameras": _page_of_parts("cameras", lambda session: len(session.cameras)),
    "path": _page_of_paths,
}
