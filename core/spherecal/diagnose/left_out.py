"""What only points left out by the gate show: edges of images where a lens deviates from its model, wrong targets."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.special import bdtrc

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.diagnose.evidence import Evidence
from spherecal.diagnose.image_findings import LEAST_POINTS, MOST_LEFT_OUT
from spherecal.geometry.camera import project_with_derivatives

# So much of the edge is left out. A fisheye lens in Brown's model lost the 20 outermost points of 791 by 5 to 18 px, so
# that a length with an end there was 1.9 mm off, 4.5 U.
MOST_OF_EDGE = 0.8


@dataclass(frozen=True)
class RejectedEdge:
    """A camera whose `points` beyond a radius were left out; `change` (k,) of its intrinsics leads towards them."""

    camera: int
    points: int
    radius_px: float
    change: FloatArray


def edge_findings(e: Evidence, moved: Collection[str]) -> list[Finding]:
    """The finding on cameras with a rejected edge."""
    edges = [edge for edge in rejected_edges(e) if e.camera_ids[edge.camera] not in moved]
    if not edges:
        return []
    worst = max(edges, key=lambda edge: edge.points)
    values = {"worst": e.camera_ids[worst.camera], "radius_px": worst.radius_px, "points": worst.points}
    return [Finding("lens-misfit", "warning", values, tuple(e.camera_ids[edge.camera] for edge in edges), kind="edge")]


def rejected_edges(e: Evidence) -> list[RejectedEdge]:
    """The rejected edges of all cameras, one a camera at most."""
    found = (_edge(e, int(c)) for c in np.flatnonzero(e.placed))
    return [edge for edge in found if edge is not None]


def _edge(e: Evidence, c: int) -> RejectedEdge | None:
    rows = np.flatnonzero(e.candidates & (e.observations.camera == c))
    radius = np.linalg.norm(e.observations.uv[rows] - e.solution.state.intrinsics[c, 2:4], axis=1)
    inwards = np.argsort(-radius, kind="stable")
    out = np.cumsum(e.contradicting[rows[inwards]])
    ends = np.flatnonzero(out >= MOST_OF_EDGE * np.arange(1, len(rows) + 1))
    if not len(ends) or out[ends[-1]] < LEAST_POINTS:
        return None
    edge = rows[inwards[: ends[-1] + 1]]
    edge = edge[e.contradicting[edge]]
    images = np.unique(e.observations.placement[edge])
    share = e.image_counts(e.contradicting)[images, c] / e.image_counts(e.candidates)[images, c]
    if (share >= MOST_LEFT_OUT).all():  # these images contradict the others as a whole
        return None
    return RejectedEdge(c, len(edge), float(radius[inwards[ends[-1]]]), _change(e, c, edge, rows[e.used[rows]]))


def _change(e: Evidence, c: int, edge: IntArray, used: IntArray) -> FloatArray:
    """The change (k,) of the estimated intrinsics that best explains the edge and leaves the rest as it is."""
    state, columns = e.solution.state, e.adjusted.problem.intrinsic_columns
    edge = edge[np.isfinite(e.residual_px[edge, 0])]
    rows = np.concatenate([edge, used])
    x = state.points[e.features.of_observation[rows]] @ state.rotation[c].T + state.translation[c]
    free = e.adjusted.problem.free_intrinsics[c, columns]
    if not free.any():  # the given lens is taken as it is
        return np.zeros(len(columns))
    design = project_with_derivatives(x, state.intrinsics[c])[2][:, :, columns] * free
    off = np.zeros((len(rows), 2))
    off[: len(edge)] = -e.residual_px[edge]
    weight = np.ones(len(rows))
    weight[len(edge) :] = np.sqrt(len(edge) / max(len(used), 1))  # the rest counts as much as the edge
    design, off = (design * weight[:, None, None]).reshape(-1, len(columns)), (off * weight[:, None]).ravel()
    size = np.maximum(np.linalg.norm(design, axis=0), 1e-12)
    return np.linalg.lstsq(design / size, off, rcond=None)[0] / size


# --- findings on single targets --------------------------------------------------------------------------------------

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
