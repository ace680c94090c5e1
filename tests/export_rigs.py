"""Rigs to export: cameras around a volume, with lenses of every number of coefficients."""

from collections.abc import Sequence

import numpy as np

from spherecal.data.rig import Quality, Rig, RigCamera, RigScale
from spherecal.geometry.rotation import exp_rotation

# OpenCV's order k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4; the sizes are those of machine-vision lenses of 6 to 12 mm
LENSES = {
    4: (-0.11, 0.09, 3e-4, -5e-4),
    5: (-0.11, 0.09, 3e-4, -5e-4, -0.02),
    8: (-0.11, 0.09, 3e-4, -5e-4, -0.02, 2e-3, -3e-3, 1e-3),
    12: (-0.11, 0.09, 3e-4, -5e-4, -0.02, 2e-3, -3e-3, 1e-3, 4e-4, -2e-4, 6e-4, 1e-4),
}


def make_rig(coefficients: int, cameras: int = 12, seed: int = 1) -> Rig:
    """Cameras on a ring looking inwards, more than ten so that names sort badly; the reference is the fifth."""
    random = np.random.default_rng(seed)
    poses = [_pose(i, cameras, random) for i in range(cameras)]
    reference = 4 % cameras
    r0, t0 = poses[reference]
    made = []
    for i, (r, t) in enumerate(poses):
        f = 2318.0 * random.uniform(0.95, 1.05)
        lens = np.zeros(16)
        lens[:4] = f, f * 1.0007, 1031.5 + random.uniform(-20, 20), 771.5 + random.uniform(-20, 20)
        lens[4 : 4 + coefficients] = np.array(LENSES[coefficients]) * random.uniform(0.8, 1.2, coefficients)
        rotation, shift = (np.eye(3), np.zeros(3)) if i == reference else (r @ r0.T, t - r @ r0.T @ t0)
        made.append(RigCamera(f"C{i + 1}", f"50-{i}", (2064, 1544), lens, rotation, shift, 0.06, 900, None))
    quality = Quality(True, 0.06, 0.05, 1.0, ())
    return Rig(made[reference].id, tuple(made), RigScale("bar", 1e-5), quality, "ab" * 32)


def _pose(i: int, count: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    angle = 2 * np.pi * i / count
    centre = np.array([900 * np.cos(angle), 900 * np.sin(angle), random.uniform(-300, 300)])
    z = -centre / np.linalg.norm(centre)
    x = np.cross((0.0, 0.0, -1.0), z)
    x /= np.linalg.norm(x)
    rotation = exp_rotation(random.normal(0, 0.05, 3)) @ np.array([x, np.cross(z, x), z])
    return rotation, -rotation @ centre


def renamed(rig: Rig, names: Sequence[str]) -> Rig:
    """The same rig with other camera ids."""
    from dataclasses import replace

    cameras = tuple(replace(camera, id=name) for camera, name in zip(rig.cameras, names, strict=True))
    index = [camera.id for camera in rig.cameras].index(rig.reference_camera or "")
    return replace(rig, cameras=cameras, reference_camera=names[index])
