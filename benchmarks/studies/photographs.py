"""Boards on photographs of others: found, seconds, corner noise beside OpenCV's finders; rigs beside its adjustment."""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import spherecal
from benchmarks.studies.report import Report
from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.data.observations import Observations
from spherecal.data.rig import Rig
from spherecal.data.session import Session
from spherecal_boards.board import calibrate_board
from spherecal_boards.board_images import FoundBoard, find_board, find_boards
from spherecal_boards.board_pattern import BoardPattern
from spherecal_boards.pattern_entry import board_entry, board_pattern, read_board_pattern
from spherecal_files.json_file import JsonValue

_ROOT = Path(__file__).resolve().parents[2]
_ENDOSCOPE = "charuco,rows=25,columns=18,pitch_mm=5,marker_mm=4,dictionary=DICT_4X4_250,legacy=true"
_HAND, _CLOSE = "chessboard,rows=14,columns=19,pitch_mm=10", "chessboard,rows=4,columns=7,pitch_mm=60"
_SMALL = "chessboard,rows=6,columns=9,pitch_mm=25"
# source -> pictures, board
CHESSBOARDS = {
    "multidic 201": ("multidic/201_*.jpg", _HAND),
    "multidic 202": ("multidic/202_*.jpg", _HAND),
    **{f"pose2sim cam0{c}": (f"pose2sim/cam0{c}_*.jpg", _CLOSE) for c in (1, 2, 3, 4)},
    "ucl": ("ucl/*.jpg", _SMALL),
}
# pair -> pictures, board
PAIRS = {"multidic": ("multidic/*.jpg", _HAND), "charuco_lr": ("charuco_lr/*.jpg", _ENDOSCOPE)}
Grey = NDArray[np.uint8]
Found = tuple[NDArray[np.int64], FloatArray]  # index (k,), uv (k, 2)


def data() -> Path:
    """The folder of photographs."""
    return Path(os.environ.get("SPHERECAL_DATA") or _ROOT.parent / "shared" / "data") / "boards"


def pattern(text: str) -> BoardPattern:
    """The board that a text describes."""
    return board_pattern(JsonValue(board_entry(text), Path("board")))


def _old(image: Grey, board: BoardPattern) -> Found | None:
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCorners(image, (board.columns, board.rows), flags=flags)
    if not found or corners is None:
        return None
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
    fine = cv2.cornerSubPix(image, corners, (11, 11), (-1, -1), criteria)  # as its samples do
    return np.arange(board.rows * board.columns), np.asarray(fine, dtype=float).reshape(-1, 2)


def _sectors(image: Grey, board: BoardPattern) -> Found | None:
    found, corners = cv2.findChessboardCornersSB(image, (board.columns, board.rows), flags=0)
    if not found or corners is None:
        return None
    return np.arange(board.rows * board.columns), np.asarray(corners, dtype=float).reshape(-1, 2)


def _ours(image: Grey, board: BoardPattern) -> Found | None:
    found: FoundBoard | None = find_board(image, board)
    return None if found is None else (found.index, found.uv)


FINDERS: dict[str, Callable[[Grey, BoardPattern], Found | None]] = {
    "SphereCal": _ours,
    "findChessboardCorners": _old,
    "findChessboardCornersSB": _sectors,
}


@dataclass(frozen=True)
class Score:
    """What a finder makes of some pictures: which it finds, seconds a picture, px rms of the camera alone."""

    found: tuple[bool, ...]
    seconds: float
    noise_px: float


def _alone(found: list[Found], board: BoardPattern, size: tuple[int, int]) -> tuple[float, float]:
    """rms px and focal length px of OpenCV's calibration of one camera."""
    points = np.column_stack([board.points_mm, np.zeros(len(board.points_mm))]).astype(np.float32)
    rms, K, _, _, _ = cv2.calibrateCamera(
        [points[index] for index, _ in found], [uv.astype(np.float32) for _, uv in found], size, np.eye(3), np.zeros(5)
    )
    return float(rms), float(K[0, 0])


