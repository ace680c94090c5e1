"""The studies of wrong and realistic recordings judge a result by the truth, and every mischief can be recorded."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.studies.alignment import Similarity
from benchmarks.studies.judged import CameraError, Judged, Lengths, Reference, camera_error, verdict_of
from benchmarks.studies.mischief import KINDS, Mischief
from benchmarks.studies.mischief_frames import make_frame_world
from benchmarks.studies.mischief_world import World, make_world
from benchmarks.studies.wrong import outcome_of
from spherecal.data.rig import CameraSigma, Quality, RigCamera
from spherecal.geometry.rotation import exp_rotation
from spherecal_files.findings_file import as_written


@cache
def rig_a() -> World:
    return make_world("rigA", 1)


@cache
def frames(method: str) -> World:
    return make_frame_world("rigA", method, 1)


EVERY = [(mischief, method) for mischief in KINDS for method in mischief.methods]


@pytest.mark.parametrize(("mischief", "method"), EVERY, ids=[f"{m.name}, {method}" for m, method in EVERY])
def test_every_mischief_is_a_recording(mischief: Mischief, method: str) -> None:
    world = rig_a() if method == "ball" else frames(method)
    case = mischief.make(world, mischief.sizes[-1], np.random.default_rng(3))
    assert case.settings.method == world.settings.method
    o = case.session.observations
    assert o is not None
    keys = np.stack([o.placement, o.camera, o.target, o.point], axis=1)
    assert len(np.unique(keys, axis=0)) == len(keys)  # no dot twice in an image
    assert np.isfinite(o.uv).all()
    assert len(case.reference.lengths.ends_mm) == 40
    assert case.blame or mischief.name == "nothing"


def test_a_moved_camera_is_off_by_the_asked_size_afterwards() -> None:
    world = rig_a()
    make = next(m for m in KINDS if m.name == "camera moved").make
    case = make(world, 3.0, np.random.default_rng(5))
    before = np.array([c.translation_mm for c in world.cameras])
    moved = [i for i in range(len(before)) if not np.allclose(before[i], case.reference.translation_mm[i])]
    assert [world.ids[i] for i in moved] == list(case.names)


def _reference() -> Reference:
    none = Lengths(np.empty((0, 2, 3)), np.empty(0, int), np.empty(0, int), np.empty((0, 2)))
    return Reference(("C01",), np.eye(3)[None], np.zeros((1, 3)), lambda f, o: np.empty((0, 3)), none)


@pytest.mark.parametrize(("shift", "turn", "over"), [(0.6, 0.0, 3.0), (0.0, 0.06, 3.0), (0.1, 0.01, 0.5)])
def test_a_camera_is_judged_by_its_stated_uncertainty(shift: float, turn: float, over: float) -> None:
    rotation = exp_rotation(np.deg2rad([turn, 0.0, 0.0]))
    sigma = CameraSigma(np.full(3, 0.01), np.full(3, 0.1), np.zeros(16))
    camera = RigCamera(
        "C01", None, (100, 100), np.zeros(16), rotation, -rotation @ np.array([shift, 0.0, 0.0]), 0.1, 10, sigma
    )
    found = camera_error(camera, 0, _reference(), Similarity(1.0, np.eye(3), np.zeros(3)))
    assert found.over_u == pytest.approx(over, rel=1e-3)


def _judged(verdict: str, over_u: float, *codes: str, affected: frozenset[str] = frozenset()) -> Judged:
    findings = tuple(as_written("warning", code, "", "") for code in codes)
    errors = (CameraError("C01", 1.0, 1.0, over_u),)
    none = np.empty(0)
    return Judged(verdict, findings, errors, (), none, none, 0.1, 1.0, 1.0, affected=affected)  # type: ignore[arg-type]


def test_outcomes() -> None:
    assert outcome_of(_judged("valid", 1.0), False, "camera moved") == "right, not told"
    assert outcome_of(_judged("valid", 5.0), True, "camera moved") == "wrong and VALID"
    assert outcome_of(_judged("use-with-care", 5.0), True, "camera moved") == "wrong with care"
    told = _judged("use-with-care", 5.0, affected=frozenset({"C01"}))
    assert outcome_of(told, True, "camera moved") == "right, told"
    assert outcome_of(_judged("not-valid", 5.0, "camera-moved"), True, "camera moved") == "refused, right blame"
    assert outcome_of(_judged("not-valid", 5.0, "camera-moved"), False, "bar") == "refused, wrong blame"
    assert outcome_of(_judged("not-valid", 5.0), False, "bar") == "refused, no blame"
    assert outcome_of(replace(_judged("not-valid", 1.0), failure="crash: x"), False, "bar") == "no result"


def test_the_verdict_is_read_from_old_and_new_results() -> None:
    quality = Quality(True, 0.1, 0.1, 0.1, ())
    assert verdict_of(quality) in ("valid", "use-with-care", "not-valid")
    assert verdict_of(SimpleNamespace(valid=True, verdict="use-with-care")) == "use-with-care"  # type: ignore[arg-type]
    assert verdict_of(SimpleNamespace(valid=False)) == "not-valid"  # type: ignore[arg-type]
