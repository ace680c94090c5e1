"""Findings on single targets: one whose points contradict the rest wherever it is seen."""

from collections.abc import Collection

import numpy as np
from scipy.stats import binom

from spherecal.arrays import IntArray
from spherecal.diagnose.evidence import Evidence
from spherecal.findings import Finding

# A target in an image counts as wrong when half of its dots there were left out; a rim with fewer dots does not count.
HALF, LEAST_DOTS, LEAST_WRONG = 0.5, 3, 2
ENOUGH_GOOD = 3
# Of single targets in single images few go wrong by chance: at least this share is assumed, and the share among all
# targets where that is larger (5 % in bad recordings).
LEAST_SHARE = 0.0005
# So many of a target's images must be wrong (of two stickers alike one is believed, which may be the one that more
# images show), and that by chance in no more than this share of recordings.
MANY, FALSE_ALARM = 0.1, 0.01


def wrong_targets(e: Evidence, moved: Collection[str]) -> list[Finding]:
    """Targets many of whose images contradict the rest, the surest first; images of moved cameras do not count."""
    target, images, wrong = _by_target(e, moved)
    if not len(target):
        return []
    usual = np.minimum(wrong, images * HALF)
    others = (usual.sum() - usual) / np.maximum(images.sum() - images, 1)
    share = np.maximum(LEAST_SHARE, others)
    # where few good images are left, one wrong image may have spoilt another that shows the target with it
    spoilt = (images - wrong < ENOUGH_GOOD).astype(np.int64)
    chance = binom.sf(wrong - 1 - spoilt, images - spoilt, share)
    named = np.flatnonzero((wrong >= MANY * images) & (wrong >= LEAST_WRONG) & (chance < FALSE_ALARM / len(target)))
    found = []
    for i in named[np.argsort(chance[named], kind="stable")]:
        where = _where(e, int(target[i]))
        found.append(
            Finding(
                "warning", "target-contradicts",
                f"Target {target[i]} contradicts the rest in {wrong[i]} of its {images[i]} images ({where}); by chance "
                f"that would happen once in {_times(float(chance[i]))}.",
                "Is there a second sticker with this number, is it loose, or is it decoded wrongly? Its points are "
                "left out where they contradict; look at it, and take one of two alike off the ball.",
                (str(target[i]),),
            )
        )  # fmt: skip
    return found


def _times(chance: float) -> str:
    return "more than a billion" if chance < 1e-9 else f"{1 / chance:,.0f}"


def _by_target(e: Evidence, moved: Collection[str]) -> tuple[IntArray, IntArray, IntArray]:
    """Targets (t,), in how many images each could be checked, and in how many it contradicts."""
    o = e.observations
    judged = e.candidates & (o.placement < len(e.session.placements))
    rows = np.flatnonzero(judged & ~np.isin(o.camera, [e.camera_ids.index(name) for name in moved]))
    image = o.placement[rows] * len(o.cameras) + o.camera[rows]
    key, of = np.unique(np.stack([o.target[rows], image]), axis=1, return_inverse=True)
    of = of.reshape(-1)
    dots = np.bincount(of)
    bad = np.bincount(of, e.contradicting[rows]) >= HALF * dots
    whole = e.image_counts(e.contradicting) > HALF * e.image_counts(e.candidates)  # told by the image, not by targets
    keep = ~whole.ravel()[key[1]] & (dots >= LEAST_DOTS)
    target, of_target = np.unique(key[0][keep], return_inverse=True)
    of_target = of_target.reshape(-1)
    images = np.bincount(of_target, minlength=len(target))
    wrong = np.bincount(of_target, bad[keep], minlength=len(target)).astype(np.int64)
    # where nothing is left of a target, half of its images may be good ones that wrong ones took with them
    return target, images, np.where(wrong == images, images // 2, wrong)


def _where(e: Evidence, target: int) -> str:
    o = e.observations
    rows = e.contradicting & (o.target == target)
    pairs = dict.fromkeys(zip(o.camera[rows].tolist(), o.placement[rows].tolist(), strict=True))
    names = [f"{e.camera_ids[c]}@{o.placements[t]}" for c, t in pairs]
    return ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
