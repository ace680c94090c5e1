"""What board images show when it was not said, or is not what was said: markers or a chessboard, and their layout."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.messages.values import Phrase
from spherecal.targets.blobs import GreyImage
from spherecal.targets.marker_set import marker_dictionary
from spherecal_boards.board_pattern import APRILTAGS
from spherecal_boards.chessboard import largest_chessboard

Grey = NDArray[np.uint8]
LOOKED_AT = 8  # images
# The largest dictionary of each family (smaller ones are its beginning), those that boards are made of first.
_FAMILIES = (
    "DICT_5X5_1000", "DICT_4X4_1000", "DICT_6X6_1000", APRILTAGS, "DICT_7X7_1000", "DICT_ARUCO_ORIGINAL",
    "DICT_ARUCO_MIP_36h12", "DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9",
)  # fmt: skip
_SIZES = (50, 100, 250, 1000)
_LEAST_MARKERS, _CERTAIN = 4, 8  # other dictionaries see one or two of a board's markers
_TRIES = 60  # of RANSAC: with 15 % of wrong markers one in a thousand searches sees no good four in 9
_SEARCHED = 4  # images in which the dictionary is looked for
_LONGEST_SIDE = 2000  # px: markers of 20 px are still seen
_WIDEST = 60  # columns that are tried
# Markers whose centres are off the plane by more than this part of a square are no part of the layout; a lens of 150
# degrees bends the grid by up to 0.43.
_OFF = 0.45
_MOST_WRONG = 0.15  # of the markers, such as those of another board in view
_SAME_LENGTH = 0.1  # of a marker's side as seen through a lens that is not known
_AS_GOOD = 0.02  # shares of markers that differ by less are alike


@dataclass(frozen=True)
class Markers:
    """The markers of one dictionary, ids (n,) and corners (n,4,2) px by image; white, mirrored, their black border."""

    dictionary: str
    border: int
    inverted: bool
    mirrored: bool
    images: tuple[tuple[IntArray, FloatArray], ...]

    @property
    def ids(self) -> IntArray:
        """All ids that were seen."""
        return np.unique(np.concatenate([ids for ids, _ in self.images]))

    def words(self) -> Phrase:
        """What was seen in words."""
        ids = self.ids
        values = {"count": len(ids), "dictionary": self.dictionary, "first": int(ids[0]), "last": int(ids[-1])}
        return Phrase("seen-inverted" if self.inverted else "seen-markers", values)


def look_for_markers(images: Sequence[GreyImage]) -> Markers | None:
    """The markers of the dictionary of which most are seen, in images of 8 bits, and lie as on a board; else None."""
    small = [_small(image, _LONGEST_SIDE) for image in images]
    for mirrored in (False, True):
        settings = _most_seen(small, mirrored)
        if settings is None:
            continue
        found = _named(Markers(*settings, mirrored, tuple(_markers(one, *settings, mirrored) for one in small)))
        if next(boards_of(found), None) is not None:
            return found
    return None


_Setting = tuple[str, int, bool]  # family, border, inverted


def _most_seen(images: Sequence[Grey], mirrored: bool) -> _Setting | None:
    """The setting that sees most in the first image in which any sees enough."""
    settings = [
        (family, border, inverted)
        for inverted in (False, True)
        for family in _FAMILIES
        for border in ((2, 1) if family == APRILTAGS else (1,))
    ]
    for image in images[:_SEARCHED]:
        best, most = settings[0], 0
        for one in settings:
            count = len(_markers(image, *one, mirrored)[0])
            if count > most:
                best, most = one, count
            if most >= _CERTAIN:
                break
        if most >= _LEAST_MARKERS:
            return best
    return None


def _named(markers: Markers) -> Markers:
    """With the smallest dictionary of the family that has all ids."""
    stem, _, size = markers.dictionary.rpartition("_")
    if size != "1000":
        return markers
    return replace(markers, dictionary=next(f"{stem}_{n}" for n in _SIZES if markers.ids[-1] < n))


def _small(image: GreyImage, longest: int) -> Grey:
    grey = np.asarray(image, dtype=np.uint8)
    scale = longest / max(grey.shape)
    if scale < 1:
        grey = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return grey


def _markers(image: Grey, family: str, border: int, inverted: bool, mirrored: bool) -> tuple[IntArray, FloatArray]:
    seen = np.ascontiguousarray(image[:, ::-1]) if mirrored else image
    settings = cv2.aruco.DetectorParameters()
    settings.markerBorderBits = border
    detector = cv2.aruco.ArucoDetector(marker_dictionary(family), settings)
    corners, ids, _ = detector.detectMarkers(np.asarray(255 - seen, np.uint8) if inverted else seen)
    if ids is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2))
    return np.asarray(ids, dtype=np.int64).ravel(), np.asarray(corners, dtype=float).reshape(-1, 4, 2)


def boards_of(markers: Markers) -> Iterator[dict[str, Any]]:
    """The boards that can have these markers, likeliest first: fields of session.json's `board` without lengths.

    `part`: the side of a marker over a square's (ChArUco) or over the pitch (AprilGrid). Of boards that explain as many
    markers the one with fewest rows is likeliest: it begins with a marker that was seen.
    """
    tried = []
    for first in dict.fromkeys((0, int(markers.ids[0]))):
        for columns in range(2, _WIDEST + 1):
            for kind in ("charuco-0", "charuco-1", "aprilgrid"):
                made = _laid(markers, kind, columns, first)
                if made is not None:
                    tried.append(made)
    most = max((share for share, _ in tried), default=0.0)
    yield from sorted((board for share, board in tried if share > most - _AS_GOOD), key=lambda board: board["rows"])


def _laid(markers: Markers, kind: str, columns: int, first: int) -> tuple[float, dict[str, Any]] | None:
    """The share of markers that lie where this layout says, and the board; None where it does not fit."""
    fits, count, parts, upward, last_row = 0, 0, [], [], 0
    for ids, corners in sorted(markers.images, key=lambda one: -len(one[0])):
        if count and fits < (1 - _MOST_WRONG) * count:
            return None  # the image with most markers has decided
        own = ids - first
        count += len(own)
        if len(own) < _LEAST_MARKERS or own.min() < 0:
            continue
        place = _places(own, columns, kind)
        # roughly a square's side in px: markers are a half to nine tenths of it
        step = 1.4 * float(np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)))
        seen, inside = cv2.findHomography(place, corners.mean(axis=1), cv2.RANSAC, _OFF * step, None, _TRIES)
        if seen is None or inside is None or inside.sum() < _LEAST_MARKERS or not np.isfinite(seen).all():
            continue
        good = inside.ravel() > 0
        if abs(np.linalg.det(seen)) < 1e-12:
            continue
        fits += int(good.sum())
        upward.append(float(np.linalg.det(seen)) < 0)
        back = cv2.perspectiveTransform(corners[good].reshape(-1, 1, 2), np.linalg.inv(seen)).reshape(-1, 4, 2)
        parts.append(np.linalg.norm(back - np.roll(back, 1, axis=1), axis=2).ravel())
        last_row = max(last_row, int(place[good, 1].max()))
    if not count or not parts or fits < (1 - _MOST_WRONG) * count or len(set(upward)) > 1:
        return None
    part = float(np.median(np.concatenate(parts)))
    rows, turned = last_row + 1, upward[0]
    common = {"dictionary": markers.dictionary} | ({"polarity": "light-on-dark"} if markers.inverted else {})
    common |= {"first_id": first} if first else {}
    if kind == "aprilgrid":
        board = {"kind": kind, "rows": rows, "columns": columns, "part": part, **common}
        board |= {} if turned else {"rows_upward": False}
        return (fits / count, board) if part < 1 and rows > 1 else None
    if turned or not part < 1:
        return None
    legacy = kind == "charuco-0"
    rows += legacy and rows % 2 == 1  # only with an even number does the first square have a marker
    rows = max(rows, 3)
    board = {"kind": "charuco", "rows": rows - 1, "columns": columns - 1, "part": part, **common}
    return (fits / count, board | ({"legacy": True} if legacy else {})) if columns > 2 else None


def _places(own: IntArray, columns: int, kind: str) -> FloatArray:
    """Column and row (n, 2) of markers by their number on the board."""
    if kind == "aprilgrid":
        row, column = np.divmod(own, columns)
        return np.column_stack([column, row]).astype(float)
    phase = int(kind[-1])  # the column of the first row's first marker
    even = (columns + 1 - phase) // 2
    pair, rest = np.divmod(own, columns)
    odd = rest >= even
    column = 2 * np.where(odd, rest - even, rest) + np.where(odd, 1 - phase, phase)
    return np.column_stack([column, 2 * pair + odd]).astype(float)


def look_for_chessboard(images: Sequence[GreyImage]) -> tuple[int, int] | None:
    """Rows and columns of inner corners of the largest chessboard that is seen; None where none is."""
    seen: dict[tuple[int, int], int] = {}
    for image in images:
        grid = largest_chessboard(_small(image, 1200))
        if grid is not None:
            rows, columns = sorted(grid.shape[:2])
            seen[rows, columns] = seen.get((rows, columns), 0) + 1
    return max(seen, key=lambda size: (seen[size], size)) if seen else None


def with_lengths(board: Mapping[str, Any], pitch_mm: float, marker_mm: float | None) -> dict[str, Any]:
    """The board with its lengths: the marker's as given where that can be, else as it was seen."""
    made = {key: value for key, value in board.items() if key != "part"}
    made["pitch_mm"] = pitch_mm
    if "part" in board:
        seen = board["part"] * pitch_mm
        given = marker_mm is not None and abs(marker_mm - seen) <= _SAME_LENGTH * seen
        made["marker_mm"] = marker_mm if given else round(seen, 3)
    return made


def as_text(board: Mapping[str, Any]) -> str:
    """The fields of a board in one line, as `--board` takes them."""
    words = {True: "true", False: "false"}
    rest = [f"{k}={words[v] if isinstance(v, bool) else v}" for k, v in board.items() if k not in ("kind", "rings")]
    rings = ["rings=" + "+".join(f"{r}:{c}" for r, c in board["rings"])] if board.get("rings") else []
    return ",".join([str(board["kind"]), *rest, *rings])