def scores(glob: str, text: str) -> dict[str, Score]:
    """Each finder's; the noise is over the pictures that all of them find, where these are four at least."""
    board = pattern(text)
    images = [np.asarray(cv2.imread(str(p), cv2.IMREAD_GRAYSCALE), dtype=np.uint8) for p in sorted(data().glob(glob))]
    made: dict[str, list[Found | None]] = {}
    seconds = {}
    for name, finder in FINDERS.items():
        begin = time.process_time()
        made[name] = [finder(image, board) for image in images]
        seconds[name] = (time.process_time() - begin) / len(images)
    common = [i for i in range(len(images)) if all(own[i] is not None for own in made.values())]
    size = (images[0].shape[1], images[0].shape[0])
    result = {}
    for name, own in made.items():
        taken = [one for i in common if (one := own[i]) is not None]
        noise = _alone(taken, board, size)[0] if len(common) >= 4 else float("nan")
        result[name] = Score(tuple(one is not None for one in own), seconds[name], noise)
    return result


# --- rigs ------------------------------------------------------------------------------------------------------------

SPLITS = 8  # halves of every source, at random


@dataclass(frozen=True)
class Recorded:
    """A session of photographs and the boards found in them."""

    session: Session
    observations: Observations
    board: BoardPattern

    def rig(self, placements: IntArray | None = None) -> Rig:
        """The rig calibrated by all placements, or by some."""
        o = self.observations
        o = o if placements is None else o.select(np.isin(o.placement, placements))
        return calibrate_board(replace(self.session, observations=o)).rig

    def views(self, camera: int) -> dict[int, Found]:
        """What a camera sees, by placement."""
        o = self.observations
        own = {int(t): (o.camera == camera) & (o.placement == t) for t in np.unique(o.placement[o.camera == camera])}
        return {t: (o.target[rows], o.uv[rows]) for t, rows in own.items() if rows.sum() >= 12}


@contextmanager
def recorded(files: dict[Path, str], text: str) -> Iterator[Recorded]:
    """A session of photographs under the names camera/placement, as its user would make it."""
    with tempfile.TemporaryDirectory() as folder:
        for path, name in files.items():
            to = Path(folder) / "in" / name
            to.parent.mkdir(parents=True, exist_ok=True)
            to.symlink_to(path)
        pattern_of = "{camera}/{placement}.jpg"
        new = spherecal.new_session(Path(folder) / "s", Path(folder) / "in", pattern=pattern_of, board=text)
        board = read_board_pattern(new.session)
        yield Recorded(new.session, find_boards(new.session, board, Context()).observations, board)


def named(glob: str, camera: str = "") -> dict[Path, str]:
    """Photographs and their names in a session: CAMERA_..._PLACEMENT.jpg, or of one camera."""
    made = {}
    for path in sorted(data().glob(glob)):
        first, *rest = path.stem.replace("Frame_", "").replace("_int", "").split("_")
        made[path] = f"{camera or first}/{rest[-1]}.jpg"
    return made


def opencv_pair(own: Recorded) -> tuple[float, float, float, float, float]:
    """rms px, both focal lengths px, baseline mm, relative turn in degrees: stereoCalibrate with all free.

    It starts from each camera alone.
    """
    points = np.column_stack([own.board.points_mm, np.zeros(len(own.board.points_mm))]).astype(np.float32)
    size = own.session.cameras[0].image_size
    first, second = own.views(0), own.views(1)
    lenses = []
    for views in (first, second):
        taken = list(views.values())
        _, K, dist, _, _ = cv2.calibrateCamera(
            [points[i] for i, _ in taken], [uv.astype(np.float32) for _, uv in taken], size, np.eye(3), np.zeros(5)
        )
        lenses += [K, dist]
    objects, left, right = [], [], []
    for place in sorted(set(first) & set(second)):
        common, a, b = np.intersect1d(first[place][0], second[place][0], return_indices=True)
        if len(common) >= 8:
            objects.append(points[common])
            left.append(first[place][1][a].astype(np.float32))
            right.append(second[place][1][b].astype(np.float32))
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-9)
    rms, K1, _, K2, _, R, T, _, _ = cv2.stereoCalibrate(
        objects,
        left,
        right,
        lenses[0],
        lenses[1],
        lenses[2],
        lenses[3],
        size,
        flags=cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=criteria,
    )
    return float(rms), float(K1[0, 0]), float(K2[0, 0]), float(np.linalg.norm(T)), _turn(np.asarray(R))


