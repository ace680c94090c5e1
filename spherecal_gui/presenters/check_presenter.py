"""A check of the calibration in use, for the window: one word, who moved, each camera's numbers."""

from typing import TYPE_CHECKING

import numpy as np

from spherecal_gui import languages
from spherecal_gui.coverage import Level
from spherecal_gui.languages import Cell, figure, translate, word
from spherecal_gui.presenters.results_presenter import VerdictText

if TYPE_CHECKING:  # imports scipy and OpenCV
    from spherecal_rigs.check_rig import Check

_LEVELS: dict[str, Level] = {"ok": "good", "watch": "caution", "recalibrate": "bad"}


def check_verdict(found: "Check") -> VerdictText:
    """The verdict of a check (check.check)."""
    return VerdictText(word("checks", found.verdict), _LEVELS[found.verdict], _sentence(found))


def repaired_verdict(after: "Check", in_use: bool) -> VerdictText:
    """The verdict once the cameras that moved are recalibrated: by the check after it, in use or not yet."""
    message = check_verdict(after)
    if in_use:
        return message
    word, unused = translate("Check", "REPAIRED"), translate("Check", "Not in use yet.")
    return VerdictText(word, "caution", unused if after.verdict == "ok" else f"{unused} {message.sentence}")


def _sentence(found: "Check") -> str:
    if found.verdict == "ok":
        if not found.cameras:
            return translate(
                "Check",
                "The measured lengths of the bars agree with their certificates; single cameras were not checked.",
            )
        text = translate("Check", "The rig is as it was calibrated: {count} cameras agree with one another.")
        return text.format(count=len(found.cameras))
    parts = []
    moved = {one.test.id: one.test.move_px for one in found.cameras if one.test.moved}
    noisy = [one.test.id for one in found.cameras if one.verdict != "ok" and not one.test.moved]
    if len(moved) == 1:
        text = translate("Check", "Only {camera} moved ({px} px). Tighten its mount.")
        parts += [text.format(camera=name, px=f"{px:.{0 if px >= 2 else 1}f}") for name, px in moved.items()]
    elif moved:
        parts.append(translate("Check", "Moved: {cameras}.").format(cameras=languages.listed(moved)))
    if noisy:
        parts.append(translate("Check", "Less sharp than before: {cameras}.").format(cameras=languages.listed(noisy)))
    parts += [f"{one.words('title', languages.now())}." for one in found.findings if one.severity != "info"]
    return " ".join(dict.fromkeys(parts))


def check_cells(found: "Check") -> list[list[tuple[str, Cell, str]]]:
    """The cameras, worst first: state, image, point and pose by which each is off, residuals now and then."""
    rows = []
    for one in found.cameras:
        test, level = one.test, _LEVELS[one.verdict]
        words = [(text, text, level) for text in (test.id, word("checked", one.verdict))]
        moved = figure(float(test.move_px), 3), figure(float(test.point_mm), 3, level)
        shift, turn = float(np.linalg.norm(test.shift_mm)), float(np.degrees(np.linalg.norm(test.turn_rad)))
        rms = figure(float(test.rms_px), 3), figure(one.before_px, 3)
        rows.append([*words, *moved, figure(shift, 3), figure(turn, 4), *rms])
    return rows


def repaired_text(found: "Check", after: "Check", in_use: bool) -> tuple[str, Level]:
    """What a repair has done: by how much a point was off before and after, worst camera of those that moved."""
    moved = set(found.to_repair)
    before = max((float(one.test.point_mm) for one in found.cameras if one.test.id in moved), default=0.0)
    now = max((float(one.test.point_mm) for one in after.cameras if one.test.id in moved), default=0.0)
    names = languages.listed(sorted(moved))
    text = translate("Check", "{cameras} repaired: a point was off by {before:.3f} mm, now by {now:.3f} mm.")
    if in_use:
        text = translate("Check", "{cameras} repaired and in use: {before:.3f} mm before, {now:.3f} mm now.")
    return text.format(cameras=names, before=before, now=now), "good" if after.verdict == "ok" else "caution"


def check_notes(found: "Check") -> list[str]:
    """What else is to be known: the tolerance, cameras that were not tested, the balls."""
    notes = []
    if found.tolerance_mm is not None:
        text = translate("Check", "A camera must be recalibrated where a point is off by more than {mm:.3f} mm.")
        notes.append(text.format(mm=found.tolerance_mm))
    if found.untested:
        text = translate("Check", "Not checked, since they saw too little: {cameras}.")
        notes.append(text.format(cameras=languages.listed(found.untested)))
    for ball in found.balls:
        text = translate("Check", "The ball is measured {ppm:+.0f} ± {sd:.0f} ppm against the calibration.")
        notes.append(text.format(ppm=ball.scale_ppm, sd=ball.scale_sd_ppm))
    return notes
