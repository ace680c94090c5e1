"""Masks: what lies in a rectangle of a camera's image is no target, wherever detection is asked."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.detect.session_images import observed
from spherecal.targets.detection import DetectionSettings, Detector
from spherecal.targets.masks import masked
from spherecal.targets.staying_spots import staying_spots
from spherecal_cameras.simulated.simulated_source import SimulatedSource
from spherecal_files.read_session import read_session
from spherecal_files.session_json import session_json


def test_a_rectangle_holds_its_border_and_nothing_beyond():
    uv = np.array([[10.0, 20.0], [30.0, 25.0], [30.1, 25.0], [9.9, 20.0], [np.nan, np.nan]])
    assert masked(uv, [(10.0, 20.0, 20.0, 5.0)]).tolist() == [True, True, False, False, False]
    assert not masked(uv, []).any()


@pytest.fixture(scope="module")
def source() -> SimulatedSource:
    made = SimulatedSource("demo")
    made.open(["SIM-C01"], {})
    return made


def picture(source: SimulatedSource) -> np.ndarray:
    return source.capture_set().frames["SIM-C01"].image


def test_dots_in_a_mask_are_not_found_and_all_others_are_as_before(source):
    target_set, image = source.stage.session.target_set, picture(source)
    assert target_set is not None
    detector = Detector(target_set)
    free = detector.detect(image)
    low, high = np.percentile(free.uv, (20, 60), axis=0)
    mask = (float(low[0]), float(low[1]), *(high - low).tolist())
    found = detector.detect(image, DetectionSettings(ignore=(mask,)))
    kept = ~masked(free.uv, [mask])
    assert 0 < kept.sum() < len(free)
    assert np.array_equal(found.uv, free.uv[kept]) and np.array_equal(found.target, free.target[kept])
    assert set(found.target_ids.tolist()) == set(found.target.tolist()), "a target without a dot is none"


@pytest.fixture(scope="module")
def placements(source) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Images of four placements of the ball, rendered, and where the targets are in them."""
    images = []
    for name in ("P1", "P2", "P3", "P4"):
        source.show(name)
        images.append(picture(source))
    detector = Detector(source.stage.session.target_set)
    return images, [detector.detect(image).uv for image in images]


def with_lamps(image: np.ndarray) -> np.ndarray:
    lit = image.copy()
    cv2.circle(lit, (90, 70), 48, 255, -1)
    cv2.circle(lit, (1000, 824), 20, 255, -1)
    return lit


def test_lamps_that_stay_while_the_ball_moves_are_proposed_and_nothing_else(placements):
    images, dots = placements
    lit = [with_lamps(image) for image in images]
    spots = staying_spots(lit, dots)
    assert len(spots) == 2
    for (u, v), radius, (left, top, width, height) in zip(((90, 70), (1000, 824)), (48, 20), spots, strict=True):
        assert left <= u - radius and u + radius <= left + width and max(width, height) < 2 * radius + 8
        assert top <= v - radius and v + radius <= top + height


def test_nothing_is_proposed_where_nothing_stays_and_never_the_ball(placements):
    images, dots = placements
    assert staying_spots(images, dots) == ()
    for image, uv in zip(images, dots, strict=True):
        assert staying_spots([image] * 4, [uv] * 4) == (), "a ball that was never moved"
        half = uv[uv[:, 0] < np.median(uv[:, 0])]
        assert staying_spots([image] * 4, [half] * 4) == (), "nor where half of its stickers were read"
        assert staying_spots([with_lamps(image)] * 4, [uv[:19]] * 4) == (), "it is not known where the ball is"
    assert staying_spots([with_lamps(images[0])], dots[:1]) == (), "one placement tells nothing"


def write(folder: Path, source: SimulatedSource, ignore: object) -> None:
    from PIL import Image

    from spherecal_files.target_set_file import write_target_set

    session = source.stage.session
    assert session.target_set is not None
    write_target_set(folder / "targets.json", session.target_set)
    Image.fromarray(picture(source)).save(folder / "C01.png")
    camera = session_json(session, session.folder)["cameras"][0]
    document = {
        "format": "spherecal/session", "version": 1, "cameras": [{**camera, "ignore": ignore}],
        "target_set": "targets.json", "placements": [{"id": "P1", "images": {"C01": "C01.png"}}],
    }  # fmt: skip
    (folder / "session.json").write_text(json.dumps(document))


def test_a_session_keeps_its_masks_and_detection_heeds_them(tmp_path, source):
    write(tmp_path, source, [[0, 0, 5000, 400.5], [10, 10, 2, 2]])
    session = read_session(tmp_path)
    assert session.cameras[0].ignore == ((0.0, 0.0, 5000.0, 400.5), (10.0, 10.0, 2.0, 2.0))
    assert session_json(session, tmp_path)["cameras"][0]["ignore"] == [[0, 0, 5000, 400.5], [10, 10, 2, 2]]
    found = observed(session, Context()).observations
    assert found is not None and len(found) and found.uv[:, 1].min() > 400.5
    bare = replace(session, cameras=(replace(session.cameras[0], ignore=()),))
    everything = observed(bare, Context()).observations
    assert everything is not None and everything.uv[:, 1].min() < 400.5


@pytest.mark.parametrize("wrong", [[[0, 0, 0, 5]], [[1, 2, 3]], [["a", 0, 1, 1]], "all"])
def test_a_wrong_mask_is_refused_with_its_place(tmp_path, source, wrong):
    write(tmp_path, source, wrong)
    with pytest.raises(InputError, match="ignore"):
        read_session(tmp_path)
