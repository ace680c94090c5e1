"""Files that other programs wrote of known cameras: what is read is what was put in."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from spherecal.geometry.camera import is_fisheye
from spherecal_documents.export.import_rig import import_rig
from tests.documents.test_strangers_files import metashape

FOLDER = Path(__file__).parents[1] / "data" / "other_programs"
# camera -> focal lengths and centre (px), distortion in OpenCV's order, Rodrigues vector and mm, world to camera
LENS, WIDE = (812.4, 809.7, 655.1, 498.3), (420.2, 421.5, 631.0, 505.2)
FLAT = (-0.05, 0.01, 0.0002, 0.0001)
CAMERAS = {
    "left": (LENS, (-0.41, 0.23, 0.0011, -0.0007, -0.08), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "top_to_floor": (LENS, FLAT, (0.12, -0.6, 0.03), (-731.2, 14.5, 220.9)),
    "wide": (WIDE, (0.031, -0.012, 0.006, -0.0015), (-0.2, 1.9, -0.4), (-1502.7, -88.1, 2100.4)),
    "right": (LENS, (8.1, 3.2, 0.0003, -0.0004, 0.11, 8.4, 5.1, 0.62), (0.5, -2.2, 0.9), (800.1, 60.3, 2400.8)),
}
# file -> format, unit, its cameras in its order under their names there, what it leaves out, coefficients it keeps
NUMBERS = {"11": "right", "2": "wide", "5": "left", "1": "top_to_floor"}
FILES = {
    "aniposelib.toml": ("anipose", "mm", ["right", "top_to_floor", "wide", "left"], {}, 8),
    "caliscope.toml": ("caliscope", None, list(NUMBERS), {"0": "is not calibrated"}, 8),
    "multical.json": ("multical", "m", ["left", "top_to_floor", "wide"], {"right": "has no pose"}, 8),
    "pose2sim.toml": ("anipose", None, ["right", "left", "top_to_floor"], {}, 4),
    "kalibr.yaml": ("kalibr", None, ["left", "top_to_floor", "wide"], {}, 4),
}


@pytest.mark.parametrize("name", FILES)
def test_what_was_put_in_is_read(name: str) -> None:
    form, unit, ids, left_out, kept = FILES[name]
    done = import_rig(FOLDER / name, form, unit)
    assert [camera.id for camera in done.rig] == ids and done.left_out == left_out and not done.warnings
    first = done.rig.cameras[0]
    turn_0, shift_0 = pose(NUMBERS.get(first.id, first.id))
    for camera in done.rig:
        own = NUMBERS.get(camera.id, camera.id)
        focal, distortion, *_ = CAMERAS[own]
        if name == "pose2sim.toml" and own == "right":
            distortion = FLAT  # it has no more than four
        assert is_fisheye(camera.intrinsics) == (own == "wide") and camera.image_size == (1280, 1024)
        np.testing.assert_allclose(camera.intrinsics[:4], focal, atol=1e-9)
        np.testing.assert_allclose(camera.intrinsics[4:][: len(distortion[:kept])], distortion[:kept], atol=1e-9)
        turn, shift = pose(own)
        relative = turn @ turn_0.T
        np.testing.assert_allclose(camera.rotation @ first.rotation.T, relative, atol=1e-9)
        apart = camera.rotation @ (first.centre_mm - camera.centre_mm)
        np.testing.assert_allclose(apart, shift - relative @ shift_0, atol=1e-6)


def pose(name: str) -> tuple[np.ndarray, np.ndarray]:
    """World to camera: rotation (3, 3), translation (3,) mm."""
    _, _, rotation, translation = CAMERAS[name]
    return cv2.Rodrigues(np.array(rotation))[0], np.array(translation)


def test_metashapes_camera_without_a_pose_of_its_own(tmp_path: Path) -> None:
    """In a multi-camera system only the master camera has a transform."""
    path = metashape(cameras='{}<camera id="2" sensor_id="0" master_id="0" label="C2"/>')(tmp_path)
    assert import_rig(path, "metashape").left_out == {"C2": "has no pose of its own, only one from camera 0"}