def opencv_turns(own: Recorded) -> list[float]:
    """By how many degrees the second camera is turned against the first, by each placement alone: solvePnP."""
    points = np.column_stack([own.board.points_mm, np.zeros(len(own.board.points_mm))])
    poses = []
    for camera in (0, 1):
        taken = own.views(camera)
        objects, seen = [points[i].astype(np.float32) for i, _ in taken.values()], [uv for _, uv in taken.values()]
        size = own.session.cameras[camera].image_size
        seen = [uv.astype(np.float32) for uv in seen]
        _, _, _, turns, _ = cv2.calibrateCamera(objects, seen, size, np.eye(3), np.zeros(5))
        poses.append({t: cv2.Rodrigues(turn)[0] for t, turn in zip(taken, turns, strict=True)})
    return [_turn(np.asarray(poses[1][t]) @ np.asarray(poses[0][t]).T) for t in sorted(set(poses[0]) & set(poses[1]))]


# --- seconds ---------------------------------------------------------------------------------------------------------

IMAGES, MEGAPIXELS = 95, 2.3
# pictures and the board that is looked for
TIMED = {
    "pose2sim": ("pose2sim/*.jpg", _CLOSE),
    "multidic": ("multidic/*.jpg", _HAND),
    "charuco_lr": ("charuco_lr/*.jpg", _ENDOSCOPE),
    "multidic, another chessboard": ("multidic/*.jpg", _SMALL),
}


def seconds(glob: str, text: str) -> tuple[int, float, float, str]:
    """Images looked at, seconds, processor seconds, what is said, for 95 images of 2.3 MP: photographs, scaled."""
    paths = sorted(data().glob(glob))
    with tempfile.TemporaryDirectory() as folder:
        images = Path(folder) / "in" / "cam"
        images.mkdir(parents=True)
        width, height = 0, 0
        for number in range(IMAGES):
            image = np.asarray(cv2.imread(str(paths[number % len(paths)]), cv2.IMREAD_GRAYSCALE))
            if not width:
                scale = float(np.sqrt(MEGAPIXELS * 1e6 / image.size))
                width, height = round(scale * image.shape[1]), round(scale * image.shape[0])
            method = cv2.INTER_AREA if image.size > width * height else cv2.INTER_CUBIC
            cv2.imwrite(str(images / f"{number:04d}.jpg"), cv2.resize(image, (width, height), interpolation=method))
        new = spherecal.new_session(Path(folder) / "s", images.parent, pattern="{camera}/{placement}.jpg", board=text)
        begin, processor = time.perf_counter(), time.process_time()
        try:
            found = find_boards(new.session, read_board_pattern(new.session), Context())
            looked, said = found.images, f"found in {found.images - len(found.missed)}"
        except InputError as error:
            looked, said = int(dict(getattr(error.parts[0], "values", {}))["tried"]), error.hint.split(". ")[0]
        return looked, time.perf_counter() - begin, time.process_time() - processor, said


def _turn(rotation: FloatArray) -> float:
    return float(np.rad2deg(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))


