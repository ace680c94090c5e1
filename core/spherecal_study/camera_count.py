"""Fig. 13: four to ten cameras of rig A."""

from typing import Any

import numpy as np

from spherecal_study import study_page
from spherecal_study.executor import Trial
from spherecal_study.study_agreement import Estimate, below, estimate

TITLE = "Number of cameras (Fig. 13)"
RUNS = 5
_COUNTS = (4, 7)  # and all ten
_METHODS = {"free": "free", "auto": "rigid where possible"}
_BAR = "A3A4"


def trials(options: study_page.Options) -> list[Trial]:
    """Calibrations with the four or seven cameras nearest to the rig's middle and with all, free and as `auto` does."""
    return [
        Trial("ball", {**options.plain("rigA"), "seed": s, "method": m, **({"cameras": n} if n in _COUNTS else {})})
        for m in _METHODS
        for n in _counts(options)
        for s in options.seeds
    ]


def _counts(options: study_page.Options) -> list[int]:
    every = options.cameras("rigA")
    return [*(n for n in _COUNTS if n < every), every]


def page(listed: list[Trial], results: study_page.Results, options: study_page.Options) -> study_page.StudyPage:
    """The study's page: errors over the number of cameras, and the table paper / ours."""
    document = study_page.begin(
        TITLE,
        options,
        [
            f"{options.rig_words('rigA')}: four or seven nearest to the middle, and all; the ball at four "
            "places. The bar is A3A4 (200 mm) in up to 20 poses; poses whose marks fewer than two cameras see "
            "drop out."
        ],
    )
    both = [(t.settings, r) for t, r in zip(listed, results, strict=True)]
    px: dict[str, dict[int, Estimate]] = {}
    sd: dict[str, dict[int, Estimate]] = {}
    off: dict[str, dict[int, Estimate]] = {}
    for m, name in _METHODS.items():
        every = options.cameras("rigA")
        own = [(s.get("cameras", every), r) for s, r in both if s["method"] == m]
        chosen = {n: [r for count, r in own if count == n] for n in _counts(options)}
        chosen = {n: some for n, some in chosen.items() if some}
        px[name] = {n: estimate([r["mean_px"] for r in some]) for n, some in chosen.items()}
        sd[name] = {
            n: estimate([study_page.pooled_sd([r["bars"].get(_BAR, [])]) for r in some]) for n, some in chosen.items()
        }
        off[name] = {n: estimate([_mean_error(r) for r in some]) for n, some in chosen.items()}
    _curves(document, px, "mean reprojection error, px", {"paper: best": 0.0593, "paper: worst": 0.0875})
    _curves(document, sd, "A3A4: standard deviation, mm", {"paper: below": 0.1})
    _curves(document, off, "A3A4: size of mean error, mm", {"paper: below": 0.05})
    rows = [
        [f"{name}, {n}", e.n, e.words(4), off[name][n].words(4), sd[name][n].words(4)]
        for name, own in px.items()
        for n, e in own.items()
    ]
    heads = ("form, cameras", "runs", "reprojection px", "A3A4 mean mm", "A3A4 sd mm")
    study_page.table(document, heads, rows)
    return _against_paper(document, px["free"], off, sd)


def _mean_error(result: dict[str, Any]) -> float | None:
    errors = result["bars"].get(_BAR)
    return abs(float(np.mean(errors))) if errors else None


def _curves(
    document: study_page.Document, found: dict[str, dict[int, Estimate]], label: str, lines: dict[str, float]
) -> None:
    """Means over runs with their standard errors, over the number of cameras."""
    series = {name: (list(own), [e.mean for e in own.values()]) for name, own in found.items()}
    errors = {name: [e.error for e in own.values()] for name, own in found.items()}
    study_page.curves(document, series, "cameras", label, lines=lines, errors=errors)


_PIPELINES = {"free": "free", "rigid where possible": "auto"}


def _against_paper(
    document: study_page.Document,
    px: dict[int, Estimate],
    off: dict[str, dict[int, Estimate]],
    sd: dict[str, dict[int, Estimate]],
) -> study_page.StudyPage:
    none = estimate([])

    def worst(found: dict[int, Estimate]) -> tuple[Estimate, str]:
        n = max(found, key=lambda n: found[n].mean, default=0)
        return found.get(n, none), f"at {n} cameras"

    most, where = worst(px)
    rows = [
        study_page.PaperComparison(
            "mean reprojection error",
            "0.0593 px at best, 0.0875 at worst",
            f"{most.words(4)} px at most, {where}",
            below(most, 0.0875),
            "follows the image noise. The paper prints 0.875 at worst; 0.0875 is probably meant.",
            "limit",
            most.n,
        )
    ]
    for name, means in off.items():
        mean, at = worst(means)
        rows.append(
            study_page.PaperComparison(
                f"A3A4, mean error, {name}",
                "below 0.05 mm",
                f"{mean.words(4)} mm at most, {at}",
                below(mean, 0.05),
                "",
                "limit",
                mean.n,
                _PIPELINES[name],
            )
        )
        scatter, at = worst(sd[name])
        why = "few views at four placements determine the lenses poorly." if name == "free" else ""
        rows.append(
            study_page.PaperComparison(
                f"A3A4, standard deviation, {name}",
                "below 0.1 mm",
                f"{scatter.words(4)} mm at most, {at}",
                below(scatter, 0.1),
                why,
                "limit",
                scatter.n,
                _PIPELINES[name],
            )
        )
    return study_page.paper_table(document, rows, "free")
