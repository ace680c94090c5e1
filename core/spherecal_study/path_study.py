"""Figs. 9 and 10: OPT against none-OPT and Dijkstra, with the graph drawn."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from spherecal_documents.report.style import BAD, INK, RULE, SERIES, SMALL_PT, PageBox, Sheet
from spherecal_sim.rigs import rig_design
from spherecal_study.executor import Trial
from spherecal_study.study_agreement import (
    RATIO,
    Estimate,
    Judged,
    Results,
    above,
    all_errors,
    bars_rms,
    estimate,
    like,
    mean_px,
    pairs,
    pooled_rms,
    with_seeds,
)
from spherecal_study.study_page import Document, Options, PaperComparison, paper_line

TITLE = "Paths through the camera graph (Figs. 9 and 10)"
RUNS = 5
SEARCHES = {
    "opt": "OPT (A*)", "dijkstra": "Dijkstra", "first": "none-OPT", "first-listed": "none-OPT, literal order",
}  # fmt: skip
_RIGS = ("rigA", "rigB")


def trials(options: Options) -> list[Trial]:
    """The paper's graph, paths and starts, what its adjustment makes of them, and whole calibrations."""
    starts = [
        Trial("paths", {**_plain(options, rig), "seed": s, "search": search, **({"known": True} if known else {})})
        for rig in _rigs(options)
        for known in _known(options)
        for search in SEARCHES
        for s in options.seeds
    ]
    ends = [
        Trial(
            "ball",
            {**_plain(options, rig), "seed": s, "method": "tao2021", **({"search": search} if search != "opt" else {})},
        )
        for rig in _rigs(options)[:1]
        if not rig_design(rig).walk
        for search in SEARCHES
        if search != "dijkstra"
        for s in options.seeds
    ]
    adjusted = [
        Trial("published", {**_plain(options, rig), "seed": s, **({"known": True} if known else {}), **more})
        for rig, known, more in _published(options)
        for s in options.seeds
    ]
    return starts + adjusted + ends


# Groups of as few points as an eight-point estimate needs, whatever their error: the worst starts there are.
_WEAK: dict[str, Any] = {"th_pt": 8, "paths": [1.0, 1.0, 1e6, 1.1]}


def _published(options: Options) -> list[tuple[str, bool, dict[str, Any]]]:
    """Rigs, whether intrinsics are known, and settings to start from; weak groups tell only on the last rig."""
    rigs = [rig for rig in _rigs(options) if not rig_design(rig).walk]
    weak = [(rigs[-1], options.known, _WEAK)] if rigs and options.paths is None else []
    known = [(rigs[-1], True, {})] if rigs and not (options.known or options.images) else []
    return [*((rig, options.known, {}) for rig in rigs), *known, *weak]


def _plain(options: Options, rig: str) -> dict[str, Any]:
    return {**options.plain(rig), "preset": rig}


def _known(options: Options) -> tuple[bool, ...]:
    return (True,) if options.known else (False,) if options.images else (False, True)


def _rigs(options: Options) -> tuple[str, ...]:
    return (options.rig(_RIGS[0]),) if options.images or options.preset else _RIGS


def page(listed: list[Trial], results: Results, options: Options) -> Document:
    """The study's page: paths, starts and results of each search, the graph, and the table paper / ours."""
    document = options.begin(TITLE, "path")
    rigs = _rigs(options)
    whole = [rig for rig in rigs[:1] if not rig_design(rig).walk]
    both = with_seeds(listed, results)

    def some(kind: str, rig: str, search: str, known: bool = False) -> Results:
        own = [(t.settings, r) for t, r in both if t.kind == kind and _is(t.settings, rig, known or options.known)]
        return [r for settings, r in own if settings.get("search", "opt") == search]

    for known in _known(options):
        _starts(document, rigs, known, some)
    ends = _ends(document, both, options)
    document.paragraph(f"The graph of {rigs[0]}, seed {options.seed}: edges of OPT's paths dark, of none-OPT's red.")
    opt, first = some("paths", rigs[0], "opt"), some("paths", rigs[0], "first")
    if opt and first:
        draw_graph(document, opt[0], first[0])
    if not whole:
        return document
    rows = []
    for rig in whole:
        for s, name in SEARCHES.items():
            chosen = some("ball", rig, s)
            if chosen:
                rows.append([f"{rig}, {name}", len(chosen), mean_px(chosen).words(4), bars_rms(chosen).words(4)])
    document.table(("rig, search", "runs", "px at the end", "bars rms mm"), rows)
    ends += [_search_line(rig, some("paths", rig, "opt"), some("paths", rig, "dijkstra")) for rig in rigs]
    return document.against_paper([*_compared(rigs[0], some, options), *ends], "tao2021")