def _relative(rig: Rig) -> tuple[float, float, float, float]:
    """Two cameras' distance and its standard uncertainty as far as their centres' go (mm); turn, its own (degrees)."""
    a, b = rig.cameras
    along = (b.centre_mm - a.centre_mm) / np.linalg.norm(b.centre_mm - a.centre_mm)
    sigmas = [c.sigma for c in (a, b) if c.sigma is not None]
    centre = float(np.linalg.norm([np.linalg.norm(np.asarray(s.centre_mm) * along) for s in sigmas]))
    turned = float(np.linalg.norm([np.linalg.norm(s.rotation_deg) for s in sigmas]))
    return float(np.linalg.norm(b.centre_mm - a.centre_mm)), centre, _turn(b.rotation @ a.rotation.T), turned


def _quantities(rig: Rig) -> dict[str, tuple[float, float]]:
    """Value and stated standard uncertainty of focal lengths, principal points, baseline and turn."""
    made = {}
    for camera in rig.cameras:
        if camera.sigma is not None:
            for i, name in enumerate(("f", "f", "cx", "cy")):
                made[f"{camera.id} {name} px"] = float(camera.intrinsics[i]), float(camera.sigma.intrinsics[i])
    if len(rig.cameras) == 2:
        length, sd, turn, turn_sd = _relative(rig)
        made |= {"baseline mm": (length, sd), "turn degrees": (turn, turn_sd)}
    return made


def halves(own: Recorded, splits: int = SPLITS) -> dict[str, tuple[float, float]]:
    """Of each quantity: rms and largest difference of random halves over its stated standard uncertainty."""
    places = np.unique(own.observations.placement)
    off: dict[str, list[float]] = {}
    for seed in range(splits):
        order = np.random.default_rng(seed).permutation(places)
        one, other = (_quantities(own.rig(part)) for part in np.array_split(order, 2))
        for name in sorted(set(one) & set(other)):
            stated = float(np.hypot(one[name][1], other[name][1]))
            off.setdefault(name, []).append(abs(one[name][0] - other[name][0]) / stated)
    return {name: (float(np.sqrt(np.mean(np.square(z)))), max(z)) for name, z in off.items()}


# --- the page --------------------------------------------------------------------------------------------------------


def report(runs: int | None = None) -> Report:
    """Finders source by source, then rigs."""
    page = Report("Boards on photographs of others", "python3 dev.py studies photographs")
    page.text(
        "The photographs are in the shared folder of real data (`boards`, its README has their sources and licences). "
        "Seconds are processor seconds a picture, all finders in one run on whole pictures. Noise is the rms of "
        "OpenCV's calibration of the camera alone, with each finder's corners of the pictures that all find."
    )
    page.heading("Chessboards found")
    rows, lost, wide = [], 0, []
    for source, (glob, text) in CHESSBOARDS.items():
        own = scores(glob, text)
        union = [any(flags) for flags in zip(*(s.found for n, s in own.items() if n != "SphereCal"), strict=True)]
        lost += sum(o and not w for o, w in zip(union, own["SphereCal"].found, strict=True))
        best = min(s.noise_px for n, s in own.items() if n != "SphereCal")
        if np.isfinite(best):
            wide.append(own["SphereCal"].noise_px / best)
        rows += [(source, n, f"{sum(s.found)} of {len(s.found)}", s.seconds, s.noise_px) for n, s in own.items()]
    page.table(("source", "finder", "found", "seconds a picture", "noise px"), rows)
    page.verdict("all pictures that any of OpenCV's finders finds", lost == 0, f"{lost} lost")
    page.verdict("noise at most 1.05 times the best finder's", max(wide) <= 1.05, f"at most {max(wide):.3f} times")
    page.text("")
    page.heading("Seconds of a recording")
    page.text(
        f"{IMAGES} images of {MEGAPIXELS} MP, the photographs scaled to that and repeated, on {os.cpu_count()} cores. "
        "Where the board is in none of the first 20, spread over the recording, that is the end."
    )
    rows = [(name, *seconds(*own)) for name, own in TIMED.items()]
    page.table(("images, board", "looked at", "seconds", "processor seconds", "said"), rows)
    most = max(row[3] for row in rows if row[1] == IMAGES) / 2
    page.verdict(
        f"{IMAGES} in at most 30 s on two cores (processor seconds over 2)", most <= 30, f"at most {most:.1f} s"
    )
    page.text("")
    rows, apart = _rigs(page)
    page.heading("Halves against stated uncertainties")
    page.text(
        f"{SPLITS} random halves of each source: differences over their stated standard uncertainty. A half of a "
        "camera of pose2sim has 3 or 4 pictures."
    )
    page.table(("source", "quantity", "rms", "largest"), rows)
    over = max(row[3] for row in rows)
    page.verdict("halves within 3 stated standard deviations", over <= 3, f"at most {over:.2f}")
    page.verdict("pictures of multidic are of several moments", max(apart) > 2 * min(apart), "see the turns above")
    return page


