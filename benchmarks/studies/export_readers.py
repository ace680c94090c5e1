"""Exports read by other programs: each function reads a file with its program and projects points with it.

Also a script, so that a reader that needs another Python or older packages can run there:
`PYTHON export_readers.py READER PATH POINTS.json` prints the projections as JSON. It imports nothing of SphereCal.
"""

import importlib
import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np

# camera id -> points (n, 3) in the world, in the file's unit; camera id -> image points (n, 2), (0, 0) the centre of
# the first pixel
Points = dict[str, np.ndarray]


def _opencv_project(points, r_world_to_cam, t, k, d):
    import cv2

    vector = cv2.Rodrigues(np.asarray(r_world_to_cam, dtype=float))[0]
    return cv2.projectPoints(
        np.asarray(points, dtype=float).reshape(-1, 1, 3),
        vector,
        np.asarray(t, dtype=float).reshape(3, 1),
        np.asarray(k, dtype=float),
        np.asarray(d, dtype=float),
    )[0].reshape(-1, 2)


def opencv(path: Path, points: Points) -> Points:
    """cv2.FileStorage and cv2.projectPoints."""
    import cv2

    found = {}
    for file in sorted(path.glob("*.yml")):
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
        name = storage.getNode("camera_name").string()
        nodes = ("R", "T", "camera_matrix", "distortion_coefficients")
        found[name] = _opencv_project(points[name], *(storage.getNode(n).mat() for n in nodes))
    return found


def mc_calib(path: Path, points: Points) -> Points:
    """cv2.FileStorage, with poses camera to world as MC-Calib's README says."""
    import cv2

    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    found = {}
    for i in range(int(storage.getNode("nb_camera").real())):
        node = storage.getNode(f"camera_{i}")
        world_to_cam = np.linalg.inv(node.getNode("camera_pose_matrix").mat())
        k, d = (node.getNode(n).mat() for n in ("camera_matrix", "distortion_vector"))
        assert d.size == 5
        found[f"camera_{i}"] = _opencv_project(points[f"camera_{i}"], world_to_cam[:3, :3], world_to_cam[:3, 3], k, d)
    return found


def ros(path: Path, points: Points) -> Points:
    """PyYAML and OpenCV, with REP 104's coefficients; a static transform takes the child's points to the parent."""
    import yaml
    from scipy.spatial.transform import Rotation

    found = {}
    for tf in yaml.safe_load((path / "static_transforms.yaml").read_text())["transforms"]:
        name = tf["child_frame_id"].removesuffix("_optical_frame")
        turn, shift = tf["transform"]["rotation"], tf["transform"]["translation"]
        r = Rotation.from_quat([turn[a] for a in "xyzw"]).as_matrix()
        t = np.array([shift[a] for a in "xyz"])
        info = yaml.safe_load((path / f"{name}.yaml").read_text())
        d = info["distortion_coefficients"]["data"]
        assert len(d) == {"plumb_bob": 5, "rational_polynomial": 8}[info["distortion_model"]]
        k = np.reshape(info["camera_matrix"]["data"], (3, 3))
        found[name] = _opencv_project(points[name], r.T, -r.T @ t, k, d)
    return found


def kalibr(path: Path, points: Points) -> Points:
    """PyYAML and OpenCV, with the chain as Kalibr's wiki says: T_cn_cnm1 takes cam n-1's points to cam n."""
    import yaml

    found, t_cam_world = {}, np.eye(4)
    for i in range(len(chain := yaml.safe_load(path.read_text()))):
        cam = chain[f"cam{i}"]
        t_cam_world = np.array(cam.get("T_cn_cnm1", np.eye(4))) @ t_cam_world
        fu, fv, pu, pv = cam["intrinsics"]
        k = [[fu, 0, pu], [0, fv, pv], [0, 0, 1]]
        name = cam["rostopic"].split("/")[1]
        found[name] = _opencv_project(
            points[name], t_cam_world[:3, :3], t_cam_world[:3, 3], k, cam["distortion_coeffs"]
        )
    return found


