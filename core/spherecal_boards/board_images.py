"""Boards found in the images of a session: circles, chessboard corners, ChArUco corners or corners of tags."""

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from spherecal.base.arrays import FloatArray, IntArray
from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import Observations
from spherecal.data.session import Session
from spherecal.targets.blobs import GreyImage
from spherecal.targets.detection import Detections, DetectionSettings
from spherecal.targets.images import check_size, read_image
from spherecal.targets.masks import masked
from spherecal_boards import looking
from spherecal_boards.aprilgrid import find_aprilgrid
from spherecal_boards.board_pattern import BoardPattern, charuco_board
from spherecal_boards.chessboard import find_chessboard
from spherecal_boards.circles import find_circles
from spherecal_boards.lattice import label_board, label_shifted
from spherecal_boards.pattern_entry import board_pattern
from spherecal_files.json_file import JsonValue

STAGE = "finding boards"
_FIRST = 20  # images, spread over the recording, of which one at least must show the board


@dataclass(frozen=True)
class FoundBoard:
    """The points of a board in one image: row-major index (k,), uv (k,2) px; dots' diameter over their pitch."""

    index: IntArray
    uv: FloatArray
    diameter: float = float("nan")


@dataclass(frozen=True)
class BoardImages:
    """All boards found: observations (target = row-major index, point `centre`); (placement, camera) without one."""

    observations: Observations
    missed: tuple[tuple[str, str], ...]
    images: int
    diameter: float


