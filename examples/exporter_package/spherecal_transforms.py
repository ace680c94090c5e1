"""`spherecal export RESULT --to transforms -o transforms.json`: poses as radiance-field programs read them.

Camera to world, x right, y up, looking along -z, in metres; OpenCV's k1 k2 p1 p2.
"""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

import spherecal

FLIP = np.diag([1.0, -1.0, -1.0])


def write(rig: spherecal.FileRig) -> Mapping[str, str]:
    """The one file's text, under the name ""."""
    frames = []
    for camera in rig.cameras:
        pose = camera.placed.inverse()
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose.rotation @ FLIP, pose.translation
        fu, fv, u0, v0, k1, k2, p1, p2 = camera.intrinsics[:8].tolist()
        frames.append(
            {
                "file_path": f"{camera.id}.png",
                "w": camera.size[0],
                "h": camera.size[1],
                "fl_x": fu,
                "fl_y": fv,
                "cx": u0 + 0.5,
                "cy": v0 + 0.5,
                "k1": k1,
                "k2": k2,
                "p1": p1,
                "p2": p2,
                "transform_matrix": matrix.tolist(),
            }
        )
    return {"": json.dumps({"camera_model": "OPENCV", "frames": frames}, indent=1)}


def read(path: Path) -> list[spherecal.FileCamera]:
    """The cameras again; what they see is compared with the rig after every export."""
    cameras = []
    for frame in json.loads(path.read_text(encoding="utf-8"))["frames"]:
        matrix = np.array(frame["transform_matrix"])
        lens = np.zeros(16)
        lens[:8] = [frame[key] for key in ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2")]
        lens[2:4] -= 0.5
        pose = spherecal.Pose(matrix[:3, :3] @ FLIP, matrix[:3, 3]).inverse()
        cameras.append(spherecal.FileCamera(Path(frame["file_path"]).stem, (frame["w"], frame["h"]), lens, pose))
    return cameras


FORMAT = spherecal.Format("transforms", "transforms.json", 4, ("m",), write, read)