def _rigs(page: Report) -> tuple[list[tuple[str, str, float, float]], list[float]]:
    """Tables of pairs and cameras beside OpenCV's adjustment; the halves' rows, and the turns of multidic's pairs."""
    page.heading("Rigs beside OpenCV's adjustment")
    page.text(
        "Both from the same corners. OpenCV: each camera alone, five terms of distortion, then `stereoCalibrate` with "
        "all free, every corner kept."
    )
    rows, halved, turns = [], [], []
    for name, (glob, text) in PAIRS.items():
        with recorded(named(glob), text) as own:
            rig, (rms, *theirs) = own.rig(), opencv_pair(own)
            rms_px = rig.quality.rms_px or float("nan")
            (length, sd, turn, turn_sd), (a, b) = _relative(rig), rig.cameras
            said = ", ".join(f.code for f in rig.quality.findings if f.severity == "error")
            focal = float(a.K[0, 0]), float(b.K[0, 0])
            rows.append((name, "SphereCal", rig.quality.verdict, said, rms_px, *focal, length, sd, turn, turn_sd))
            rows.append((name, "OpenCV", "", "", rms, theirs[0], theirs[1], theirs[2], "", theirs[3], ""))
            if rig.quality.valid:
                halved += [(name, quantity, *z) for quantity, z in halves(own).items()]
            else:
                turns = opencv_turns(own)
    head = ("pair", "by", "verdict", "error", "rms px", "f left px", "f right px", "baseline mm", "sd mm", "turn deg")
    page.table((*head, "sd deg"), rows)
    page.text(
        "The pictures of multidic with one number are not of one moment, and so SphereCal says (`board-moving`): by "
        "OpenCV's `solvePnP` camera 202 is turned against 201 by "
        + ", ".join(f"{turn:.0f}" for turn in turns)
        + " degrees in the pairs that both see. So each of its cameras is calibrated alone:"
    )
    rows = []
    for source, (glob, text) in CHESSBOARDS.items():
        if source == "ucl":  # one picture a camera
            continue
        with recorded(named(glob, "cam"), text) as own:
            rig, camera = own.rig(), own.rig().cameras[0]
            rms, focal = _alone(list(own.views(0).values()), own.board, own.session.cameras[0].image_size)
            stated = float(camera.sigma.intrinsics[0]) if camera.sigma is not None else float("nan")
            shape = any(f.code == "board-shape-estimated" for f in rig.quality.findings)
            focal_px, rms_px = float(camera.K[0, 0]), rig.quality.rms_px or float("nan")
            rows.append((source, focal_px, stated, focal, rms_px, rms, "estimated" if shape else "nominal"))
            halved += [(source, quantity.removeprefix("cam "), *z) for quantity, z in halves(own).items()]
    head = ("camera", "f px", "its sd px", "f by OpenCV px", "rms px", "rms by OpenCV px", "points of the board")
    page.table(head, rows)
    return halved, turns