def pycolmap(path: Path, points: Points) -> Points:
    """pycolmap, through the rig: rig_from_world of the frame, then sensor_from_rig."""
    module = importlib.import_module("pycolmap")
    reconstruction = module.Reconstruction()
    reconstruction.read_text(str(path))
    (rig,), (frame,) = reconstruction.rigs.values(), reconstruction.frames.values()
    found = {}
    for image in reconstruction.images.values():
        name, camera = image.name.split("/")[0], reconstruction.cameras[image.camera_id]
        direct = np.array([image.cam_from_world() * p for p in points[name]])
        sensor = camera.sensor_id
        step = module.Rigid3d() if rig.is_ref_sensor(sensor) else rig.sensor_from_rig(sensor)
        through_rig = np.array([step * (frame.rig_from_world * p) for p in points[name]])
        assert np.abs(direct - through_rig).max() < 1e-9 * np.abs(direct).max()
        found[name] = camera.img_from_cam(through_rig) - 0.5  # COLMAP: (0.5, 0.5) is the first pixel's centre
    return found


def metashape(path: Path, points: Points) -> Points:
    """The formulas of Metashape's manual, written out; no program that reads these files runs without Agisoft's own."""
    from xml.etree import ElementTree

    chunk = ElementTree.parse(path).getroot().find("chunk")
    assert chunk is not None
    sensors = {s.get("id"): s for s in chunk.iterfind("sensors/sensor")}
    found = {}
    for camera in chunk.iterfind("cameras/camera"):
        name, sensor = camera.get("label", ""), sensors[camera.get("sensor_id")]
        resolution = sensor.find("resolution")
        assert resolution is not None
        c = {e.tag: float(e.text or "nan") for e in sensor.iterfind("calibration/*") if e.tag != "resolution"}
        cam_to_chunk = np.array((camera.findtext("transform") or "").split(), dtype=float).reshape(4, 4)
        p = (np.column_stack([points[name], np.ones(len(points[name]))]) @ np.linalg.inv(cam_to_chunk).T)[:, :3]
        x, y = p[:, 0] / p[:, 2], p[:, 1] / p[:, 2]
        r2 = x**2 + y**2
        radial = 1 + c["k1"] * r2 + c["k2"] * r2**2 + c["k3"] * r2**3 + c.get("k4", 0) * r2**4
        xd = x * radial + c["p1"] * (r2 + 2 * x**2) + 2 * c["p2"] * x * y
        yd = y * radial + c["p2"] * (r2 + 2 * y**2) + 2 * c["p1"] * x * y
        u = float(resolution.get("width", 0)) / 2 + c["cx"] + xd * c["f"] + xd * c.get("b1", 0) + yd * c.get("b2", 0)
        v = float(resolution.get("height", 0)) / 2 + c["cy"] + yd * c["f"]
        found[name] = np.column_stack([u, v]) - 0.5  # Metashape: the image spans 0 .. width
    return found


def aniposelib(path: Path, points: Points) -> Points:
    """aniposelib's CameraGroup."""
    group = importlib.import_module("aniposelib.cameras").CameraGroup

    return {c.get_name(): c.project(points[c.get_name()]).reshape(-1, 2) for c in group.load(str(path)).cameras}


def pose2sim(path: Path, points: Points) -> Points:
    """Pose2Sim's reader of calibration files, and OpenCV as Pose2Sim uses it; cameras in the file's order."""
    retrieve_calib_params = importlib.import_module("Pose2Sim.common").retrieve_calib_params

    c = retrieve_calib_params(path)
    return {
        name: _opencv_project(points[name], c["R_mat"][i], c["T"][i], c["K"][i], c["dist"][i])
        for i, name in enumerate(points)
    }


def caliscope(path: Path, points: Points) -> Points:
    """caliscope's CameraArray, and OpenCV as caliscope uses it."""
    group = importlib.import_module("caliscope.cameras.camera_array").CameraArray

    cameras = group.from_toml(path).cameras
    return {
        str(i): _opencv_project(points[str(i)], c.rotation, c.translation, c.matrix, c.distortions)
        for i, c in cameras.items()
    }


def multical(path: Path, points: Points) -> Points:
    """multical's import_calib (poses world to camera) and Camera.project."""
    load_calibration = importlib.import_module("multical.io.import_calib").load_calibration

    rig = load_calibration(str(path))
    found = {}
    for name, camera in rig.cameras.items():
        pose = rig.camera_poses[name]
        found[name] = camera.project(points[name] @ pose[:3, :3].T + pose[:3, 3])
    return found


