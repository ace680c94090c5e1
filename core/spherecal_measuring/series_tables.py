"""Measured sets as rows of tables and as JSON: the same names and units in the series' files and in the stream."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from spherecal.files.json_file import finite
from spherecal_measuring.measured_sets import BodyPose, Health, MeasuredSet

Row = tuple[object, ...]  # numbers, texts, None

_SET = ("set", "id", "time_s")
_PAIRS = [(i, j) for i in range(6) for j in range(i, 6)]
COLUMNS: dict[str, tuple[str, ...]] = {
    "points": (
        *_SET, "target", "point", "x_mm", "y_mm", "z_mm", "sigma_x_mm", "sigma_y_mm", "sigma_z_mm",
        "cov_xy_mm2", "cov_xz_mm2", "cov_yz_mm2", "views", "dots", "speed_mm_s",
    ),
    "values": (*_SET, "kind", "name", "value", "unit", "u", "nominal", "deviation", "u_deviation"),
    "bodies": (
        *_SET, "body", "x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz", "points", "points_left_out", "rms_mm",
        *(f"cov_{i + 1}{j + 1}" for i, j in _PAIRS),
    ),
    "cameras": (*_SET, "camera", "observations", "left_out", "rms_px"),
    "contradictions": (*_SET, "target", "camera", "views", "of"),
}  # fmt: skip
WHOLE_NUMBERS = frozenset({"set", "target", "views", "dots", "points", "observations", "left_out", "of"})
TEXTS = frozenset({"id", "point", "kind", "name", "unit", "body", "points_left_out", "camera"})


def rows_of(measured: MeasuredSet) -> Iterator[tuple[str, Row]]:
    """The rows of all tables for one set: (table, row)."""
    head = (measured.number, measured.id, measured.time_s)
    sigma, covariance = measured.sigma_mm, measured.covariance_mm2
    for i, name in enumerate(measured.names):
        c = covariance[i]
        yield (
            "points",
            (
                *head,
                name.target,
                name.point,
                *measured.points_mm[i].tolist(),
                *sigma[i].tolist(),
                *(float(c[j]) for j in ((0, 1), (0, 2), (1, 2))),
                int(measured.views[i]),
                int(measured.dots[i]),
                float(measured.speed_mm_s[i]),
            ),
        )
    for v in measured.values:
        yield "values", (*head, v.kind, v.name, v.value, v.unit, v.u, v.nominal, v.deviation, v.u_deviation)
    for body in measured.bodies:
        yield (
            "bodies",
            (
                *head,
                body.name,
                *body.translation_mm.tolist(),
                *quaternion(body).tolist(),
                body.points,
                " ".join(map(str, body.left_out)),
                body.rms_mm,
                *(float(body.covariance[i, j]) for i, j in _PAIRS),
            ),
        )
    for camera in measured.cameras:
        yield "cameras", (*head, camera.camera, camera.observations, camera.left_out, camera.rms_px)
    for c in measured.contradictions:
        yield "contradictions", (*head, c.target, c.camera or "", c.views, c.of)


def quaternion(body: BodyPose) -> np.ndarray:
    """The rotation from the body's frame to the world as w, x, y, z with w >= 0, (4,)."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(body.rotation).as_quat(canonical=True)
    return np.array([w, x, y, z])


def set_json(measured: MeasuredSet, health: Health | None = None) -> dict[str, Any]:
    """One set as the stream has it."""
    upper = np.triu_indices(3)
    document: dict[str, Any] = {
        "set": measured.number,
        "id": measured.id,
        "time_s": finite(measured.time_s),
        "points": [
            {
                "target": name.target, "point": name.point, "xyz_mm": finite(measured.points_mm[i]),
                "covariance_mm2": finite(measured.covariance_mm2[i][upper]), "views": int(measured.views[i]),
                "dots": int(measured.dots[i]), "speed_mm_s": finite(measured.speed_mm_s[i]),
            }
            for i, name in enumerate(measured.names)
        ],
        "values": [
            {
                "kind": v.kind, "name": v.name, "value": v.value, "unit": v.unit, "u": v.u, "nominal": v.nominal,
                "deviation": v.deviation, "u_deviation": v.u_deviation,
            }
            for v in measured.values
        ],
        "bodies": [
            {
                "name": b.name, "rotation": finite(b.rotation), "translation_mm": finite(b.translation_mm),
                "covariance": finite(b.covariance), "points": b.points, "left_out": [str(n) for n in b.left_out],
                "rms_mm": b.rms_mm,
            }
            for b in measured.bodies
        ],
        "missing": [{"name": name, "reason": reason} for name, reason in measured.missing],
        "contradictions": [
            {"target": c.target, "camera": c.camera, "views": c.views, "of": c.of} for c in measured.contradictions
        ],
        "cameras": [
            {"id": c.camera, "observations": c.observations, "left_out": c.left_out, "rms_px": finite(c.rms_px)}
            for c in measured.cameras
        ],
        "skew_s": finite(measured.skew_s),
        "latency_s": finite(measured.latency_s),
    }  # fmt: skip
    if health is not None:
        document["moved"] = list(health.moved)
    return document


def health_json(health: Health) -> dict[str, Any]:
    """The rig's health as series.json has it."""
    return {
        "sets": health.sets,
        "cameras": [
            {
                "id": one.camera,
                "observations": one.observations,
                "rms_px": finite(one.rms_px),
                "calibrated_rms_px": finite(one.calibrated_rms_px),
                "left_out": one.left_out,
                "moved": one.moved is not None,
                "named_at_set": one.named_at,
                "move_px": None if one.moved is None else finite(one.moved.move_px),
            }
            for one in health.cameras
        ],
    }
