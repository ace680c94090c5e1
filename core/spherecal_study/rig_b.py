"""The second system of the paper: twelve cameras on two planes."""

from spherecal_study import study_agreement
from spherecal_study.executor import Trial
from spherecal_study.study_page import Document, Options, PaperComparison, paper_line

TITLE = "The second system: rig B"
RUNS = 5
_WAYS = {"tao2021": "as in the paper", "free": "free", "auto": "rigid where possible"}


def trials(options: Options) -> list[Trial]:
    """Calibrations of rigs A and B by each form."""
    return [
        Trial("ball", {**options.plain(rig), "preset": rig, "seed": s, "method": m})
        for rig in ("rigA", "rigB")
        for m in _WAYS
        for s in options.seeds
    ]


def page(listed: list[Trial], results: study_agreement.Results, options: Options) -> Document:
    """The study's page: residuals and bars of both rigs, and the table paper / ours."""
    document = options.begin(TITLE, "rigB")
    both = [(t.settings, r) for t, r in zip(listed, results, strict=True)]

    def some(rig: str, method: str) -> study_agreement.Results:
        return [r for s, r in both if s["preset"] == rig and s["method"] == method]

    rows, series = [], {}
    for m, name in _WAYS.items():
        for rig in ("rigA", "rigB"):
            chosen = some(rig, m)
            x, y, sx, sy = (f"{_coordinate(chosen, *of).mean:.4f}" for of in _COORDINATES)
            bars, alone = study_agreement.bars_rms(chosen), study_agreement.alone_rms(chosen)
            figures = f"{x} / {y}", f"{sx} / {sy}", bars.words(4), alone.words(4)
            rows.append([f"{rig}, {name}", len(chosen), *figures])
            series.setdefault(name, []).append(bars)
    document.columns(["rig A", "rig B"], series, "bars, rms error, mm", paper={"paper: sd below": 0.125})
    heads = ("rig, form", "runs", "mean |x| / |y| px", "sd x / y px", "bars rms mm", "calibration alone mm")
    document.table(heads, rows)
    _by_camera(document, some("rigA", "tao2021"))
    return document.against_paper(_compared(some("rigA", "tao2021"), some("rigB", "auto"), options), "tao2021")


_COORDINATES = (("mean_abs_px", 0), ("mean_abs_px", 1), ("sd_px", 0), ("sd_px", 1))


def _coordinate(chosen: study_agreement.Results, name: str, axis: int) -> study_agreement.Estimate:
    return study_agreement.estimate([r[name][axis] for r in chosen])


def _by_camera(document: Document, chosen: study_agreement.Results) -> None:
    """Residuals of each of rig A's cameras beside the paper's figures over all ten."""
    if not chosen:
        return
    document.begin_section("Residuals by camera, rig A, by the paper's method")
    ids = sorted(chosen[0]["camera_sd_px"])
    for name, what, paper in (
        ("camera_mean_abs_px", "mean absolute residual, px", {"paper, x": 0.0453, "paper, y": 0.0483}),
        ("camera_sd_px", "standard deviation, px", {"paper, x": 0.0632, "paper, y": 0.0629}),
    ):
        series = {
            letter: [study_agreement.estimate([r[name][c][axis] for r in chosen if c in r[name]]) for c in ids]
            for axis, letter in enumerate("xy")
        }
        document.columns(ids, series, what, paper=paper)
    document.caption("The paper gives the means and standard deviations over its ten cameras (Fig. 16).")


def _compared(a: study_agreement.Results, b: study_agreement.Results, options: Options) -> list[PaperComparison]:
    x, y, sx, sy = (_coordinate(a, *of) for of in _COORDINATES)
    noise = f"{0.0453 / x.mean * (options.sigma_px or 0.0):.3f}"
    ratio = study_agreement.estimate([r["sd_px"][0] / r["mean_abs_px"][0] for r in a])
    placed = sum(r["cameras"] == 12 and r["valid"] for r in b)
    return [
        paper_line("rigB", "residuals", study_agreement.Judged(x.n), x=x.words(4), y=y.words(4), noise=noise),
        paper_line("rigB", "deviations", study_agreement.Judged(sx.n), x=sx.words(4), y=sy.words(4)),
        paper_line("rigB", "ratio", study_agreement.like(ratio, 1.35), ratio=ratio.words(3)),
        paper_line("rigB", "placed", study_agreement.always(placed, len(b)), placed=placed, runs=len(b)),
        paper_line(
            "rigB", "seconds", study_agreement.Judged(len(b)), seconds=sum(study_agreement.local_and_global_s(b))
        ),
    ]
