"""Dots that are followed from image to image: where they are, what is refused, and the live overlay by it."""

import time
from dataclasses import replace
from typing import cast

import cv2
import numpy as np
import pytest

from spherecal.targets.detection import Detections, Detector
from spherecal.targets.following import Follower
from spherecal_cameras.capture import SessionCamera
from spherecal_cameras.plan import CapturePlan
from spherecal_cameras.protocol import CameraSource, Discovery, Frame
from spherecal_gui.tasks.live_detection import Connection, LiveView
from tests.method.test_targets_detection import DETECTOR, FAR, TARGETS, drawn, view_of

IDS = [3, 17, 42, 58, 99, 123]


def scene(ids: list[int], tilt: float, turn: float) -> np.ndarray:
    image = drawn(ids, [view_of(tilt * i, turn * i) for i in range(6)]).image()
    return cv2.copyMakeBorder(image, 80, 80, 80, 80, cv2.BORDER_CONSTANT, value=60)


IMAGE, OTHER = scene(IDS, 11, 25), scene([5, 6, 7, 8, 9, 10], 8, 70)
FOUND = DETECTOR.detect(IMAGE, FAR)


def moved(shift: tuple[float, float], degrees: float = 0.0, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """The image after a motion, with noise of its own, and where its dots are then (m, 2)."""
    height, width = IMAGE.shape
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, 1.0)
    matrix[:, 2] += shift
    image = cv2.warpAffine(IMAGE, matrix, (width, height), flags=cv2.INTER_CUBIC, borderValue=60)
    noisy = image + np.random.default_rng(seed).normal(0, 1.5, image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8), FOUND.uv @ matrix[:, :2].T + matrix[:, 2]


def off(followed: Detections, true: np.ndarray) -> np.ndarray:
    place = {key: uv for key, uv in zip(zip(FOUND.target, FOUND.point, strict=True), true, strict=True)}
    keys = zip(followed.target, followed.point, strict=True)
    return np.array([np.linalg.norm(uv - place[key]) for key, uv in zip(keys, followed.uv, strict=True)])


@pytest.mark.parametrize(
    ("shift", "degrees", "px"), [((0, 0), 0, 0.3), ((3.3, -2.1), 1, 0.6), ((14, 9), 2, 1.0), ((-25, 18), 3, 1.0)]
)
def test_dots_are_where_the_scene_has_moved_them(shift, degrees, px):
    image, true = moved(shift, degrees)
    followed = Follower(IMAGE, 8, FOUND).follow(image, 8)
    assert followed is not None and len(followed) > 0.9 * len(FOUND)
    assert set(followed.target) == set(followed.target_ids)
    assert off(followed, true).max() < px
    deep = Follower(IMAGE, 8, FOUND).follow(16 * image.astype(np.uint16), 12)
    assert deep is not None and off(deep, true).max() < px


def test_from_where_they_were_last_they_are_followed_farther_than_at_once():
    follower, far = Follower(IMAGE, 8, FOUND), moved((-30, 24), 14)
    for part in (0.25, 0.5, 0.75, 1.0):
        followed = follower.follow(moved((-30 * part, 24 * part), 14 * part)[0], 8)
        assert followed is not None
    assert len(followed) > 0.6 * len(FOUND)
    assert off(followed, far[1]).max() < 1.5


@pytest.mark.parametrize("image", [OTHER, np.full_like(IMAGE, 60), IMAGE[::-1].copy(), IMAGE[:-40]])
def test_another_scene_shows_no_dots(image):
    assert Follower(IMAGE, 8, FOUND).follow(image, 8) is None


def test_a_hand_before_the_ball_hides_its_dots_only():
    image = moved((2, 1))[0]
    hidden = FOUND.target[FOUND.uv[:, 0].argmin()]
    left, top = FOUND.uv[FOUND.target == hidden].min(axis=0).astype(int) - 8
    right, bottom = FOUND.uv[FOUND.target == hidden].max(axis=0).astype(int) + 12
    image[top:bottom, left:right] = 130
    followed = Follower(IMAGE, 8, FOUND).follow(image, 8)
    assert followed is not None
    assert set(FOUND.target) - set(followed.target) == {hidden}
    masked = Follower(IMAGE, 8, FOUND).follow(moved((0, 0))[0], 8, ((left, top, right - left, bottom - top),))
    assert masked is not None and set(FOUND.target) - set(masked.target) == {hidden}


class Shown:
    """A source of three cameras whose scene moves with every image, 10 times a second."""

    def __init__(self) -> None:
        self.images = [moved((2.0 * i, 1.5 * i), 0.2 * i)[0] for i in range(9)]
        self.images += self.images[::-1]
        self.begun = time.perf_counter()

    def latest(self, serial: str) -> Frame:
        tick = int((time.perf_counter() - self.begun) * 10)
        at = self.begun + tick / 10
        return Frame(serial, self.images[tick % len(self.images)], 8, "Mono8", at, at)

    def start_live(self, rate_hz: float) -> None: ...

    def stop_live(self) -> None: ...


def test_the_overlay_goes_on_while_a_slow_detection_runs(monkeypatch):
    real = Detector.detect

    def slow(*arguments):
        time.sleep(0.6)
        return real(*arguments)

    monkeypatch.setattr(Detector, "detect", slow)
    serials = ("A", "B", "C")
    cameras = tuple(SessionCamera(serial, {"id": serial}) for serial in serials)
    plan = CapturePlan((), TARGETS, {})
    source = cast(CameraSource, Shown())
    view = LiveView(Connection(source, Discovery(()), (), cameras, plan, dict.fromkeys(serials, "")))
    view.start()
    try:
        until = time.monotonic() + 60
        while any(view.sight(serial) is None for serial in serials):
            assert time.monotonic() < until and view.problem is None
            time.sleep(0.02)
        seen: dict[str, set[float]] = {serial: set() for serial in serials}
        begin, rounds = time.monotonic(), view.rounds
        while time.monotonic() < begin + 4:
            for serial in serials:
                sight = view.sight(serial)
                assert sight is not None and len(sight.dots) > 0.8 * len(FOUND)
                assert not sight.still, "the scene moves"
                seen[serial].add(sight.frame.arrived_s)
            time.sleep(0.01)
        assert view.rounds - rounds <= 4, "every round of detections takes 1.8 s"
        assert min(map(len, seen.values())) >= 12, "images with their dots in 4 s"
        view.forget()
        assert view.problem is None
    finally:
        view.stop()


def test_a_target_that_a_hand_hid_for_long_is_followed_again():
    follower, random, hidden = Follower(IMAGE, 8, FOUND), np.random.default_rng(1), None
    for seed in range(60):
        image = moved((0, 0), seed=seed)[0]
        image[:, : image.shape[1] * 3 // 8] = random.integers(0, 255, (len(image), image.shape[1] * 3 // 8))
        assert (hidden := follower.follow(image, 8)) is not None
    followed = follower.follow(moved((0, 0))[0], 8)
    assert followed is not None and hidden is not None and len(hidden) < 0.9 * len(FOUND) < len(followed)


def test_dots_at_rest_are_followed_without_motion():
    from spherecal_cameras.averaging import stillness

    follower = Follower(IMAGE, 8, FOUND)
    followed = [follower.follow(moved((0, 0), seed=seed)[0], 8) for seed in range(3)]
    assert all(followed)
    assert stillness("A", [one for one in followed if one]).still
    shaken = [replace(FOUND, uv=FOUND.uv + 0.1 * i) for i in range(2)]
    assert not stillness("A", shaken).still
