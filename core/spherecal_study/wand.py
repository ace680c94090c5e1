"""A waved bar before ten cameras: errors against the truth beside their bound."""

from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.data.rig import Calibration
from spherecal.geometry.transform import fit_similarity
from spherecal_sim.simulated_boards import SimulatedRecording
from spherecal_study.executor import Trial
from spherecal_study.study_agreement import Judged, Results, always, estimate, local_and_global_s, mean
from spherecal_study.study_page import Document, Options, PaperComparison, paper_line

TITLE = "A waved bar before ten cameras (1-D method)"
RUNS = 3
_FRAMES = (300, 1000, 3000)


def trials(options: Options) -> list[Trial]:
    """Calibrations with 300, 1,000 and 3,000 frames of a bar of 300 mm in rig A."""
    plain = {name: value for name, value in options.plain("rigA").items() if name != "paths"}
    return [Trial("wand", {**plain, "seed": s, "frames": n}) for n in _FRAMES for s in options.seeds]


def errors_and_bounds(recording: SimulatedRecording, calibration: Calibration, sigma_px: float) -> dict[str, Any]:
    """Rms errors against the truth after a similarity over the marks (mm, focal lengths px, scale relative).

    The bound of each is Cramer and Rao's: the covariance of the adjustment at the noise that was simulated.
    """
    f = calibration.features
    truth = recording.points_mm[f.placement, f.target - 1]
    seen = (calibration.views > 0) & np.isfinite(calibration.points_mm[:, 0])
    fit = fit_similarity(calibration.points_mm[seen], truth[seen])
    quality = calibration.rig.quality
    assert quality.sigma0 is not None and calibration.rig.scale.relative_uncertainty is not None
    known = sigma_px / quality.sigma0
    true = {camera.id: camera for camera in recording.cameras}
    pairs = [(camera, true[camera.id], camera.sigma) for camera in calibration.rig.cameras]
    centres = [fit.apply(c.centre_mm[None])[0] - t.centre_mm for c, t, _ in pairs]
    return {
        "frames_measured": len(np.unique(f.placement[seen])),
        "marks_measured": int(seen.sum()),
        "points_mm": _rms(fit.apply(calibration.points_mm[seen]) - truth[seen]),
        "points_bound_mm": known * _rms(calibration.points_sigma_mm[seen]),
        "centres_mm": _rms(np.array(centres)),
        "centres_bound_mm": known * _rms(np.array([s.centre_mm for _, _, s in pairs if s is not None])),
        "focal_px": float(np.sqrt(np.mean([(c.intrinsics[:2] - t.intrinsics[:2]) ** 2 for c, t, _ in pairs]))),
        "focal_bound_px": known * float(np.sqrt(np.mean([s.intrinsics[:2] ** 2 for *_, s in pairs if s is not None]))),
        "scale": abs(fit.scale - 1),
        "scale_bound": calibration.rig.scale.relative_uncertainty,
    }


def _rms(vectors: FloatArray) -> float:
    """Root mean square length of vectors (n,3)."""
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def page(listed: list[Trial], results: Results, options: Options) -> Document:
    """The study's page: errors beside their bounds, over the number of frames, and the table paper / ours."""
    document = options.begin(TITLE, "bar", rig=options.rig_words("rigA"))
    by_frames = {n: [r for t, r in zip(listed, results, strict=True) if t.settings["frames"] == n] for n in _FRAMES}

    def rms(name: str) -> dict[int, float]:
        return {n: float(np.sqrt(mean([r[name] ** 2 for r in some]))) for n, some in by_frames.items()}

    titles = {
        "points_mm": "marks: error", "points_bound_mm": "marks: bound",
        "centres_mm": "camera centres: error", "centres_bound_mm": "camera centres: bound",
    }  # fmt: skip
    document.curves({title: rms(name) for name, title in titles.items()}, "frames", "rms, mm", log=True)
    columns = [rms(name) for name in (*titles, "focal_px", "focal_bound_px")]
    document.table(
        ("frames", "marks mm", "bound mm", "centres mm", "bound mm", "focal px", "bound px", "CPU s"),
        [[n, *(own[n] for own in columns), sum(local_and_global_s(by_frames[n]))] for n in _FRAMES],
    )
    document.caption(
        "Marks keep the noise of the few images that show them, however many frames there are; cameras get better with "
        "all of them. CPU s: processor seconds on one core from observations to the result, covariance included."
    )
    return document.against_paper(_compared(by_frames[_FRAMES[-1]], options.cameras("rigA")), "bar")


def _compared(most: Results, cameras: int) -> list[PaperComparison]:
    ratio = estimate([r["points_mm"] / r["points_bound_mm"] for r in most])
    off = estimate([r["scale"] for r in most])
    stated = estimate([r["scale_bound"] for r in most])
    placed = sum(r["cameras"] == cameras and r["valid"] for r in most)
    return [
        paper_line("bar", "marks", Judged(ratio.n), frames=_FRAMES[-1], cameras=cameras, ratio=ratio.words(4)),
        paper_line("bar", "placed", always(placed, len(most)), cameras=cameras, placed=placed, runs=len(most)),
        paper_line("bar", "scale", Judged(off.n), off=off.times(1e6).words(1), stated=stated.times(1e6).words(1)),
        paper_line("bar", "seconds", Judged(len(most)), seconds=sum(local_and_global_s(most))),
    ]
