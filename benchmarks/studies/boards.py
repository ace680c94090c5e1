"""Boards: rendered ChArUco, AprilGrid, chessboard and circle sets of a stereo rig, calibrated here and by OpenCV."""

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

import spherecal
from benchmarks.simulators.rendered_stickers import BoardCamera, paint, render_board
from benchmarks.studies.report import Report
from spherecal.base.arrays import FloatArray
from spherecal.geometry.camera import intrinsics_vector
from spherecal.geometry.rotation import exp_rotation
from spherecal_boards.board_images import FoundBoard, find_board
from spherecal_boards.board_pattern import BoardPattern, figure
from spherecal_boards.pattern_entry import board_entry, board_pattern
from spherecal_files.json_file import JsonValue

BOARDS = (
    "charuco,rows=6,columns=8,pitch_mm=30,marker_mm=22,dictionary=DICT_5X5_100",
    "aprilgrid,rows=5,columns=6,pitch_mm=45,marker_mm=35",
    "chessboard,rows=7,columns=10,pitch_mm=25",
    "asymmetric-circles,rows=11,columns=4,pitch_mm=20",
)
BASELINE_MM = 400.0
VIEWS = 20
# ours may be worse by what chance does to a single set: over ten sets the ratio of the errors has a spread of 30 %
GOAL_RATIO = 1.3


@dataclass(frozen=True)
class Figures:
    """What one program made of a set: rms px over both cameras, baseline mm, errors of the focal lengths, seconds."""

    rms_px: float
    baseline_mm: float
    focal_error_px: float
    seconds: float
    points: int


@dataclass(frozen=True)
class StereoSet:
    """Images of a board before two cameras with the truth: cam2's pose is `x2 = rotation @ x1 + translation`."""

    folder: Path
    text: str
    cameras: tuple[BoardCamera, BoardCamera]
    rotation: FloatArray
    translation: FloatArray

    @property
    def pattern(self) -> BoardPattern:
        return board_pattern(JsonValue(board_entry(self.text), Path("board")))


def render_set(
    folder: Path, text: str, seed: int, views: int = VIEWS, size: tuple[int, int] = (1280, 960)
) -> StereoSet:
    """Render a set into cam1/ and cam2/: the board at 0.8 to 1.3 m, turned by any angle it can be told at, tilted."""
    random = np.random.default_rng(seed)
    width, height = size
    cameras = []
    for distortion in ([-0.12, 0.06, 4e-4, -3e-4, 0.0], [-0.10, 0.04, -2e-4, 5e-4, 0.0]):
        f = width * random.uniform(1.15, 1.25)
        u0, v0 = (width - 1) / 2 + random.normal(0, 5), (height - 1) / 2 + random.normal(0, 5)
        cameras.append(BoardCamera(intrinsics_vector(np.array([[f, 0, u0], [0, f, v0], [0, 0, 1]]), distortion), size))
    rotation = exp_rotation(np.array([0.0, np.deg2rad(20.0), 0.0]))
    translation = -rotation @ np.array([BASELINE_MM, 0, 0])
    made = StereoSet(folder, text, (cameras[0], cameras[1]), rotation, translation)
    drawn = figure(made.pattern)
    painted = paint(drawn, 8.0)
    upright = made.pattern.kind in ("chessboard",)  # rows + columns odd tells the end, but both must be in view
    for view in range(views):
        turn = random.uniform(-0.6, 0.6) if upright else random.uniform(-np.pi, np.pi)
        tilt = random.uniform(-0.5, 0.5, 2)
        turned = exp_rotation(np.array([*tilt, 0.0])) @ exp_rotation(np.array([0, 0, turn]))
        away = random.uniform(850, 1250)
        middle = np.array(
            [BASELINE_MM / 2 + away * random.uniform(-0.12, 0.12), away * random.uniform(-0.1, 0.1), away]
        )
        shift = middle - turned @ np.array([*drawn.size_mm, 0.0]) / 2
        for number, (camera, r, t) in enumerate(
            ((cameras[0], np.eye(3), np.zeros(3)), (cameras[1], rotation, translation)), 1
        ):
            image = render_board(drawn, camera, r @ turned, r @ shift + t, random, painted=painted)
            path = folder / f"cam{number}" / f"{view + 1:04d}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), image)
    return made