def find_boards(session: Session, pattern: BoardPattern, context: Context) -> BoardImages:
    """The board in all images of the placements."""
    index = {camera.id: c for c, camera in enumerate(session.cameras)}
    jobs = [
        (p, index[camera], path)
        for p, placement in enumerate(session.placements)
        for camera, path in sorted(placement.images.items(), key=lambda item: index[item[0]])
    ]
    if not jobs:
        raise InputError(Phrase("error-no-board-images", {"folder": session.where}))
    found: dict[int, FoundBoard | None] = {}
    for some in (spread(len(jobs), _FIRST), range(len(jobs))):  # first some of all the recording
        _find_all(session, pattern, jobs, [number for number in some if number not in found], found, context)
        if not any(found.values()):
            tried = sorted(found)[:: max(1, len(found) // looking.LOOKED_AT)][: looking.LOOKED_AT]
            hint = what_would_fit([eight_bits(read_image(jobs[number][2])) for number in tried], pattern)
            values = {"folder": session.where, "images": len(jobs), "tried": len(found)}
            what = "error-board-not-found" if len(found) == len(jobs) else "error-board-not-in-first"
            raise InputError(Phrase(what, values), hint)
    return _collect(session, jobs, [found[number] for number in range(len(jobs))])


def spread(count: int, most: int) -> list[int]:
    """At most so many numbers below a count, evenly spread."""
    taken = min(most, count)
    return [round(i * (count - 1) / max(taken - 1, 1)) for i in range(taken)]


def _find_all(
    session: Session,
    pattern: BoardPattern,
    jobs: list[tuple[int, int, Path]],
    numbers: list[int],
    found: dict[int, FoundBoard | None],
    context: Context,
) -> None:
    """Look for the board in these images, and put what is found into `found`."""
    finder = _finder(pattern)

    def look(number: int) -> FoundBoard | None:
        _, camera, path = jobs[number]
        image = read_image(path)
        check_size(path, image, session.cameras[camera].image_size)
        return finder(image)

    with ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="board") as pool:
        try:
            for number, result in zip(numbers, pool.map(look, numbers), strict=True):
                found[number] = result
                where = Phrase("image-of", {"number": len(found), "images": len(jobs)})
                context.report(STAGE, (len(found) - 1) / len(jobs), where)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def what_would_fit(images: list[NDArray[np.uint8]], pattern: BoardPattern) -> Phrase:
    """What images of 8 bits show in which a board was not found, and the board that is found in them."""
    if pattern.kind in ("circles", "asymmetric-circles"):
        return Phrase("board-fields", {"fields": ["kind", "rows", "columns", "polarity", "rings"]})
    if pattern.kind == "chessboard" and (fit := _fitting(images, None, pattern)):
        return fit  # looking for markers of all dictionaries takes 10 s an image
    markers = looking.look_for_markers(images)
    if markers is not None and markers.mirrored:
        return Phrase("board-mirrored", {"seen": markers.words()})
    if fit := _fitting(images, markers, pattern):
        return fit
    if markers is not None:
        return Phrase("board-other-seen", {"seen": markers.words()})
    return Phrase("board-nothing-seen", {"images": len(images)})


def _fitting(images: list[NDArray[np.uint8]], markers: looking.Markers | None, pattern: BoardPattern) -> Phrase | None:
    """The board that is found in some of the images in place of the described one."""
    for entry in seen_boards(images, markers, pattern.pitch_mm, pattern.marker_mm):
        if entry.get("dictionary", "").rpartition("_")[0] == pattern.dictionary.rpartition("_")[0] != "":
            entry["dictionary"] = max(entry["dictionary"], pattern.dictionary, key=lambda name: (len(name), name))
        finder = _finder(board_pattern(JsonValue(entry, Path("board"), "board")))
        fitting = sum(finder(image) is not None for image in images)
        if fitting:
            seen = Phrase("seen-chessboard", entry) if markers is None else markers.words()
            values = {"seen": seen, "images": len(images), "fitting": fitting, "board": looking.as_text(entry)}
            return Phrase("board-would-fit", values)
    return None


def look_for_board(images: list[NDArray[np.uint8]], known: Mapping[str, Any]) -> dict[str, Any]:
    """The board that images of 8 bits show, as entry of session.json, from what is known: kind, pitch and what else."""
    markers = None if known["kind"] == "chessboard" else looking.look_for_markers(images)
    if markers is not None and markers.mirrored:
        mirrored = Phrase("board-mirrored", {"seen": markers.words()})
        raise InputError(Phrase("error-no-board-seen", {"images": len(images)}), mirrored)
    for entry in seen_boards(images, markers, known["pitch_mm"], known.get("marker_mm")):
        if entry["kind"] == known["kind"]:
            return {**entry, **known}
    hint = Phrase("board-nothing-seen", {"images": len(images)})
    hint = hint if markers is None else Phrase("board-other-seen", {"seen": markers.words()})
    raise InputError(Phrase("error-no-board-seen", {"images": len(images)}), hint)


def seen_boards(
    images: list[NDArray[np.uint8]], markers: looking.Markers | None, pitch_mm: float, marker_mm: float | None
) -> Iterator[dict[str, Any]]:
    """The boards that images can show, as entries of session.json, likeliest first."""
    if markers is not None:
        yield from (looking.with_lengths(board, pitch_mm, marker_mm) for board in looking.boards_of(markers))
    elif (size := looking.look_for_chessboard(images)) is not None:
        yield {"kind": "chessboard", "rows": size[0], "columns": size[1], "pitch_mm": pitch_mm}


def find_board(image: GreyImage, pattern: BoardPattern) -> FoundBoard | None:
    """The board in one grey image of 8 or 16 bits; None where it is not seen, or is ambiguous."""
    return _finder(pattern)(image)


def _collect(session: Session, jobs: list[tuple[int, int, Path]], found: list[FoundBoard | None]) -> BoardImages:
    hits = [(job, board) for job, board in zip(jobs, found, strict=True) if board is not None]
    missed = tuple(
        (session.placements[p].id, session.cameras[c].id)
        for (p, c, _), board in zip(jobs, found, strict=True)
        if board is None
    )
    counts = [len(board.index) for _, board in hits]
    diameters = [board.diameter for _, board in hits if np.isfinite(board.diameter)]
    observations = Observations(
        tuple(placement.id for placement in session.placements),
        tuple(camera.id for camera in session.cameras),
        ("centre",),
        np.repeat([p for (p, _, _), _ in hits], counts),
        np.repeat([c for (_, c, _), _ in hits], counts),
        np.concatenate([board.index for _, board in hits]),
        np.zeros(sum(counts), dtype=np.int64),
        # no sigmas: what dots are off by is print, alike for all, and ten times what their rims show
        np.concatenate([board.uv for _, board in hits]),
    )
    return BoardImages(observations, missed, len(jobs), float(np.median(diameters)) if diameters else float("nan"))


Finder = Callable[[GreyImage], FoundBoard | None]


def _finder(pattern: BoardPattern) -> Finder:
    if pattern.kind in ("circles", "asymmetric-circles"):
        return lambda image: _find_circles(image, pattern)
    find = {"aprilgrid": _find_tags, "chessboard": _find_chessboard, "charuco": _find_charuco}[pattern.kind]

    def of_colours(image: GreyImage) -> FoundBoard | None:
        grey = eight_bits(image)
        return find(np.asarray(255 - grey, np.uint8) if pattern.light else grey, pattern)

    return of_colours


def eight_bits(image: GreyImage) -> NDArray[np.uint8]:
    """The image stretched to 8 bits, for OpenCV's finders."""
    if image.dtype == np.uint8:
        return image.astype(np.uint8, copy=False)
    low, high = np.percentile(image, (0.1, 99.9))
    return np.clip((image - low) * (255 / max(high - low, 1)), 0, 255).astype(np.uint8)


def _find_circles(image: GreyImage, pattern: BoardPattern) -> FoundBoard | None:
    circles = find_circles(image, pattern.light)
    if pattern.kind == "asymmetric-circles":
        labelled = label_shifted(circles, pattern.rows, pattern.columns, pattern.rows_upward)
    else:
        labelled = label_board(circles, pattern.rows, pattern.columns, pattern.rings, pattern.rows_upward)
    if labelled is None:
        return None
    index = labelled.place @ (pattern.columns, 1)
    order = np.argsort(index)
    index, rows = index[order], labelled.circle[order]
    if pattern.kind == "asymmetric-circles":  # a square lattice along its diagonals
        row, column = labelled.place[order].T
        across = 2 * column + row % 2
        diagonal = np.column_stack([row + across, row - across]) // 2
        return FoundBoard(index, circles.uv[rows], 2**0.5 * _diameter(diagonal, circles, rows))
    return FoundBoard(index, circles.uv[rows], _diameter(labelled.place[order], circles, rows))


def _find_tags(image: NDArray[np.uint8], pattern: BoardPattern) -> FoundBoard | None:
    found = find_aprilgrid(image, pattern)
    return None if found is None else FoundBoard(*found)


def _diameter(place: IntArray, circles, rows: IntArray) -> float:
    """Diameter of the dots over their pitch: areas of the dots against those of the lattice's cells."""
    at = {tuple(p): uv for p, uv in zip(place.tolist(), circles.uv[rows], strict=True)}
    ratios = []
    for (row, column), axes in zip(place.tolist(), circles.semi_axes[rows], strict=True):
        ends = [at.get(p) for p in ((row, column - 1), (row, column + 1), (row - 1, column), (row + 1, column))]
        if all(end is not None for end in ends):
            left, right, up, down = (np.asarray(end) for end in ends)
            across, along = (right - left) / 2, (down - up) / 2
            cell = abs(across[0] * along[1] - across[1] * along[0])
            ratios.append(2 * np.sqrt(axes.prod() / cell))
    return float(np.median(ratios)) if ratios else float("nan")


def _find_chessboard(image: NDArray[np.uint8], pattern: BoardPattern) -> FoundBoard | None:
    grid = find_chessboard(image, pattern)
    return None if grid is None else FoundBoard(np.arange(pattern.rows * pattern.columns), grid.reshape(-1, 2))


def _find_charuco(image: NDArray[np.uint8], pattern: BoardPattern) -> FoundBoard | None:
    corners, ids, _, _ = cv2.aruco.CharucoDetector(charuco_board(pattern)).detectBoard(image)
    if ids is None or len(ids) < 4:
        return None
    index = np.asarray(ids, dtype=np.int64).ravel()
    order = np.argsort(index)
    return FoundBoard(index[order], np.asarray(corners, dtype=float).reshape(-1, 2)[order])


_POINTS = ("centre",)
# Nominal, since the finders state none; what a board's points are off by is its print, alike for all (board_images).
_SIGMA_PX = 0.1


class BoardDetector:
    """Finds the points of one board in images: each a target of the point's row-major index with one dot, `centre`."""

    def __init__(self, pattern: BoardPattern) -> None:
        self._pattern = pattern

    def detect(self, image: GreyImage, settings: DetectionSettings | None = None) -> Detections:
        """The board's points in a grey image (h, w) of 8 or 16 bits; none where it is not seen. Blur: unknown (NaN)."""
        found = find_board(np.require(image, requirements=["C"]), self._pattern)
        if found is None:
            return _detections(np.empty(0, np.int64), np.empty((0, 2)))
        keep = ~masked(found.uv, settings.ignore if settings is not None else ())
        return _detections(found.index[keep], found.uv[keep])


def _detections(index: IntArray, uv: np.ndarray) -> Detections:
    unknown = np.full(len(index), np.nan)
    point, sigma = np.zeros(len(index), np.int64), np.full(uv.shape, _SIGMA_PX)
    return Detections(_POINTS, index, point, uv, sigma, index, unknown, unknown, unknown)
