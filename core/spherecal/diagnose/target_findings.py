"""Findings on single targets: one whose points contradict the rest wherever it is seen."""

from collections.abc import Collection

import numpy as np
from scipy.special import bdtrc

from spherecal.base.arrays import IntArray
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.diagnose.evidence import Evidence

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
    """Findings on targets of which more images contradict the rest than chance (binomial) would have, surest first."""
    target, images, wrong = _by_target(e, moved)
    if not len(target):
        return []
    usual = np.minimum(wrong, images * HALF)
    others = (usual.sum() - usual) / np.maximum(images.sum() - images, 1)
    share = np.maximum(LEAST_SHARE, others)
    # where few good images are left, one wrong image may have spoilt another that shows the target with it
    spoilt = (images - wrong < ENOUGH_GOOD).astype(np.int64)
    chance = bdtrc(wrong - 1 - spoilt, images - spoilt, share)
    named = np.flatnonzero((wrong >= MANY * images) & (wrong >= LEAST_WRONG) & (chance < FALSE_ALARM / len(target)))
    found = []
    for i in named[np.argsort(chance[named], kind="stable")]:
        shown = _shown_at(e, int(target[i]))
        values = {"wrong": wrong[i], "images": images[i], "shown": shown, "odds": _odds(float(chance[i]))}
        found.append(Finding("target-contradicts", "warning", values, (str(target[i]),)))
    return found


def _odds(chance: float) -> Phrase:
    return Phrase("odds-beyond") if chance < 1e-9 else Phrase("odds", {"times": 1 / chance})


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
    whole = e.image_counts(e.contradicting) > HALF * e.image_counts(e.candidates)  # reported as images
    keep = ~whole.ravel()[key[1]] & (dots >= LEAST_DOTS)
    target, of_target = np.unique(key[0][keep], return_inverse=True)
    of_target = of_target.reshape(-1)
    images = np.bincount(of_target, minlength=len(target))
    wrong = np.bincount(of_target, bad[keep], minlength=len(target)).astype(np.int64)
    # where nothing is left of a target, half of its images may be good ones that wrong ones took with them
    return target, images, np.where(wrong == images, images // 2, wrong)


def _shown_at(e: Evidence, target: int) -> list[str]:
    o = e.observations
    rows = e.contradicting & (o.target == target)
    pairs = dict.fromkeys(zip(o.camera[rows].tolist(), o.placement[rows].tolist(), strict=True))
    names = [f"{e.camera_ids[c]}@{o.placements[t]}" for c, t in pairs]
    return [*names[:4], *(["..."] if len(names) > 4 else [])]
