"""Which cameras stood still, read from the images' own poses."""

from dataclasses import replace

import numpy as np
import pytest

from spherecal.adjust.parameter_layout import POSE
from spherecal.ball.image_poses import ImagePoses
from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.diagnose.pose_graph import EXPLAINED, Equations, PoseComposition, _System, explain, fit_layout
from spherecal.geometry.rotation import exp_rotation

CAMERAS, PLACEMENTS = 5, 4
NOISE = np.repeat([1e-4, 0.1], 3)  # of a pose: rad and mm


def images(move: FloatArray | None = None, camera: int = 2, since: int = 2, seed: int = 1) -> ImagePoses:
    """Five cameras about a ball at four places, every image's pose with noise; one camera moved by `move` (6,)."""
    rng = np.random.default_rng(seed)
    looks, turns = exp_rotation(rng.normal(size=(CAMERAS, 3))), exp_rotation(rng.normal(size=(PLACEMENTS, 3)))
    away, places = rng.normal([0.0, 0.0, 1500.0], 200.0, (CAMERAS, 3)), rng.normal(0.0, 150.0, (PLACEMENTS, 3))
    at = [(c, t) for c in range(CAMERAS) for t in range(PLACEMENTS) if (c, t) != (0, 1)]
    rotation, translation = [], []
    for c, t in at:
        turn, shift = looks[c] @ turns[t], looks[c] @ places[t] + away[c]
        for step in ((move if move is not None and c == camera and t >= since else None), rng.normal(size=6) * NOISE):
            if step is not None:
                more = exp_rotation(step[:3])
                turn, shift = more @ turn, more @ shift + step[3:]
        rotation.append(turn)
        translation.append(shift)
    m = len(at)
    normal = np.diag(np.tile(1 / NOISE**2, m))
    own = np.array(at)
    return ImagePoses(
        own[:, 0],
        own[:, 1],
        np.full(m, 100),
        np.array(rotation),
        np.array(translation),
        normal,
        np.tile(np.diag(1 / NOISE**2), (m, 1, 1)),
        1.0,
        CAMERAS,
    )


def test_without_a_move_what_is_left_is_chi_square() -> None:
    left = [explain(images(seed=seed), Context()) for seed in range(20)]
    assert all(found is not None and not found.moves for found in left)
    freedom = POSE * (CAMERAS * PLACEMENTS - 1 - (CAMERAS + PLACEMENTS - 1))
    mean = np.mean([found.variance_factor for found in left if found is not None])
    assert abs(mean - 1) < 4 * np.sqrt(2 / freedom / 20)


def test_a_fit_ends_at_its_minimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every step at the minimum was refused until the damping was as large as it gets: 20 steps instead of 3."""
    steps: list[float] = []
    one = _System.step

    def counted(system: _System, equations: Equations, offset: FloatArray, damping: float) -> FloatArray:
        steps.append(damping)
        return one(system, equations, offset, damping)

    monkeypatch.setattr(_System, "step", counted)
    for seed in range(5):
        steps.clear()
        found = fit_layout(some := images(seed=seed), PoseComposition.of(some))
        assert found is not None and 2 <= len(steps) <= 6


@pytest.mark.parametrize("size", [1.0, 10.0, 300.0])
@pytest.mark.parametrize("since", [1, 2, 3])
def test_a_moved_camera_is_named_however_far_it_moved(size: float, since: int) -> None:
    move = size * np.array([1e-4, -2e-4, 1e-4, 0.6, -0.5, 0.6])
    found = explain(images(move, since=since), Context())
    assert found is not None and found.variance_factor < EXPLAINED
    (one,) = found.moves
    assert one.camera == 2 and one.rivals == ()
    later = set(range(since, PLACEMENTS))
    assert set(one.placements) in (later, set(range(PLACEMENTS)) - later)
    expected = (
        move
        if set(one.placements) == later
        else np.concatenate([-move[:3], -exp_rotation(-move[None, :3])[0] @ move[3:]])
    )
    assert np.abs(one.step[:3] - expected[:3]).max() < 5 * NOISE[0]
    assert np.abs(one.step[3:] - expected[3:]).max() < 5 * NOISE[3]


def test_images_that_do_not_hang_together_say_nothing() -> None:
    whole = images()
    apart = np.where(whole.camera < 2, whole.placement, whole.placement + PLACEMENTS)
    split = replace(whole, placement=apart)
    assert fit_layout(split, PoseComposition.of(split)) is None and explain(split, Context()) is None
