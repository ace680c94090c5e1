"""Edges of images where the lens deviates from the model: only the points left out by the gate show this."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from spherecal.base.arrays import FloatArray, IntArray
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