def ours(made: StereoSet, session: Path) -> Figures:
    """From the folder of images to a rig, as its user would."""
    begin = time.perf_counter()
    new = spherecal.new_session(session, made.folder, board=made.text)
    calibration = spherecal.calibrate_session(new.session, "board")
    seconds = time.perf_counter() - begin
    rig = calibration.rig
    error = max(abs(rig[f"cam{i + 1}"].K[0, 0] - made.cameras[i].intrinsics[0]) for i in (0, 1))
    baseline = float(np.linalg.norm(rig["cam1"].centre_mm - rig["cam2"].centre_mm))
    assert rig.quality.rms_px is not None
    return Figures(rig.quality.rms_px, baseline, error, seconds, len(calibration.observations))


def opencv(made: StereoSet) -> Figures:
    """`calibrateCamera` of each camera, then `stereoCalibrate` from there, all parameters free; the same corners."""
    begin = time.perf_counter()
    found = [
        [_found(made, camera, path.name) for path in sorted((made.folder / "cam1").iterdir())] for camera in (1, 2)
    ]
    points = np.column_stack([made.pattern.points_mm, np.zeros(len(made.pattern.points_mm))]).astype(np.float32)
    size = made.cameras[0].size
    lenses = []
    for own in found:
        good = [one for one in own if one is not None]
        _, K, dist, _, _ = cv2.calibrateCamera(
            [points[one.index] for one in good], [one.uv.astype(np.float32) for one in good], size, None, None
        )
        lenses += [K, dist]
    objects, first, second = [], [], []
    for a, b in zip(*found, strict=True):
        if a is None or b is None:
            continue
        common, at, bt = np.intersect1d(a.index, b.index, return_indices=True)
        if len(common) >= 6:
            objects.append(points[common])
            first.append(a.uv[at].astype(np.float32))
            second.append(b.uv[bt].astype(np.float32))
    rms, K1, _, K2, _, _, T, _, _ = cv2.stereoCalibrate(
        objects,
        first,
        second,
        lenses[0],
        lenses[1],
        lenses[2],
        lenses[3],
        size,
        flags=cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-9),
    )
    error = max(abs(K[0, 0] - camera.intrinsics[0]) for K, camera in zip((K1, K2), made.cameras, strict=True))
    seconds = time.perf_counter() - begin
    return Figures(float(rms), float(np.linalg.norm(T)), float(error), seconds, 2 * sum(map(len, objects)))


def _found(made: StereoSet, camera: int, name: str) -> FoundBoard | None:
    image = cv2.imread(str(made.folder / f"cam{camera}" / name), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return find_board(image.astype(np.uint8, copy=False), made.pattern)


def compare(text: str, seed: int, views: int = VIEWS, size: tuple[int, int] = (1280, 960)) -> tuple[Figures, Figures]:
    """Ours and OpenCV's figures of one set."""
    with tempfile.TemporaryDirectory() as folder:
        made = render_set(Path(folder) / "images", text, seed, views, size)
        return ours(made, Path(folder) / "session"), opencv(made)


def report(runs: int | None = None) -> Report:
    """All boards, some sets each."""
    page = Report("Boards, here and by OpenCV", "python3 dev.py studies boards")
    runs = runs or 5
    page.text(
        f"Two cameras of 1280 x 960 px with {BASELINE_MM:g} mm baseline, {VIEWS} views of each board, rendered with "
        "noise and blur; nothing is given but the images and the board. Both use the corners and dots found here; "
        "OpenCV calibrates each camera (five terms of distortion) and then both together. Seconds include finding the "
        "boards (here on all cores). rms of (du, dv) together, as OpenCV has it."
    )
    compare(BOARDS[0], 0, 4)  # compiled kernels are loaded
    rows, ratios = [], []
    for text in BOARDS:
        both = [compare(text, 100 + run) for run in range(runs)]
        errors = [np.array([one[i].baseline_mm - BASELINE_MM for one in both]) for i in (0, 1)]
        focal = [float(np.mean([one[i].focal_error_px for one in both])) for i in (0, 1)]
        ratios.append(float(np.sqrt((errors[0] ** 2).mean() / (errors[1] ** 2).mean())))
        for i, name in enumerate(("SphereCal", "OpenCV")):
            rows.append(
                (
                    text.split(",")[0],
                    name,
                    float(np.mean([one[i].rms_px for one in both])),
                    float(np.sqrt((errors[i] ** 2).mean())),
                    focal[i],
                    float(np.median([one[i].seconds for one in both])),
                )
            )
    page.table(("board", "by", "rms px", "baseline off by mm (rms)", "focal length off by px", "seconds"), rows)
    worst = max(ratios)
    page.verdict(f"baseline no worse than {GOAL_RATIO:g} times OpenCV's", worst <= GOAL_RATIO, f"at most {worst:.2f}")
    return page
