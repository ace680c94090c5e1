"""What a result says, for the window: verdict, cameras worst first, findings and what they advise."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from PySide6.QtCore import QCoreApplication

from spherecal.arrays import BoolArray, FloatArray
from spherecal_gui.presenters.coverage import Level

translate = QCoreApplication.translate

ActionKind = Literal["add placement", "retake", "show camera", "look", "bench"]


@dataclass(frozen=True)
class VerdictText:
    """A verdict: the word and its colour first, then one sentence."""

    word: str
    level: Level
    sentence: str


@dataclass(frozen=True)
class CameraRow:
    """One camera in the table; None where it could not be placed."""

    camera: str
    rms_px: float | None
    observations: int
    left_out: int
    sd_centre_mm: float | None
    sd_turn_deg: float | None
    focal_px: float | None
    placed: bool


@dataclass(frozen=True, eq=False)
class CameraResiduals:
    """Observed places (n, 2) px, residuals (n, 2) px and whether they were used (n,), of one camera."""

    camera: str
    image_size: tuple[int, int]
    uv: FloatArray
    du_dv: FloatArray
    used: BoolArray


@dataclass(frozen=True)
class Advice:
    """A finding in words, and the button that does what it advises."""

    level: Level
    message: str
    hint: str
    action: ActionKind | None = None
    target: str = ""
    button: str = ""


def verdict(result: Any) -> VerdictText:
    """The verdict on a result."""
    quality, cameras = result.rig.quality, result.rig.cameras
    everything = len(result.camera_ids)
    if not cameras:
        return VerdictText(translate("Results", "FAILED"), "bad", translate("Results", "No camera could be placed."))
    told = translate("Results", "{placed} of {all} cameras placed; the images agree to {rms:.3f} px.").format(
        placed=len(cameras), all=everything, rms=quality.rms_px or float("nan")
    )
    if not quality.valid:
        return VerdictText(translate("Results", "NOT VALID"), "bad", told)
    if any(finding.severity == "warning" for finding in quality.findings):
        return VerdictText(translate("Results", "VALID, WITH WARNINGS"), "caution", told)
    return VerdictText(translate("Results", "VALID"), "good", told)


def bar_verdict(bars: Any) -> VerdictText:
    """The verdict of a verification."""
    errors = np.array([bar.error_mm for bar in bars.measured])
    told = ""
    if len(errors):
        told = translate("Verify", "{count} lengths, mean error {mean:+.3f} mm, largest {most:.3f} mm.").format(
            count=len(errors), mean=float(errors.mean()), most=float(np.abs(errors).max())
        )
    if bars.verdict == "consistent":
        return VerdictText(translate("Verify", "PASS"), "good", told)
    if bars.verdict == "inconsistent":
        return VerdictText(translate("Verify", "FAIL"), "bad", told)
    return VerdictText(translate("Verify", "NO DATA"), "caution", told)


def camera_rows(result: Any) -> list[CameraRow]:
    """All cameras, those that could not be placed and the largest rms first."""
    rows = []
    used = result.residuals.used
    for name in result.camera_ids:
        camera, own = result.rig.camera(name), result.residuals.rows_of.get(name, np.empty(0, np.int64))
        out = int((~used[own]).sum())
        if camera is None:
            rows.append(CameraRow(name, None, len(own), out, None, None, None, placed=False))
            continue
        sigma = camera.sigma
        rows.append(
            CameraRow(
                name, camera.rms_px, camera.observations, out,
                None if sigma is None else float(np.linalg.norm(sigma.centre_mm)),
                None if sigma is None else float(np.linalg.norm(sigma.rotation_deg)),
                float(camera.intrinsics[0]), placed=True,
            )
        )  # fmt: skip
    return sorted(rows, key=lambda row: (row.placed, -(row.rms_px or 0.0)))


def residuals_of(result: Any, camera: str) -> CameraResiduals | None:
    """The residuals of a placed camera."""
    placed = result.rig.camera(camera)
    rows = result.residuals.rows_of.get(camera)
    if placed is None or rows is None:
        return None
    table = result.residuals
    rows = rows[np.isfinite(table.predicted[rows]).all(axis=1) & np.isfinite(table.du_dv[rows]).all(axis=1)]
    du_dv = table.du_dv[rows]
    return CameraResiduals(camera, placed.image_size, table.predicted[rows] - du_dv, du_dv, table.used[rows])


_MORE = ("few-placements", "little-coverage", "weak-self-calibration", "two-view-points", "cameras-unlinked")
_BENCH = ("no-scale",)


def advice(result: Any, placements: tuple[str, ...]) -> list[Advice]:
    """The findings, errors first, each with what can be done at once."""
    levels: dict[str, Level] = {"error": "bad", "warning": "caution", "info": "none"}
    cameras = set(result.camera_ids)
    found = []
    for finding in result.rig.quality.findings:
        kind: ActionKind | None = None
        target, text = "", ""
        placed = next((name for name in finding.where if name in placements), None)
        seen = next((name for name in finding.where if name in cameras), None)
        if placed is not None and finding.severity != "info":
            kind, target = "retake", placed
            text = translate("Results", "Retake {name}").format(name=placed)
        elif finding.code in _MORE and finding.severity != "info":
            kind, text = "add placement", translate("Results", "Add a placement")
        elif finding.code in _BENCH:
            kind, text = "bench", translate("Results", "Go to the bench")
        elif seen is not None:
            kind, target = "show camera", seen
            text = translate("Results", "Show {name}").format(name=seen)
        found.append(Advice(levels[finding.severity], finding.message, finding.hint, kind, target, text))
    return found
