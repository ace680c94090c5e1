"""One program on one problem in a process of its own: `python others_run.py PROGRAM problem.npz result.npz`.

Needs numpy and the program alone, so that it runs in an environment that has no SphereCal. The problem: intrinsics
(c,16) in OpenCV's order, rotation (c,3,3), translation (c,3) to start from, image sizes (c,2); observations camera,
point, uv (n,2); for boards also placement (n,), board points (m,3) and the intrinsics' start.
The result has the cameras, seconds of the processor and MB added at the peak; `failed` where the program gave up.
"""

import sys
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

_MM_PER_M = 1000.0


def main() -> int:
    """Run one program and write its result."""
    program, problem, result = sys.argv[1:]
    with np.load(problem) as arrays:
        given = SimpleNamespace(**{name: arrays[name] for name in arrays.files})
    solve = PROGRAMS[program]
    solve = solve(given)  # imports and sets up, which is not measured
    before, began, wall = peak_mb(), time.process_time(), time.perf_counter()
    try:
        found, failed = solve(), ""
    except Exception as error:  # what a program cannot do is a result of the study
        found, failed = {}, f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"
    used, lasted = time.process_time() - began, time.perf_counter() - wall
    np.savez(result, cpu_s=used, wall_s=lasted, mb=max(peak_mb() - before, 0.0), failed=failed, **found)
    return 0


