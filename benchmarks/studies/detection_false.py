"""Where no target is: rooms, tags, foreign targets, random dots and photographs must give no ids."""

import importlib.util
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from spherecal.base.arrays import IntArray
from spherecal.base.errors import InputError
from spherecal.targets.blobs import GreyImage
from spherecal.targets.detection import Detections, Detector
from spherecal.targets.family import CODE_COUNT, make_target_set
from spherecal.targets.images import read_image
from spherecal.targets.target_set import Polarity, TargetSet
from spherecal_sim.dot_truth import TrueDots
from spherecal_sim.optics import Image, Sensor, expose
from spherecal_sim.render_session import CLUTTERED, RENDERED, render_image

from .detection_backgrounds import blurred, speckle
from .detection_clusters import CLUSTERS, Kind, dots_image
from .detection_scenes import THREE_MP, THREE_MP_DISTANCE_MM, View, aimed_view, kept, kept_image
from .detection_tags import render_tags

_ON_BALL = 144  # targets on a ball whose ids are not those looked for
POLARITIES: tuple[Polarity, ...] = ("light-on-dark", "dark-on-light")
SCALES = (0.5, 1.0, 2.0)  # of photographs
_FILTERS = (cv2.INTER_LINEAR, cv2.INTER_AREA)
_SMALLEST_PX = 72
SPECKLED_SIZE = (640, 480)  # px; 600 to 1800 specks
_PHOTOGRAPHS = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"}


@dataclass(frozen=True)
class Tally:
    """Images looked at, clusters of dots in them, targets detected that are there and that are not."""

    images: int = 0
    clusters: int = 0
    right: int = 0
    wrong: int = 0

    def __add__(self, other: "Tally") -> "Tally":
        return Tally(
            self.images + other.images,
            self.clusters + other.clusters,
            self.right + other.right,
            self.wrong + other.wrong,
        )


def look_for_all(image: GreyImage, polarities: tuple[Polarity, ...] = ("light-on-dark",)) -> int:
    """How many targets of the whole family a detector takes an image to have."""
    return sum(len(detector(polarity).detect(image).target_ids) for polarity in polarities)


@cache
def detector(polarity: Polarity = "light-on-dark") -> Detector:
    """One for the whole family, made once."""
    return Detector(make_target_set(CODE_COUNT, polarity=polarity))


# --- rendered ------------------------------------------------------------------------------------------------------


def empty_room(seed: int) -> Tally:
    """A room full of white discs of the dots' sizes, in groups; no ball."""
    return Tally(images=1, wrong=look_for_all(kept_image(f"room-{seed}", lambda: empty_room_image(seed))))


def empty_room_image(seed: int, blobs: tuple[int, int] = (500, 6000), size: tuple[int, int] | None = None) -> Image:
    """The room in the light of rig A, seen by one of its cameras."""
    rng = np.random.default_rng(seed)
    kind = THREE_MP if size is None else replace(THREE_MP, image_size=size)
    view = aimed_view(seed, kind, THREE_MP_DISTANCE_MM, seed % 4, seed % 10)
    settings = replace(CLUTTERED, blobs=int(rng.integers(*blobs)), ambient=float(rng.uniform(0.1, 0.6)))
    scene = view.scene(settings)._replace(ball_radius=0.0)
    return render_image(scene, _no_dots(), view.station, settings, rng).image


def _no_dots() -> TrueDots:
    none = np.empty(0, dtype=int)
    return TrueDots(none, none, np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 32, 3)), np.empty((0, 4, 3)))


def tags(seed: int) -> Tally:
    """The ball with AprilTags 36h11 on its stickers."""
    image = kept_image(f"tags-{seed}", lambda: render_tags(_view(seed), CLUTTERED, seed)[0])
    return Tally(images=1, wrong=look_for_all(image))


def foreign_targets(seed: int) -> Tally:
    """The ball with targets 1 to 144, looked at for targets 145 to 344 only."""
    view = _view(seed, _ON_BALL)
    picture = kept(f"foreign-{seed}", lambda: view.render(CLUTTERED, seed))
    wanted = Detector(make_target_set(CODE_COUNT - _ON_BALL, start_id=_ON_BALL + 1))
    return Tally(images=1, wrong=len(wanted.detect(picture.image).target_ids))


def _view(seed: int, count: int = 200) -> View:
    options = replace(RENDERED, targets=count)
    return aimed_view(1000 + seed, THREE_MP, THREE_MP_DISTANCE_MM, seed % 4, seed % 10, options)


# --- drawn ---------------------------------------------------------------------------------------------------------


def drawn(kind: Kind, seed: int) -> Tally:
    """One image of dots (see `dots_image`) searched for all targets of the family."""
    made = dots_image(kind, _family(), np.random.default_rng([seed, len(kind)]))
    found = detector().detect(made.image)
    right = _at_their_places(found, made.ids, made.middles)
    return Tally(1, CLUSTERS, right, len(found.target_ids) - right)


@cache
def _family() -> TargetSet:
    return make_target_set(CODE_COUNT)


def _at_their_places(found: Detections, ids: IntArray, middles: np.ndarray) -> int:
    """Detected targets whose middles lie in the cell of a target of that id."""
    right = 0
    for target in found.target_ids:
        middle = found.uv[found.target == target].mean(axis=0)
        near = middles[ids == target]
        right += bool(len(near)) and bool(np.linalg.norm(near - middle, axis=1).min() < 50.0)
    return right


def speckled(seed: int) -> Tally:
    """A background of white specks of the dots' sizes, dense and at random, searched for all targets of the family."""
    rng = np.random.default_rng([seed, 17])
    light = blurred(speckle(SPECKLED_SIZE, rng), seed)
    image = expose(np.float32(rng.uniform(0.3, 1.2)) * light, Sensor(), rng)
    return Tally(images=1, wrong=look_for_all(image))


# --- photographed ----------------------------------------------------------------------------------------------------


def photographs() -> list[tuple[str, Path]]:
    """Photographs at hand, with where they come from.

    The dot board of SPHERECAL_DATA, the sample pictures of packages that are installed, and the folders in the folder
    SPHERECAL_PHOTOGRAPHS, each by its name.
    """
    found = [(source, path) for source, folder in _folders() for path in sorted(folder.rglob("*"))]
    return [(source, path) for source, path in found if path.suffix.lower() in _PHOTOGRAPHS]


def _folders() -> Iterator[tuple[str, Path]]:
    if data := os.environ.get("SPHERECAL_DATA"):
        yield "dotboard", Path(data) / "dotboard"
    for package, folder in (
        ("matplotlib", "mpl-data/sample_data"),
        ("skimage", "data"),
        ("sklearn", "datasets/images"),
    ):
        spec = importlib.util.find_spec(package)
        if spec is not None and spec.origin is not None:
            yield package, Path(spec.origin).parent / folder
    if given := os.environ.get("SPHERECAL_PHOTOGRAPHS"):
        for folder in sorted(Path(given).iterdir()):
            if folder.is_dir():
                yield folder.name, folder


def photographed(path: Path) -> Tally:
    """A photograph at three sizes, for light and dark targets; no images where the file cannot be read."""
    try:
        image = read_image(path)
    except InputError:
        return Tally()
    wrong = images = 0
    for scale in SCALES:
        size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
        if min(size) < _SMALLEST_PX or size[0] * size[1] > 25e6:
            continue
        scaled = image if scale == 1 else cv2.resize(image, size, interpolation=_FILTERS[scale < 1])
        wrong += look_for_all(cast(GreyImage, scaled), POLARITIES)
        images += len(POLARITIES)
    return Tally(images=images, wrong=wrong)
