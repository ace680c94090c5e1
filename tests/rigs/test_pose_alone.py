"""A repair finds new poses only: what else has changed of a camera is named, and nothing is repaired."""

from dataclasses import replace

import numpy as np
import pytest

from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.rig import Rig
from spherecal.data.session import Session
from spherecal_rigs.check_rig import check
from spherecal_rigs.recalibrate import Selection, recalibrate
from spherecal_rigs.repose import repose
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions, Truth
from tests.rigs.test_check import only
from tests.wrong_recordings import again, as_built, still

C = 3  # the camera that is changed


@pytest.fixture(scope="module")
def made() -> tuple[Session, Truth, Rig]:
    session, truth = simulate_session("rigA", 3, SimulationOptions(targets=80, placements=5, bar_poses=0))
    return session, truth, calibrate(only(session, "P1", "P2", "P3", "P4")).rig


def seen_through(made: tuple[Session, Truth, Rig], intrinsics: np.ndarray) -> Session:
    """The last placement as camera C sees it through another lens."""
    session, truth, _ = made
    cameras = tuple(replace(c, intrinsics=intrinsics) if k == C else c for k, c in enumerate(truth.cameras))
    other = replace(truth, cameras=cameras)
    return only(again(session, other, as_built(other), still), "P5")


@pytest.mark.parametrize(
    ("what", "code"),
    [("focus 0.3 %", "focus"), ("focus 1 %", "focus"), ("region 16", "region"), ("region 200", "region"),
     ("k1", "lens"), ("binned 2", "binned"), ("binned 4", "binned"), ("exchanged +2", "exchanged"),
     ("exchanged -1", "exchanged")],
)  # fmt: skip
def test_what_no_pose_explains_is_named(made: tuple[Session, Truth, Rig], what: str, code: str) -> None:
    _, truth, rig = made
    lens = truth.cameras[C].intrinsics.copy()
    if what.startswith("focus"):
        lens[:2] *= 1 + float(what.split()[1]) / 100
    elif what.startswith("region"):
        lens[2:4] += float(what.split()[1]) * np.array([1.0, -0.5])
    elif what == "k1":
        lens[4] += 0.05
    now = seen_through(made, lens)
    o = now.observations
    assert o is not None
    if what.startswith("binned"):
        smaller = (o.uv + 0.5) / int(what.split()[1]) - 0.5
        now = replace(now, observations=replace(o, uv=np.where((o.camera == C)[:, None], smaller, o.uv)))
    other = C + int(what.split()[1]) if code == "exchanged" else C
    if other != C:
        camera = np.where(o.camera == C, other, np.where(o.camera == other, C, o.camera))
        swapped = replace(o, camera=camera)
        now = replace(now, observations=swapped.select(np.lexsort((o.point, o.target, camera, o.placement))))
    found = check(now, rig)
    names = found.to_repair or (rig.cameras[C].id,)
    assert rig.cameras[C].id in names
    assert " deg" not in found.sentence or "e+0" not in found.sentence
    with pytest.raises(InputError) as error:
        repose(now, rig, names)
    assert error.value.code in (f"error-repair-{code}", *(["error-repair-focus"] if code == "lens" else []))
    # with the reference camera (-1) moves the frame: two others were named that nobody had touched
    assert all(rig.cameras[k].id in str(error.value) for k in (C, other))


@pytest.mark.parametrize(("shift_mm", "turn_deg"), [(0.3, 0.02), (3.0, 0.0), (0.0, 0.5), (30.0, 2.0)])
def test_a_knock_is_repaired(made: tuple[Session, Truth, Rig], shift_mm: float, turn_deg: float) -> None:
    from spherecal.geometry.rotation import exp_rotation

    session, truth, rig = made
    rng = np.random.default_rng(7)
    direction = rng.normal(size=3) / 1.7
    turn = exp_rotation(np.deg2rad(turn_deg) * direction)
    built = as_built(truth)

    def pose(c: int, t: int):
        r, x = built(c, t)
        return (turn @ r, turn @ x + shift_mm * direction) if c == C else (r, x)

    now = only(again(session, truth, pose, still), "P5")
    mended = repose(now, rig, (rig.cameras[C].id,)).rig
    assert mended.quality.valid
    assert check(now, mended).verdict == "ok"


def test_what_a_move_and_a_focus_explain_alike_asks_for_care(made: tuple[Session, Truth, Rig]) -> None:
    """A focus off by 0.03 % was repaired as a move and called VALID, lengths 1.8 U off."""
    _, truth, rig = made
    lens = truth.cameras[C].intrinsics.copy()
    lens[:2] *= 1.0003
    name = rig.cameras[C].id
    mended = repose(seen_through(made, lens), rig, (name,)).rig
    assert [f.kind for f in mended.quality.findings if f.code == "pose-unconfirmed"] == ["or-focus"]
    assert mended.quality.verdict == "use-with-care"
    (now,) = (c.sigma for c in mended.cameras if c.id == name)
    (before,) = (c.sigma for c in rig.cameras if c.id == name)
    assert now is not None and before is not None
    assert np.linalg.norm(now.centre_mm) > 2 * np.linalg.norm(before.centre_mm)


def test_cameras_that_stay_keep_their_uncertainty(made: tuple[Session, Truth, Rig]) -> None:
    session, _, rig = made
    done = recalibrate(only(session, "P5"), rig, Selection((rig.cameras[C].id,)))
    for before, after in zip(rig.cameras, done.rig.cameras, strict=True):
        assert before.sigma is not None and after.sigma is not None
        if before.id != rig.cameras[C].id:
            assert np.array_equal(before.sigma.centre_mm, after.sigma.centre_mm)
        # hung on the others, with one placement to go by
        assert np.linalg.norm(after.sigma.centre_mm) > 0.5 * np.linalg.norm(before.sigma.centre_mm)
    assert done.rig.length_map is not None and rig.length_map is not None
    assert done.rig.length_map.typical_mm == pytest.approx(rig.length_map.typical_mm, rel=0.3)