def forget_peak() -> None:
    """Let the peak of this process's memory begin at what it has now, where the system can (Linux)."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_mb() -> float:
    """Peak resident memory of this process; NaN where the system does not say."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return float("nan")
    return next(float(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024


def aniposelib(p):
    """aniposelib: CameraGroup.bundle_adjust; its cameras have one focal length and k1 to estimate."""
    import cv2
    from aniposelib.cameras import Camera, CameraGroup  # pyright: ignore[reportMissingImports]

    cameras = []
    for c in range(len(p.rotation)):
        k = p.intrinsics[c]
        matrix = np.array([[k[0], 0, k[2]], [0, k[1], k[3]], [0, 0, 1.0]])
        turn = cv2.Rodrigues(p.rotation[c])[0].ravel()
        cameras.append(Camera(matrix, k[4:9].copy(), tuple(p.size[c]), turn, p.translation[c], f"{c:03d}"))
    group = CameraGroup(cameras)
    seen = np.full((len(cameras), int(p.point.max()) + 1, 2), np.nan)
    seen[p.camera, p.point] = p.uv
    seen = seen[:, np.isfinite(seen[:, :, 0]).sum(axis=0) >= 2]

    def solve() -> dict:
        group.bundle_adjust(seen, verbose=False)
        intrinsics = np.zeros((len(cameras), 16))
        for c, camera in enumerate(group.cameras):
            m = camera.get_camera_matrix()
            intrinsics[c, :4] = m[0, 0], m[1, 1], m[0, 2], m[1, 2]
            intrinsics[c, 4:9] = camera.get_distortions()
        turns = np.array([cv2.Rodrigues(camera.get_rotation())[0] for camera in group.cameras])
        return {
            "intrinsics": intrinsics,
            "rotation": turns,
            "translation": np.array([camera.get_translation() for camera in group.cameras]),
        }

    return solve


def caliscope(p):
    """caliscope: CaptureVolume.optimize with intrinsics refined, as its own workflow does."""
    import pandas as pd  # pyright: ignore[reportMissingImports]
    from caliscope.cameras.camera_array import CameraArray, CameraData  # pyright: ignore[reportMissingImports]
    from caliscope.core.capture_volume import CaptureVolume  # pyright: ignore[reportMissingImports]
    from caliscope.core.point_data import ImagePoints, WorldPoints  # pyright: ignore[reportMissingImports]

    cameras = {}
    for c in range(len(p.rotation)):
        k = p.intrinsics[c]
        matrix = np.array([[k[0], 0, k[2]], [0, k[1], k[3]], [0, 0, 1.0]])
        cameras[c] = CameraData(
            c,
            tuple(int(s) for s in p.size[c]),
            matrix=matrix,
            distortions=k[4:9].copy(),
            rotation=p.rotation[c],
            translation=p.translation[c],
        )
    image = pd.DataFrame(
        {
            "sync_index": 0,
            "cam_id": p.camera,
            "object_id": 0,
            "keypoint_id": p.point,
            "img_loc_x": p.uv[:, 0],
            "img_loc_y": p.uv[:, 1],
        }
    )
    named = np.unique(p.point)
    world = pd.DataFrame(
        {
            "sync_index": 0,
            "object_id": 0,
            "keypoint_id": named,
            "x_coord": p.start[named, 0],
            "y_coord": p.start[named, 1],
            "z_coord": p.start[named, 2],
            "frame_time": np.nan,
        }
    )
    volume = CaptureVolume(CameraArray(cameras), ImagePoints(image), WorldPoints(world))

    def solve() -> dict:
        done = volume.optimize(refine_intrinsics=True, strict=False).camera_array.cameras
        intrinsics = np.zeros((len(done), 16))
        for c, camera in done.items():
            m, d = camera.matrix, np.ravel(camera.distortions)
            intrinsics[c, :4] = m[0, 0], m[1, 1], m[0, 2], m[1, 2]
            intrinsics[c, 4 : 4 + len(d)] = d
        order = sorted(done)
        return {
            "intrinsics": intrinsics,
            "rotation": np.array([done[c].rotation for c in order]),
            "translation": np.array([done[c].translation for c in order]),
        }

    return solve


def _views(p):
    """Board views by camera and placement: board points (k,) and image points (k,2), of ten points and more."""
    views = {}
    for c, t in np.unique(np.stack([p.camera, p.placement], axis=1), axis=0).tolist():
        own = (p.camera == c) & (p.placement == t)
        if own.sum() >= 10:
            views[c, t] = p.point[own], p.uv[own]
    return views


def _opencv_matrix(k):
    return np.array([[k[0], 0, k[2]], [0, k[1], k[3]], [0, 0, 1.0]])


def _each_alone(p, views) -> tuple[list, list]:
    """OpenCV's calibrateCamera for each camera from its data sheet."""
    import cv2

    board = p.board.astype(np.float32)
    matrices, distortions = [], []
    for c in range(len(p.size)):
        own = [view for (camera, _), view in views.items() if camera == c]
        objects = [board[point] for point, _ in own]
        images = [uv.astype(np.float32) for _, uv in own]
        size = tuple(int(s) for s in p.size[c])
        start = _opencv_matrix(p.intrinsics[c])
        _, m, d, _, _ = cv2.calibrateCamera(
            objects, images, size, start, np.zeros(5), flags=cv2.CALIB_USE_INTRINSIC_GUESS
        )
        matrices.append(m)
        distortions.append(d)
    return matrices, distortions


def opencv_multiview(p):
    """OpenCV 5: calibrateMultiview, all cameras and placements together."""
    import cv2

    views = _views(p)
    n, frames = len(p.size), int(p.placement.max()) + 1
    # in metres: it divides the board's points by the square of their extent, and takes one in millimetres for a line
    everything = (p.board / _MM_PER_M).astype(np.float32)
    blank = np.full((len(everything), 2), -1, np.float32)  # what a camera does not see, by OpenCV's convention
    images, mask = [], np.zeros((n, frames), np.uint8)
    for c in range(n):
        row = []
        for t in range(frames):
            shown = blank.copy()
            if (c, t) in views:
                point, uv = views[c, t]
                shown[point] = uv
                mask[c, t] = 1
            row.append(shown)
        images.append(row)
    sizes = [tuple(int(s) for s in size) for size in p.size]

    def solve() -> dict:
        # its own start of the lenses fails on tilts as steep as these: each camera alone gives a better one
        matrices, distortions = _each_alone(p, views)
        flags = np.full((n, 1), cv2.CALIB_USE_INTRINSIC_GUESS, np.int32)
        multiview: Any = cv2.calibrateMultiview  # OpenCV's stubs demand what it takes as None
        done = multiview(
            [everything] * frames,
            images,
            sizes,
            mask,
            np.zeros(n, np.uint8),
            matrices,
            distortions,
            None,
            None,
            flags,
            cv2.CALIB_USE_INTRINSIC_GUESS,
        )
        matrices, distortions, turns, shifts = done[1:5]
        turns = [cv2.Rodrigues(r)[0] if np.size(r) == 3 else r for r in turns]
        return _found(matrices, distortions, turns, [np.multiply(shift, _MM_PER_M) for shift in shifts])

    return solve


def opencv_stereo(p):
    """OpenCV: calibrateCamera for each camera, stereoCalibrate pair by pair, chained by most placements in common."""
    import cv2

    views = _views(p)
    n = len(p.size)
    board = p.board.astype(np.float32)

    def solve() -> dict:
        matrices, distortions = _each_alone(p, views)
        turns: list = [None] * n
        shifts: list = [None] * n
        turns[0], shifts[0] = np.eye(3), np.zeros((3, 1))
        while any(turn is None for turn in turns):
            best = max(
                (
                    (len(_common(views, a, b)), a, b)
                    for a in range(n)
                    for b in range(n)
                    if turns[a] is not None and turns[b] is None
                ),
                default=(0, 0, 0),
            )
            if best[0] == 0:
                raise ValueError("cameras do not hang together")
            _, a, b = best
            objects, first, second = zip(*_common(views, a, b), strict=True)
            size = tuple(int(s) for s in p.size[a])
            done = cv2.stereoCalibrate(
                [board[o] for o in objects],
                first,
                second,
                matrices[a],
                distortions[a],
                matrices[b],
                distortions[b],
                size,
                flags=cv2.CALIB_FIX_INTRINSIC,
            )
            turn, shift = done[5], done[6]
            turns[b], shifts[b] = turn @ turns[a], turn @ shifts[a] + shift
        return _found(matrices, distortions, turns, shifts)

    return solve


def _common(views, a, b):
    """Board points, image points in a and in b, of every placement where both see ten of them."""
    out = []
    for (camera, t), (point, uv) in views.items():
        if camera != a or (b, t) not in views:
            continue
        other, its = views[b, t]
        both, i, j = np.intersect1d(point, other, return_indices=True)
        if len(both) >= 10:
            out.append((both, uv[i].astype(np.float32), its[j].astype(np.float32)))
    return out


def _found(matrices, distortions, turns, shifts) -> dict:
    intrinsics = np.zeros((len(turns), 16))
    for c, (m, d) in enumerate(zip(matrices, distortions, strict=True)):
        intrinsics[c, :4] = m[0, 0], m[1, 1], m[0, 2], m[1, 2]
        intrinsics[c, 4 : 4 + np.size(d)] = np.ravel(d)
    return {
        "intrinsics": intrinsics,
        "rotation": np.array(turns),
        "translation": np.array([np.ravel(t) for t in shifts]),
    }


PROGRAMS = {
    "aniposelib": aniposelib, "caliscope": caliscope, "opencv-multiview": opencv_multiview,
    "opencv-stereo": opencv_stereo,
}  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