_Cases = list[dict[str, Any]]
_WAYS = (
    ("OPT, SPO", "opt", True), ("OPT, none-SPO", "opt", False), ("Dijkstra, SPO", "dijkstra", True),
    ("none-OPT, SPO", "first", True), ("none-OPT, none-SPO", "first", False),
    ("none-OPT, literal order, SPO", "first-listed", True),
    ("none-OPT, literal order, none-SPO", "first-listed", False),
)  # fmt: skip


def _ends(document: Document, both: Sequence[tuple[Trial, dict[str, Any]]], options: Options) -> list[PaperComparison]:
    """What the paper's adjustment makes of every variant of its start, as a table and as lines."""
    lines = []
    for rig, known, more in _published(options):
        own = [(t.settings, r) for t, r in both if t.kind == "published" and _is(t.settings, rig, known)]
        runs = [r for settings, r in own if settings.get("th_pt") == more.get("th_pt")]
        if not runs:
            continue
        words = f"{rig}, {'known' if known else 'nominal'} intrinsics" + (
            ", weak groups (TH_pt 8, any error)" if more else ""
        )
        document.begin_section(f"The adjustment from each start: {words}")
        heads = ("start", "converged", "other minimum", "not settled", "unplaced", "start px", "steps", "CPU ms")
        rows = [[name, *_ended([_case(r, s, spo) for r in runs], runs[0]["cameras"])] for name, s, spo in _WAYS]
        document.table(heads, rows)
        lines.append(_line(words, runs, options))
    document.caption(
        "Converged: the rms of the same observations' optimum within 5 %, all cameras placed. Not settled: stopped at "
        "200 steps. Start px: median residual of the start; steps and time of the adjustment: medians."
    )
    return lines


def _case(run: dict[str, Any], search: str, spo: bool) -> dict[str, Any]:
    return next(c for c in run["cases"] if c["search"] == search and c["spo"] == spo)


def _is_right(case: dict[str, Any], cameras: int) -> bool:
    return case["converged"] and case["placed"] == cameras


def _ended(cases: _Cases, cameras: int) -> list[str]:
    wrong = [c for c in cases if c["placed"] == cameras and not c["converged"]]
    settled = sum(c["settled"] for c in wrong)
    return [
        f"{sum(_is_right(c, cameras) for c in cases)} of {len(cases)}",
        *map(str, (settled, len(wrong) - settled, sum(c["placed"] < cameras for c in cases))),
        *(f"{np.median([c[name] for c in cases]) * factor:.0f}" for name, factor in _MEDIANS),
    ]


_MEDIANS = (("start_px", 1), ("iterations", 1), ("adjust_s", 1e3))


def _line(words: str, runs: Results, options: Options) -> PaperComparison:
    """How many runs end in the optimum from each start, beside our robust start."""
    cameras, n = runs[0]["cameras"], len(runs)
    cases = {name: [_case(r, s, spo) for r in runs] for name, s, spo in _WAYS}
    counts = {name: sum(_is_right(c, cameras) for c in own) for name, own in cases.items()}
    limit = _SAME * (options.sigma_px or 0.1) * np.sqrt(2)
    counts["our robust start"] = sum(
        r["ours"]["cameras"] == cameras and (r["ours"]["rms_px"] or np.inf) < limit for r in runs
    )
    return paper_line(
        "path",
        "optimum",
        Judged(n),
        runs=n,
        words=words,
        starts="; ".join(counts),
        counts=", ".join(map(str, counts.values())),
    )


def _search_line(rig: str, opt: Results, dijkstra: Results) -> PaperComparison:
    """The time of A* against Dijkstra's."""
    both = pairs(opt, dijkstra)
    ms = [estimate([1e3 * pair[way]["search_s"] for pair in both]) for way in (0, 1)]
    same = sum(a["paths"] == b["paths"] for a, b in both)
    return paper_line(
        "path", "search", Judged(len(both)), rig=rig, opt=ms[0].words(2), dijkstra=ms[1].words(2), same=same
    )


_SAME = 1.05  # times the noise: within this an adjustment is at its optimum


def _is(settings: Mapping[str, Any], rig: str, known: bool) -> bool:
    return settings["preset"] == rig and settings.get("known", False) == known


def _length(result: dict[str, Any]) -> float | None:
    """The mean length of a run's paths; None where one leads over an edge that the graph refuses."""
    lengths = [length for length in result["lengths"].values()]
    return None if None in lengths else float(np.mean(lengths))


