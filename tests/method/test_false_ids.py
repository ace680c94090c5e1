"""What is no target gets no id: random dots, rooms, foreign targets, photographs (benchmarks/studies has the rest)."""

from dataclasses import replace
from pathlib import Path
from typing import cast

import cv2
import numpy as np
import pytest

from benchmarks.studies.detection_clusters import CLUSTERS, dots_image
from benchmarks.studies.detection_false import (
    POLARITIES,
    Tally,
    detector,
    drawn,
    empty_room_image,
    look_for_all,
    photographs,
)
from benchmarks.studies.detection_scenes import THREE_MP, aimed_view
from spherecal.targets.blobs import GreyImage, find_blobs
from spherecal.targets.detection import Detector
from spherecal.targets.family import CODE_COUNT, make_target_set
from spherecal.targets.images import read_image
from spherecal_sim.render_session import CLUTTERED, RENDERED

SMALL = (640, 480)


def tally(kind, images: int) -> Tally:
    return sum((drawn(kind, seed) for seed in range(images)), Tally())


def test_random_dense_dots_get_no_id() -> None:
    made = dots_image("anywhere", make_target_set(CODE_COUNT), np.random.default_rng(0))
    assert len(find_blobs(made.image)) > 6 * CLUSTERS  # the dots are such that a detector sees
    assert tally("anywhere", 40).wrong == 0


def test_random_dots_on_the_code_lattice_seldom_get_an_id() -> None:
    # seven or eight of them may lie exactly as those of a code: 2 in 1200 clusters of 8 to 16 dots
    assert tally("lattice", 40).wrong <= 3


def test_damaged_targets_get_their_own_id_or_none() -> None:
    damaged = tally("damaged", 20)
    assert damaged.wrong == 0
    assert damaged.right > 0.3 * damaged.clusters


@pytest.mark.parametrize("seed", [0, 1])
def test_a_room_full_of_white_discs_gets_no_id(seed: int) -> None:
    image = empty_room_image(seed, blobs=(3000, 6000), size=SMALL)
    assert len(find_blobs(image)) > 10
    assert look_for_all(image, POLARITIES) == 0


def test_targets_of_another_set_get_no_id() -> None:
    kind = replace(THREE_MP, image_size=SMALL)
    view = aimed_view(1, kind, 1100.0, options=replace(RENDERED, targets=100))
    image = view.render(CLUTTERED, 0).image
    shown = detector().detect(image).target_ids
    assert len(shown) > 3 and shown.max() <= 100
    others = Detector(make_target_set(CODE_COUNT - 100, start_id=101))
    assert len(others.detect(image).target_ids) == 0


def test_photographs_of_packages_get_no_id() -> None:
    paths = [path for source, path in photographs() if source == "matplotlib"]
    assert paths
    for path in paths:
        image = read_image(path)
        if min(image.shape) >= 200:
            assert look_for_all(image, POLARITIES) == 0, path


def test_photographs_of_a_dot_board_get_no_id(shared_data: Path) -> None:
    folder = shared_data / "dotboard"
    if not folder.is_dir():
        pytest.skip(f"no photographs of the dot board in {shared_data}")
    paths = sorted(folder.glob("*.jpeg"))[::4]
    assert paths
    for path in paths:
        image = read_image(path)
        assert len(find_blobs(image, dark=True)) >= 40  # 72 to 80 dots show
        assert look_for_all(image, POLARITIES) == 0, path


def test_the_grid_of_a_dot_board_is_no_target_with_a_hidden_dot(shared_data: Path) -> None:
    """At half size seven dots of this picture's grid fit a code to 0.03 mm, but not as sharp round dots."""
    image = read_image(shared_data / "dotboard" / "CalB-sys2-0001_1.jpeg")
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    assert look_for_all(cast(GreyImage, half), ("dark-on-light",)) == 0
