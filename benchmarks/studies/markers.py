"""Markers: ArUco and AprilTag stickers on a ball against eight-dot targets of the same size, in rendered images."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.simulators.rendered_stickers import StickerCamera, camera_ring, sticker_ball, write_sticker_session
from benchmarks.studies.report import Report
from spherecal.calibrate import calibrate
from spherecal.data.rig import Rig
from spherecal.targets.family import make_target_set
from spherecal.targets.target_set import TargetSet
from spherecal_files.read_session import read_session
from spherecal_files.target_set_file import make_marker_set

COUNT, SIZE_MM, RADIUS_MM, DISTANCE_MM = 100, 28.0, 200.0, 1100.0
CAMERAS, PLACEMENTS, IMAGE, FOCAL_PX = 5, 4, (640, 512), 1050.0
SETS = ("dots8", "DICT_4X4_250", "DICT_5X5_100", "DICT_APRILTAG_36h11")
# A corner is less sharply defined than a dot's centre (two edges of a few ten pixels against a whole rim), and four
# points a target are half of eight.
GOAL_RATIO = 4.0


@dataclass(frozen=True)
class Figures:
    """What a set gave: verdict, rms px, observations, worst error of a camera's centre (mm) and turn (deg), scale ppm.

    `over_stated`: the largest error of a centre over its stated standard uncertainty (of the whole vector).
    """

    verdict: str
    rms_px: float
    observations: int
    centre_mm: float
    turn_deg: float
    scale_ppm: float
    over_stated: float


def target_set(name: str) -> TargetSet:
    """The targets of a name in `SETS`."""
    return make_target_set(COUNT, SIZE_MM) if name == "dots8" else make_marker_set(name, SIZE_MM, range(COUNT))


def measure(name: str, seed: int = 1) -> Figures:
    """Render, detect, calibrate, compare with the truth."""
    random = np.random.default_rng(seed)
    cameras = camera_ring(CAMERAS, IMAGE, FOCAL_PX, DISTANCE_MM, random)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session"
        write_sticker_session(path, sticker_ball(target_set(name), RADIUS_MM, random), cameras, PLACEMENTS, random)
        return compared(calibrate(read_session(path)).rig, cameras)


def compared(rig: Rig, cameras: list[StickerCamera]) -> Figures:
    """The calibration of a rendered session against its cameras."""
    assert len(rig.cameras) == len(cameras), rig.quality.findings
    truth = {camera.id: camera for camera in cameras}
    first = truth[str(rig.reference_camera)]
    centres, turns, expected = [], [], []
    for camera in rig.cameras:
        own = truth[camera.id]
        relative = own.rotation @ first.rotation.T
        expected.append(first.rotation @ (-own.rotation.T @ own.translation) + first.translation)
        centres.append(-camera.rotation.T @ camera.translation_mm)
        turns.append(np.degrees(np.arccos(np.clip((np.trace(camera.rotation @ relative.T) - 1) / 2, -1, 1))))
    found, true = np.array(centres), np.array(expected)
    scale = float((found * true).sum() / (true * true).sum())
    off = np.linalg.norm(found / scale - true, axis=1)
    stated = [
        error / np.linalg.norm(camera.sigma.centre_mm)
        for error, camera in zip(off, rig.cameras, strict=True)
        if camera.sigma is not None and np.linalg.norm(camera.sigma.centre_mm) > 0
    ]
    count = sum(camera.observations for camera in rig.cameras)
    assert rig.quality.rms_px is not None
    return Figures(
        rig.quality.verdict,
        rig.quality.rms_px,
        count,
        float(off.max()),
        float(max(turns)),
        1e6 * (scale - 1),
        float(max(stated)),
    )


def report(runs: int | None = None) -> Report:
    """The page: every set, the mean over the runs."""
    page = Report("Markers as targets", "python3 dev.py studies markers")
    seeds = range(1, (runs or 3) + 1)
    page.text(
        f"A ball of {2 * RADIUS_MM:g} mm with {COUNT} stickers of {SIZE_MM:g} mm (side of the black square; of the "
        f"sticker with eight dots) before {CAMERAS} cameras of {IMAGE[0]} x {IMAGE[1]} px, {PLACEMENTS} placements, "
        f"{len(seeds)} sets each. Errors are the largest of any camera, mean over the sets; the scale's is given apart."
    )
    rows, errors = [], {}
    for name in SETS:
        found = [measure(name, seed) for seed in seeds]
        errors[name] = float(np.mean([one.centre_mm for one in found]))
        rows.append(
            [
                name,
                ", ".join(sorted({one.verdict for one in found})),
                f"{np.mean([one.rms_px for one in found]):.3f}",
                f"{np.mean([one.observations for one in found]):.0f}",
                f"{errors[name]:.3f}",
                f"{np.mean([one.turn_deg for one in found]):.4f}",
                f"{np.sqrt(np.mean([one.scale_ppm**2 for one in found])):.0f}",
            ]
        )
    page.table(("targets", "verdict", "rms px", "points", "centre mm", "turn deg", "scale ppm (rms)"), rows)
    worst = max(errors[name] for name in SETS[1:]) / errors["dots8"]
    page.verdict(
        f"errors at most {GOAL_RATIO:g} times those of eight dots", worst <= GOAL_RATIO, f"at most {worst:.2f}"
    )
    return page