def _starts(document: Document, rigs: Sequence[str], known: bool, some: Callable[..., Results]) -> None:
    """Lengths, starts and what the term 1/N does, with nominal or with known intrinsics."""
    words = "known" if known else "nominal"
    rows: list[list[object]] = []
    starts: dict[str, list[Estimate]] = {}
    for s, name in SEARCHES.items():
        for rig in rigs:
            chosen = some("paths", rig, s, known)
            length, start = estimate([_length(r) for r in chosen]), estimate([r["start_px"] for r in chosen])
            starts.setdefault(name, []).append(start)
            if not chosen:
                continue
            share = estimate([100 * r["count_share"] for r in chosen])
            changed = sum(r["changed_by_count"] for r in chosen)
            paths = sum(len(r["paths"]) - 1 for r in chosen)
            refused = sum(_length(r) is None for r in chosen)
            figures = length.words(4), refused, start.words(2), share.words(3), f"{changed} of {paths}"
            rows.append([f"{rig}, {name}", len(chosen), *figures])
    document.begin_section(f"Paths, {words} intrinsics")
    document.columns(rigs, starts, "start: median residual, px")
    heads = ("rig, search", "runs", "mean path length", "refused", "start px", "share of 1/N, %", "changed by 1/N")
    document.table(heads, rows)
    document.caption(
        "Refused: runs in which a path leads over an edge beyond TH_er, whose length is infinite. Changed by 1/N: "
        "paths that are others when xi2 = 0."
    )


def _compared(rig: str, some: Callable[..., Results], options: Options) -> list[PaperComparison]:
    rows = []
    for known in _known(options):
        words = "known" if known else "nominal"
        for s in ("first", "first-listed"):
            both = pairs(some("paths", rig, "opt", known), some("paths", rig, s, known))
            ratio = estimate([_over(_length(b), _length(a)) for a, b in both])
            rows.append(
                paper_line(
                    "path",
                    "lengths",
                    like(ratio, 0.188 / 0.1221),
                    search=SEARCHES[s],
                    words=words,
                    ratio=ratio.words(3),
                )
            )
    opt = some("ball", rig, "opt")
    for s in ("first", "first-listed"):
        chosen = pairs(opt, some("ball", rig, s))
        ratio = estimate([b["mean_px"] / a["mean_px"] for a, b in chosen])
        bars = estimate([pooled_rms([all_errors(b)]) / pooled_rms([all_errors(a)]) for a, b in chosen])
        px = mean_px([a for a, _ in chosen])
        rows += [
            paper_line(
                "path", "pixels", like(ratio, 0.15 / 0.09), search=SEARCHES[s], ratio=ratio.words(4), px=px.words(4)
            ),
            paper_line("path", "bars", above(bars, RATIO), search=SEARCHES[s], ratio=bars.words(4)),
        ]
    return rows


def _over(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else one / other


def draw_graph(
    document: Document, opt: dict[str, Any], first: dict[str, Any], view: str = "Cameras from above"
) -> None:
    """Add a drawing of the camera graph to a document: cameras, all edges, and those of two searches' paths."""

    def draw(sheet: Sheet, box: PageBox) -> None:
        axes = sheet.axes(box.inset(10.0, 2.0, 10.0, 4.0))
        places = np.array(opt["places"])[:, :2]
        weights = np.array([weight for _, _, weight in opt["edges"]])
        for (a, b, _), pale in zip(opt["edges"], weights / weights.max(), strict=True):
            axes.plot(*places[[a, b]].T, color=RULE, linewidth=1.2 - pale, zorder=1)
        placed = np.isfinite(places[:, 0])
        for result, colour, style, width in ((first, BAD, "--", 1.6), (opt, SERIES[0], "-", 2.2)):
            for path in result["paths"].values():
                axes.plot(*places[path].T, color=colour, linestyle=style, linewidth=width, zorder=2)
        axes.scatter(*places.T, s=22, color="white", edgecolors=INK, linewidths=0.8, zorder=3)
        reference = places[opt["reference"]]
        axes.scatter(*reference, s=40, color=INK, zorder=4)
        for place, name in zip(places[placed], np.array(opt["ids"])[placed], strict=True):
            axes.annotate(name, place, xytext=(3, 4), textcoords="offset points", fontsize=SMALL_PT)
        axes.set_aspect("equal")
        axes.set_axis_off()

    document.figure(view, 78.0, draw)
    document.caption(f"{view}; filled: the reference. Thin lines: all edges, heavier ones thinner.")
