"""Repairs: what they make of a session, that they mend what was named, and that the result records them."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spherecal.calibrate as method
from benchmarks.studies.judged import calibrated_and_judged
from benchmarks.studies.mischief import KINDS
from benchmarks.studies.mischief_motions import late_camera
from benchmarks.studies.mischief_world import RIGS, make_world
from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.rig import Affected, Calibration
from spherecal.data.session import Session
from spherecal.geometry.rotation import exp_rotation, log_rotation
from spherecal.geometry.transform import fit_similarity
from spherecal.steps.automatic_repairs import (
    FAR_MM,
    FAR_RAD,
    WORSE,
    is_last_pose,
    keeps_a_tested_pose,
    may_be_swapped,
)
from spherecal.steps.repairs import Repairs, repaired
from spherecal.steps.settings import CalibrationSettings
from spherecal_app.cli.main import main
from spherecal_files.rig_file import read_rig
from spherecal_files.write_result import write_result
from spherecal_sim.simulate_session import write_session
from spherecal_sim.truth import CameraMove, Truth
from tests.networks import calibrated, codes, errors_of, observed, one_thread, rms, simulated
from tests.wrong_recordings import recording, sagged

__all__ = ["one_thread"]

SHIFT_MM, TURN_RAD = 0.3, 2e-4
TARGETS = 85


def knocked() -> tuple[Session, Truth]:
    """A rig whose camera C03 is knocked between P2 and P3."""
    return simulated("demo", 4, targets=TARGETS, moved=CameraMove("C03", 2, SHIFT_MM, TURN_RAD))


def faultless() -> Session:
    return simulated("demo", 4, targets=TARGETS)[0]


def mended(session: Session, **repairs: tuple[str, ...]) -> Calibration:
    return calibrate(session, CalibrationSettings(repairs=Repairs(**repairs)))


def with_images(session: Session) -> Session:
    """The session with images (of any name) instead of observations."""
    images = {c.id: Path(f"{c.id}.png") for c in session.cameras}
    return replace(
        session,
        observations=None,
        placements=tuple(
            replace(p, images={c: Path(p.id) / path for c, path in images.items()}) for p in session.placements
        ),
    )


def test_nothing_asked_changes_nothing() -> None:
    session = faultless()
    assert not Repairs()
    assert repaired(session, Repairs()) == session


def test_a_split_camera_has_the_pose_of_today() -> None:
    session, truth = knocked()
    before = calibrate(session, CalibrationSettings(repair_by_itself=False))
    assert "camera-moved" in codes(before) and not before.rig.quality.valid
    hint = next(f.hint for f in before.rig.quality.findings if f.code == "camera-moved")
    value = hint.split("--split ")[1].split(":")[0]
    assert value == "C03@P3"
    after = mended(session, split=(value,))
    assert not codes(after) & {"camera-moved", "camera-noisy", "lens-misfit", "little-coverage"}
    assert [c.id for c in after.rig.cameras] == [c.id for c in session.cameras]
    assert after.rig.reference_camera in {c.id for c in session.cameras}
    assert after.observations.cameras == observed(session).cameras
    np.testing.assert_array_equal(after.observations.camera, before.observations.camera)
    repair = after.rig.repairs[0]
    assert (repair.option, repair.value) == ("--split", "C03@P3")
    now, earlier = after.rig.camera("C03"), repair.earlier_pose
    assert now is not None and earlier is not None
    assert np.linalg.norm(now.centre_mm - earlier.centre_mm) == pytest.approx(SHIFT_MM, abs=0.1)
    turned = np.linalg.norm(log_rotation(now.rotation @ earlier.rotation.T))
    assert turned == pytest.approx(TURN_RAD, abs=1.5e-4)
    np.testing.assert_array_equal(now.intrinsics, earlier.intrinsics)
    # the truth's poses are those before the move: all cameras but the knocked one stand right again, and this one's
    # earlier pose does
    cameras = tuple(earlier if c.id == "C03" else c for c in after.rig.cameras)
    as_it_was = replace(after, rig=replace(after.rig, cameras=cameras))
    assert rms(errors_of(as_it_was, truth).centre_score) < 1.6
    assert rms(errors_of(before, truth).centre_mm) > 2 * rms(errors_of(as_it_was, truth).centre_mm)


def test_a_split_that_is_not_credible_is_not_made_by_itself() -> None:
    """The camera then fits worse than the others, or stands where no knock brings it; to the limits it is accepted."""
    session, _ = knocked()
    made: dict[tuple[object, ...], Calibration] = {}
    solve = method._solve

    def split(times: float = 1.0, shift_mm: float = 0.0, turn_rad: float = 0.0) -> bool:
        turn = exp_rotation(np.array([0.0, 0.0, turn_rad]))

        def solved(some: Session, *rest: Any) -> method._Judged:
            key = tuple(c.id for c in some.cameras), len(observed(some))
            done = made.setdefault(key, made.get(key) or solve(some, *rest).done)
            fit = times * np.median([c.rms_px or 0.0 for c in done.rig.cameras])
            at = [0.0, 0.0, shift_mm]
            cameras = tuple(
                replace(c, rms_px=fit, rotation=turn @ c.rotation, translation_mm=turn @ c.translation_mm + at)
                if c.id == "C03" and done.rig.earlier_poses
                else c
                for c in done.rig.cameras
            )
            return method._Judged(replace(done, rig=replace(done.rig, cameras=cameras)))

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(method, "_solve", solved)
            done = calibrate(session).rig
        return [(r.option, r.value) for r in done.repairs] == [("--split", "C03@P3")] and done.quality.valid

    assert split() and split(WORSE - 0.1) and split(shift_mm=FAR_MM - 5) and split(turn_rad=FAR_RAD - 0.01)
    assert not split(WORSE + 0.1)
    assert not split(shift_mm=FAR_MM + 5)
    assert not split(turn_rad=FAR_RAD + 0.01)


def test_the_split_camera_may_not_be_the_reference() -> None:
    calibration, session, _ = calibrated("demo", 4, targets=TARGETS)
    reference = calibration.rig.reference_camera
    after = mended(session, split=(f"{reference}@P4",))
    assert after.rig.reference_camera in {c.id for c in session.cameras}
    camera = after.rig.camera(str(after.rig.reference_camera))
    assert camera is not None
    np.testing.assert_allclose(camera.rotation, np.eye(3), atol=1e-12)


def test_exchanged_images_are_put_back() -> None:
    clean, session, _ = calibrated("demo", 4, targets=TARGETS)
    for value in ("C01,C05", "C02,C06@P2"):
        wrong = repaired(session, Repairs(swap=(value,)))
        again = mended(wrong, swap=(value,))
        np.testing.assert_allclose(
            [c.translation_mm for c in again.rig.cameras], [c.translation_mm for c in clean.rig.cameras], atol=1e-9
        )
        finding = next(f for f in again.rig.quality.findings if f.code == "swapped-back")
        assert set(finding.where) == set(value.replace("@", ",").split(","))


def test_what_is_left_out_is_gone() -> None:
    session = faultless()
    o = observed(session)
    after = mended(session, leave_out=("camera:C02", "placement:P3", "C04@P1"))
    left = after.observations
    assert "C02" not in left.cameras and after.rig.camera("C02") is None
    assert after.rig.quality.valid
    rows = set(zip(left.placement.tolist(), [left.cameras[c] for c in left.camera], strict=True))
    assert rows == {
        (int(p), o.cameras[c])
        for p, c in zip(o.placement, o.camera, strict=True)
        if o.cameras[c] != "C02" and p != 2 and (p != 0 or o.cameras[c] != "C04")
    }
    assert [f.where for f in after.rig.quality.findings if f.code == "left-out"] == [("C02",), ("P3",), ("C04", "P1")]
    assert len(after.rig.repairs) == 3


def test_images_follow_as_observations_do() -> None:
    session = with_images(faultless())
    swapped = repaired(session, Repairs(swap=("C01,C02@P1",)))
    assert swapped.placements[0].images["C01"] == Path("P1/C02.png")
    assert swapped.placements[1].images == session.placements[1].images
    split = repaired(session, Repairs(split=("C01@P3",)))
    assert [c.id for c in split.cameras][-1] not in {c.id for c in session.cameras}
    name = split.cameras[-1].id
    assert split.cameras[-1].earlier_pose_of == "C01"
    assert [("C01" in p.images, name in p.images) for p in split.placements] == [
        (False, True), (False, True), (True, False), (True, False)]  # fmt: skip
    out = repaired(session, Repairs(leave_out=("camera:C03", "placement:P2", "C05@P4")))
    assert "C03" not in {c.id for c in out.cameras}
    assert [sorted(p.images) for p in out.placements] == [
        ["C01", "C02", "C04", "C05", "C06"], [], ["C01", "C02", "C04", "C05", "C06"], ["C01", "C02", "C04", "C06"]
    ]  # fmt: skip


def test_a_camera_may_be_split_more_than_once() -> None:
    session = faultless()
    twice = repaired(session, Repairs(split=("C01@P4", "C01@P2")))
    o = observed(twice)
    names = np.array(o.cameras)[o.camera]
    first = [set(names[(o.placement == t) & np.char.startswith(names, "C01")]) for t in range(4)]
    assert first == [{"C01 before P2"}, {"C01 before P4"}, {"C01 before P4"}, {"C01"}]


@pytest.mark.parametrize(
    ("repairs", "said"),
    [
        ({"leave_out": ("camera:C99",)}, "C99"),
        ({"leave_out": ("placement:P9",)}, "P9"),
        ({"leave_out": ("C01",)}, "camera:C05"),
        ({"leave_out": ("C01@P9",)}, "P9"),
        ({"split": ("C01",)}, "CAMERA@PLACEMENT"),
        ({"split": ("C01@P1",)}, "nothing before P1"),
        ({"swap": ("C01",)}, "two cameras"),
        ({"swap": ("C01,C01",)}, "twice"),
        ({"swap": ("C01,C99@P1",)}, "C99"),
        ({"leave_out": tuple(f"camera:C0{i}" for i in range(1, 6))}, "two cameras are left"),
    ],
)
def test_bad_names_are_refused(repairs: dict[str, tuple[str, ...]], said: str) -> None:
    session = faultless()
    with pytest.raises(InputError, match=said):
        repaired(session, Repairs(**repairs))


def test_repairs_are_in_the_file(tmp_path: Path) -> None:
    session, _ = knocked()
    after = mended(session, split=("C03@P3",), leave_out=("C01@P1",))
    write_result(after, tmp_path / "result")
    document = json.loads((tmp_path / "result" / "rig.json").read_text(encoding="utf-8"))
    assert [(r["option"], r["value"]) for r in document["repairs"]] == [
        ("--leave-out", "C01@P1"),
        ("--split", "C03@P3"),
    ]
    back = read_rig(tmp_path / "result" / "rig.json")
    assert [(r.option, r.value) for r in back.repairs] == [(r.option, r.value) for r in after.rig.repairs]
    pose, written = after.rig.repairs[1].earlier_pose, back.repairs[1].earlier_pose
    assert pose is not None and written is not None
    np.testing.assert_array_equal(pose.rotation, written.rotation)


def test_repairs_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session, truth = knocked()
    write_session(session, truth, tmp_path / "session")
    arguments = ["calibrate", str(tmp_path / "session"), "-o", str(tmp_path / "result")]
    assert main([*arguments, "--split", "C03@P3", "--leave-out", "C01@P1"]) == 0
    shown = capsys.readouterr().out
    assert "pose-split" in shown and "left-out" in shown
    assert main([*arguments, "--swap", "C03"]) == 2
    assert "two cameras" in capsys.readouterr().err


def test_an_image_of_few_dots_does_not_show_where_its_camera_is() -> None:
    """Both images before one of 7 dots were left out as wrong; the camera was moved, and the rig valid."""
    session = simulated("demo", 3)[0]
    o = observed(session)
    names = [place.id for place in session.placements]
    camera, last = 2, len(names) - 1
    name = o.cameras[camera]
    assert is_last_pose(session, f"{name}@{names[last]}") and not is_last_pose(session, f"{name}@{names[last - 1]}")
    of_last = np.flatnonzero((o.camera == camera) & (o.placement == last))
    few = np.ones(len(o), dtype=bool)
    few[of_last[7:]] = False
    thin = replace(session, observations=o.select(few))
    assert is_last_pose(thin, f"{name}@{names[last - 1]}") and not is_last_pose(thin, f"{name}@{names[last - 2]}")


@pytest.mark.parametrize(
    ("split", "leave_out", "tested"),
    [
        (("C03@P2",), (), True),
        (("C03@P2", "C03@P4"), ("C03@P3",), False),
        (("C03@P2", "C03@P4"), (), True),
        (("C03@P4",), ("C03@P3",), True),
        (("C03@P2", "C03@P3", "C03@P4"), (), False),
        (("C03@P2", "C02@P3"), (), True),
    ],
)
def test_a_camera_with_another_pose_in_each_image_is_not_repaired(
    split: tuple[str, ...], leave_out: tuple[str, ...], tested: bool
) -> None:
    """A shifted region of interest passed for two knocks and a wrong image; the rig was to be used with care."""
    way = Repairs(split=split, leave_out=leave_out)
    assert keeps_a_tested_pose(repaired(faultless(), way), way) == tested


def test_a_camera_whose_other_images_contradict_each_other_was_not_only_moved_once() -> None:
    """Late by 0.3 mm at each placement: one image was left out as moved, and the camera was 3.8 times its U off."""
    case = late_camera(make_world("hall12", 15008), 0.3, np.random.default_rng([15008, 2, 18, 300000]))
    done = calibrate(case.session, case.settings)
    assert done.rig.quality.verdict == "not-valid"
    (finding,) = (f for f in done.rig.quality.findings if f.severity == "error")
    assert finding.code == "camera-moved" and finding.where[:1] == case.names


@pytest.mark.parametrize(("place", "verdict"), [("P1", "not-valid"), ("P2", "valid"), ("P4", "not-valid")])
def test_names_are_put_back_only_between_placements_that_have_them(place: str, verdict: str) -> None:
    """Exchanged from the second of four placements on, cameras were named by the majority: 536 mm off."""
    swapped = repaired(faultless(), Repairs(swap=(f"C02,C03@{place}",)))
    rig = calibrate(swapped).rig
    code = "swapped-back" if verdict == "valid" else "cameras-swapped"
    (finding,) = (f for f in rig.quality.findings if f.code == code)
    assert finding.where == ("C02", "C03", place)
    assert rig.quality.verdict == verdict
    put_back = [("--swap", f"C02,C03@{place}", True)] if verdict == "valid" else []
    assert [(r.option, r.value, r.automatic) for r in rig.repairs] == put_back


@pytest.mark.parametrize(
    ("until", "out", "perhaps"), [("P3", ("P1", "P2"), True), ("P3", ("P1",), True), ("P2", ("P2",), False)]
)
def test_first_images_are_kept_where_another_camera_had_none(until: str, out: tuple[str, ...], perhaps: bool) -> None:
    """Exchanged with a camera that had not seen the ball before: the first names may be the right ones."""
    session = faultless()
    o = session.observations
    assert o is not None
    unseen = (o.camera == o.cameras.index("C05")) & (o.placement < o.placements.index(until))
    session = replace(session, observations=o.select(~unseen))
    way = Repairs(leave_out=tuple(f"C02@{name}" for name in out))
    assert may_be_swapped(session, way, "C02") == perhaps


def test_cameras_that_no_image_shows_since_a_beam_sagged_are_as_uncertain_as_it_was_large() -> None:
    """On a beam that sagged after their last images, cameras were 66 U off, and the rig valid."""
    session, truth = recording("rigA", 2, targets=60)
    on_beam = [0, 1, 2, 3, 4]
    recorded = sagged(session, truth, on_beam, 2.0)
    o = observed(recorded)
    done = calibrate(replace(recorded, observations=o.select((o.camera != 0) | (o.placement < 2)))).rig
    assert done.quality.verdict == "use-with-care" and done.quality.affected == (Affected(camera="C01"),)
    assert {r.value for r in done.repairs} == {f"C0{k}@P3" for k in (2, 3, 4, 5)}
    now = np.array([c.centre_mm for c in truth.cameras])
    now[on_beam, 2] -= 2.0
    found = np.array([c.centre_mm for c in done.cameras])
    off = np.linalg.norm(fit_similarity(found[1:], now[1:]).apply(found) - now, axis=1)
    stated = [np.linalg.norm(c.sigma.centre_mm) for c in done.cameras if c.sigma is not None]
    assert off[0] > 1.0 and (off < 3 * np.array(stated)).all()


@pytest.mark.slow
def test_cameras_that_no_image_shows_since_a_move_are_as_uncertain_as_it_was_large() -> None:
    """Moved before a last image of 7 dots, two of them unknown, C08 was 337 U off."""
    mischief = next(one for one in KINDS if one.name == "two cameras moved")
    seed = [17009, RIGS.index("hall12"), list(KINDS).index(mischief), 10_000_000]
    case = mischief.make(make_world("hall12", 17009), 10, np.random.default_rng(seed))
    judged = calibrated_and_judged(case.session, case.reference, case.settings)
    assert judged.verdict == "use-with-care"
    assert "C08" in judged.affected
    assert max(camera.over_u for camera in judged.cameras) < 3
    assert not judged.lengths_wrong