def mrcal(path: Path, points: Points) -> Points:
    """mrcal's cameramodel and mrcal.project."""
    module = importlib.import_module("mrcal")
    found = {}
    for file in sorted(path.glob("*.cameramodel")):
        model, name = module.cameramodel(str(file)), file.name.removesuffix(".cameramodel")
        pose = (getattr(model, "rt_cam_ref", None) or model.extrinsics_rt_fromref)()
        found[name] = module.project(module.transform_point_rt(pose, points[name]), *model.intrinsics())
    return found


def csv_table(path: Path, points: Points) -> Points:
    """Python's csv and OpenCV, by the column names."""
    import csv

    found = {}
    for row in csv.DictReader(path.open(encoding="utf-8")):
        v = {key: float(value) for key, value in row.items() if key not in ("camera", "serial")}
        r = [[v[f"r{i}{j}"] for j in (1, 2, 3)] for i in (1, 2, 3)]
        t = [v["tx_mm"], v["ty_mm"], v["tz_mm"]]
        centre = [v["centre_x_mm"], v["centre_y_mm"], v["centre_z_mm"]]
        assert np.abs(np.array(r) @ centre + t).max() < 1e-9
        d = [v[n] for n in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")]
        k = [[v["fu"], 0, v["u0"]], [0, v["fv"], v["v0"]], [0, 0, 1]]
        found[row["camera"]] = _opencv_project(points[row["camera"]], r, t, k, d)
    return found


# reader: export format, module that must be there, function
READERS = {
    "OpenCV": ("opencv", "cv2", opencv),
    "PyYAML + OpenCV, ROS": ("ros", "yaml", ros),
    "PyYAML + OpenCV, Kalibr": ("kalibr", "yaml", kalibr),
    "pycolmap": ("colmap", "pycolmap", pycolmap),
    "Metashape's manual": ("metashape", "numpy", metashape),
    "aniposelib": ("anipose", "aniposelib", aniposelib),
    "Pose2Sim": ("anipose", "Pose2Sim", pose2sim),
    "caliscope": ("caliscope", "caliscope", caliscope),
    "OpenCV, MC-Calib": ("mc-calib", "cv2", mc_calib),
    "multical": ("multical", "multical", multical),
    "mrcal": ("mrcal", "mrcal", mrcal),
    "csv + OpenCV": ("csv", "csv", csv_table),
}


def python_for(reader: str) -> str | None:
    """The Python that has what a reader needs: this one, else one named in SPHERECAL_READERS; None without any."""
    module = READERS[reader][1]
    if find_spec(module) is not None:
        return sys.executable
    for python in filter(None, os.environ.get("SPHERECAL_READERS", "").split(os.pathsep)):
        if subprocess.run([python, "-c", f"import {module}"], capture_output=True, check=False).returncode == 0:
            return python
    return None


def read(reader: str, path: Path, points: Points) -> Points:
    """Project `points` with what `reader` finds at `path`; RuntimeError where no Python has it."""
    python = python_for(reader)
    if python is None:
        raise RuntimeError(f"{reader} is not installed (a Python that has it can be named in SPHERECAL_READERS)")
    if python == sys.executable:
        return READERS[reader][2](path, points)
    file = path.parent / f"{path.name}.points.json"
    file.write_text(json.dumps({name: p.tolist() for name, p in points.items()}))
    done = subprocess.run(
        [python, "-I", __file__, reader, str(path), str(file)], capture_output=True, text=True, check=False, timeout=300
    )
    if done.returncode:
        raise RuntimeError(f"{reader} failed on {path.name}: {done.stderr}")
    found = json.loads(done.stdout.splitlines()[-1])
    return {name: np.array(uv) for name, uv in found.items()}


if __name__ == "__main__":
    given = {name: np.array(p) for name, p in json.loads(Path(sys.argv[3]).read_text()).items()}
    print(json.dumps({n: uv.tolist() for n, uv in READERS[sys.argv[1]][2](Path(sys.argv[2]), given).items()}))
