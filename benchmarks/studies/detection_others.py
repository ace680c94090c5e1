"""Other detectors for the benchmark of ours: cv2.aruco, SimpleBlobDetector, pupil-apriltags.

Run as a program this file is the process that pupil-apriltags has to itself.
"""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from spherecal.base.arrays import FloatArray

_HALF_PIXEL = 0.5  # pupil-apriltags counts from the first pixel's corner


def aruco_detector() -> Callable[[Any], tuple[list[int], FloatArray]]:
    """cv2.aruco with its own settings but for the refinement of corners."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)

    def detect(image: Any) -> tuple[list[int], FloatArray]:
        corners, ids, _ = detector.detectMarkers(image)
        return [] if ids is None else ids.ravel().tolist(), np.array(corners, dtype=float).reshape(-1, 4, 2)

    return detect


def simple_blob_detector() -> Any:
    """SimpleBlobDetector with shapes that suit the dots, and the coarsest thresholds that find them to 70 degrees."""
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.minThreshold, parameters.maxThreshold, parameters.thresholdStep = 10, 220, 10
    parameters.filterByColor, parameters.blobColor = True, 255
    parameters.filterByArea, parameters.minArea, parameters.maxArea = True, 15, 400
    parameters.filterByCircularity = False
    parameters.filterByConvexity, parameters.minConvexity = True, 0.7
    parameters.filterByInertia, parameters.minInertiaRatio = True, 0.05
    parameters.minDistBetweenBlobs = 3
    return cv2.SimpleBlobDetector.create(parameters)


class Pupil:
    """pupil-apriltags in a process of its own: it crashes where a detector is freed."""

    def __init__(self, tags: Any, decimate: float, folder: Path) -> None:
        image = folder / "tags.npy"
        if not image.exists():
            np.save(image, tags)
        command = [sys.executable, __file__, str(image), str(decimate)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def run(self) -> tuple[float, list[int], FloatArray]:
        """CPU seconds, ids and corners of one detection."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write("go\n")
        self._process.stdin.flush()
        cpu, *numbers = [float(word) for word in self._process.stdout.readline().split()]
        table = np.array(numbers).reshape(-1, 9)
        return cpu, table[:, 0].astype(int).tolist(), table[:, 1:].reshape(-1, 4, 2) - _HALF_PIXEL

    def stop(self) -> None:
        self._process.kill()
        self._process.wait()


def serve_pupil(path: str, decimate: str) -> None:
    """Detect once for every line of input; prints CPU seconds, then id and corners of every tag."""
    from pupil_apriltags import Detector as PupilDetector  # pyright: ignore[reportMissingImports]

    image = np.load(path)
    detector = PupilDetector(families="tag36h11", nthreads=1, quad_decimate=float(decimate))
    for _ in sys.stdin:
        begin = time.process_time()
        tags: Any = detector.detect(image)
        seconds = time.process_time() - begin
        numbers = [str(x) for tag in tags for x in (tag.tag_id, *np.asarray(tag.corners).ravel())]
        print(seconds, *numbers, flush=True)


if __name__ == "__main__":
    serve_pupil(*sys.argv[1:])
