"""Cameras without hardware or drivers: matching, clocks, pixels, profiles, plans, replay and simulated rigs."""

import contextlib
import io
import json
import threading
import time
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spherecal.base.context import Context
from spherecal.base.errors import Cancelled, InputError
from spherecal.geometry.camera import project
from spherecal.targets.detection import Detector
from spherecal.targets.family import make_target_set
from spherecal.targets.images import read_image
from spherecal_app.cli.main import main
from spherecal_cameras.averaging import average, stillness, take_averaged
from spherecal_cameras.camera_doctor import brightness, covered_camera, examine
from spherecal_cameras.camera_settings import CameraDescription, CameraProfile, read_profile, write_profile
from spherecal_cameras.genicam.pixels import grey_pixels, significant_bits
from spherecal_cameras.matching import CameraClock, RoundKeeper, SetMatcher, Sighting
from spherecal_cameras.plan import check_marks, plan_of, read_plan
from spherecal_cameras.protocol import (
    CameraError,
    CameraSettings,
    CameraSource,
    CameraState,
    CaptureRequest,
    Frame,
    FrameSet,
    Region,
    TriggerMode,
)
from spherecal_cameras.simulated.simulated_source import SimulatedFault, SimulatedSource, parse_fault
from spherecal_cameras.simulated.stage import Stage, StageView
from spherecal_cameras.sources import ReplaySource, open_source
from spherecal_files.read_session import read_session
from spherecal_files.target_set_file import write_target_set


@pytest.fixture(scope="module")
def stage() -> Stage:
    return Stage("demo")


@pytest.fixture(scope="module")
def captured(tmp_path_factory):
    """A session captured by the command from a simulated rig, and what that said on standard error."""
    folder = tmp_path_factory.mktemp("captured")
    arguments = ["cameras", "capture", "--source", "simulated", "--placements", "2"]
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        assert main([*arguments, "--profile", str(folder / "p.json"), "-o", str(folder / "session")]) == 0
    return folder / "session", said.getvalue()


@pytest.fixture
def source(stage):
    stage.show("P1")
    with SimulatedSource(stage=stage) as simulated:
        simulated.open(simulated.discover().serials, {})
        yield simulated


# --- clocks and matching ---------------------------------------------------------------------------------------------


def test_a_bar_on_a_sticker_that_the_targets_lack_is_refused(tmp_path: Path) -> None:
    """Nobody would ever find it, and nothing would say so before the bar has been laid."""
    write_target_set(tmp_path / "targets.json", make_target_set(8))
    mark = {"target": 205, "point": "centre"}
    length = {"from": "B1", "to": "B2", "length_mm": 500.0, "expanded_uncertainty_mm": 0.004, "coverage_factor": 2}
    bar = {"id": "B", "role": "scale", "marks": {"B1": {"target": 8, "point": "centre"}, "B2": mark},
           "lengths": [length], "expansion_per_kelvin": 1.15e-5, "reference_temperature_c": 20.0}  # fmt: skip
    document = {"format": "spherecal/session", "version": 1, "target_set": "targets.json",
                "scale": {"kind": "bar", "bar": "B"}, "bars": [bar], "placements": [{"id": "P1"}]}  # fmt: skip
    (tmp_path / "bench.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"mark B2 of bar B is target 205, which the target set does not have"):
        check_marks(read_plan(tmp_path / "bench.json"), tmp_path / "bench.json")
    mark["target"] = 7
    (tmp_path / "bench.json").write_text(json.dumps(document))
    check_marks(read_plan(tmp_path / "bench.json"), tmp_path / "bench.json")


def test_a_latched_clock_tells_when_an_image_was_exposed_however_late_it_comes():
    clock = CameraClock()
    clock.latch(100.0, 100.002, 5_000_000_000)  # the camera's clock stands 95.001 s behind ours
    assert clock.host_time(6_000_000_000, 101.9) == pytest.approx(101.001, abs=1e-6)
    assert clock.uncertainty_s < 0.005
    assert clock.latch_is_old(200.0)
    assert not clock.latch_is_old(101.0)


def test_without_a_latch_the_fastest_arrival_sets_the_clock():
    clock = CameraClock()
    delays = (0.040, 0.012, 0.300, 0.020)
    taken = [clock.host_time(i * 1_000_000_000 + 1, 50.0 + i + delay) for i, delay in enumerate(delays)]
    assert taken[-1] == pytest.approx(53.012, abs=1e-3)
    assert CameraClock().host_time(None, 7.0) == 7.0


def test_a_clock_set_anew_by_a_power_cycle_is_followed():
    clock = CameraClock()
    clock.latch(100.0, 100.001, 90_000_000_000)
    clock.host_time(91_000_000_000, 101.01)
    assert clock.host_time(1_000_000_000, 200.0) == pytest.approx(200.0, abs=0.01)


def test_a_late_image_belongs_to_the_round_that_exposed_it():
    rounds = RoundKeeper()
    rounds.triggered(7, 10.0)
    rounds.triggered(8, 11.0)
    assert rounds.assign(10.02, 0.01, 1) == 7  # arrives after trigger 8
    assert rounds.assign(11.01, 0.01, 2) == 8
    assert rounds.assign(11.02, 0.01, 3) is None  # no round has two images
    rounds.triggered(0, 12.0)
    assert rounds.assign(12.01, 0.01, 4) is None  # live view


@given(st.lists(st.sampled_from(["deliver", "lose", "late"]), min_size=1, max_size=30), st.floats(0.2, 2.0))
def test_no_image_is_ever_given_to_another_round(fates, period_s):
    rounds, held = RoundKeeper(), []
    for number, fate in enumerate(fates, start=1):
        at = number * period_s
        for exposed, of in held:  # the late ones of the round before come first now
            assert rounds.assign(exposed, 0.03, None) in (of, None)
        held = []
        rounds.triggered(number, at)
        if fate == "deliver":
            assert rounds.assign(at + 0.002, 0.03, None) == number
        elif fate == "late":
            held = [(at + 0.002, number)]


def _seen(camera: str, taken_s: float, round_number: int | None = None) -> Sighting[str]:
    return Sighting(camera, round_number, taken_s, 0.002, f"{camera}@{taken_s}")


def test_sets_are_matched_by_round_pulse_and_time_not_by_order():
    modes: dict[str, TriggerMode] = {"soft": "software", "a": "hardware", "b": "hardware", "free": "free"}
    matcher = SetMatcher(modes, 5, 100.0)
    assert not matcher.offer(_seen("soft", 100.1, 4))
    assert not matcher.offer(_seen("free", 99.9))
    assert not matcher.offer(_seen("stranger", 100.1, 5))
    assert not matcher.offer(_seen("a", 99.99))
    assert matcher.offer(_seen("free", 100.4))
    assert matcher.offer(_seen("a", 100.2))
    assert matcher.offer(_seen("b", 100.5))  # the next pulse: camera b missed the first one
    assert matcher.missing() == ("soft", "b") or matcher.missing() == ("soft", "a")
    assert matcher.offer(_seen("a", 100.501))
    assert matcher.offer(_seen("soft", 100.1, 5))
    assert matcher.missing() == ()
    chosen = matcher.images()
    assert (chosen["a"].taken_s, chosen["b"].taken_s) == (100.501, 100.5)
    assert chosen["a"].item in matcher.kept()


# --- pixels ----------------------------------------------------------------------------------------------------------


def _component(data, width, height, name="Mono8", channels=1):
    return SimpleNamespace(data=data, width=width, height=height, data_format=name, num_components_per_pixel=channels)


def test_line_padding_is_cut_off():
    padded = np.arange(4 * 10, dtype=np.uint8).reshape(4, 10)
    assert np.array_equal(grey_pixels(_component(padded.ravel(), 7, 4)), padded[:, :7])


def test_colour_becomes_luminance_and_deep_pixels_stay_deep():
    white = np.full(2 * 3 * 4, 200, np.uint8)
    assert (grey_pixels(_component(white, 3, 2, "RGBa8", 4)) == 200).all()
    red = np.tile(np.array([90, 0, 0], np.uint8), 6)
    blue = np.tile(np.array([0, 0, 90], np.uint8), 6)
    assert np.array_equal(grey_pixels(_component(red, 3, 2, "RGB8", 3)), grey_pixels(_component(blue, 3, 2, "BGR8", 3)))
    deep = np.arange(6, dtype=np.uint16) * 600
    assert grey_pixels(_component(deep, 3, 2, "Mono12")).dtype == np.uint16


@pytest.mark.parametrize(
    "component", [_component(None, 3, 2), _component(np.zeros(5, np.uint8), 3, 2), _component(np.zeros(6), 3, 2)]
)
def test_pixels_that_make_no_image_are_refused(component):
    with pytest.raises(ValueError):  # noqa: PT011
        grey_pixels(component)


def test_bits_come_from_the_formats_name():
    names = {"Mono8": 8, "Mono12p": 12, "Mono10Packed": 10, "BayerRG12": 12, "RGBa8": 8, "Strange": 8}
    assert {name: significant_bits(name) for name in names} == names


# --- profile and plan ------------------------------------------------------------------------------------------------


def test_a_profile_comes_back_as_it_was_kept(tmp_path):
    settings = CameraSettings(1234.5, 3.0, "Mono12p", Region(8, 16, 640, 480), "hardware", "Line3", 12.5, 9000, 1000)
    profile = CameraProfile({"42": CameraDescription("42", "left", settings, 8.0, 3.45)}, ("/opt/driver",))
    write_profile(tmp_path / "deep" / "cameras.json", profile)
    assert read_profile(tmp_path / "deep" / "cameras.json") == profile
    assert read_profile(tmp_path / "none.json") == CameraProfile()


@pytest.mark.parametrize(
    ("change", "named"),
    [({"exposure_us": -1}, "exposure_us"), ({"trigger": "never"}, "trigger"), ({"exposure_u": 5}, "exposure_us")],
)
def test_a_wrong_profile_is_refused_with_the_place(tmp_path, change, named):
    document = {"format": "spherecal/cameras", "version": 1, "cameras": [{"serial": "1", "settings": change}]}
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=named):
        read_profile(path)


def test_a_recorded_session_is_the_plan_of_the_next(captured):
    folder, _ = captured
    plan = read_plan(folder)
    assert [s.id for s in plan.sets] == [s.id for s in plan_of(read_session(folder)).sets]
    assert plan.sets[0].bar is None
    assert plan.sets[-1].bar == "B"
    assert plan.sets[-1].temperature_c is not None
    known = plan.camera("SIM-C02", "whatever")
    assert known is not None
    assert known["id"] == "C02"


def test_a_plan_is_checked_before_anything_is_captured(tmp_path):
    path = tmp_path / "plan.json"
    document = {"format": "spherecal/session", "version": 1, "placements": [{"id": "P1"}],
                "scale": {"kind": "bar", "bar": "Z"}}  # fmt: skip
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"plan\.json: scale\.bar names a bar"):
        read_plan(path)


# --- the simulated rig -----------------------------------------------------------------------------------------------


def test_another_rig_has_another_ball():
    """The dots of the ball of late are kept."""
    dots = [Stage("demo", seed)._ball_dots for seed in (1, 2, 1)]
    assert np.array_equal(dots[0].places, dots[2].places) and not np.array_equal(dots[0].places, dots[1].places)


def test_drawn_dots_are_where_the_simulated_rig_has_them(stage):
    stage.show("P1")
    with SimulatedSource(stage=stage) as source:
        source.open(["SIM-C02"], {})
        image = source.capture_set().frames["SIM-C02"].image
    found = Detector(stage.session.target_set).detect(image)
    truth, camera = stage.truth, stage.truth.cameras[1]
    world = truth.points_mm(0) @ camera.rotation.T + camera.translation_mm
    uv = dict(
        zip(
            zip(truth.ball.dot_target, truth.ball.dot_point, strict=True),
            project(world, camera.intrinsics),
            strict=True,
        )
    )
    names = truth.ball.points
    errors = np.array(
        [
            seen - uv[target, names.index(found.points[point])]
            for target, point, seen in zip(found.target, found.point, found.uv, strict=True)
        ]
    )
    assert len(errors) > 200
    assert np.abs(errors.mean(axis=0)).max() < 0.01
    assert errors.std(axis=0).max() < 0.04


def test_drawn_and_rendered_images_agree(stage):
    stage.show("P1")
    drawn, rendered = stage.picture(0, StageView()), stage.picture(0, StageView(), rendered=True)
    found = [
        Detector(stage.session.target_set).detect((p * 250).clip(0, 255).astype(np.uint8)) for p in (drawn, rendered)
    ]
    tables = [dict(zip(zip(d.target, d.point, strict=True), d.uv, strict=True)) for d in found]
    common = tables[0].keys() & tables[1].keys()
    assert len(common) > 250
    assert np.std([tables[0][dot] - tables[1][dot] for dot in common]) < 0.1


def test_every_source_speaks_the_protocol_and_says_what_it_is(source, captured):
    assert isinstance(source, CameraSource)
    assert source.label.startswith("SIMULATED")
    folder, _ = captured
    with open_source(f"replay:{folder}") as replay:
        assert isinstance(replay, ReplaySource)
        assert isinstance(replay, CameraSource)
        assert replay.label.startswith("REPLAY")
        serials = replay.discover().serials
        replay.open(serials, {})
        taken = replay.capture_set()
        assert taken.complete
        pixels = read_image(folder / "placements" / "P1" / "C03.png")
        assert np.array_equal(taken.frames["SIM-C03"].image, pixels)
        replay.show("A-01")
        assert not np.array_equal(replay.capture_set().frames["SIM-C03"].image, pixels)
        with pytest.raises(InputError, match="nowhere"):
            replay.show("nowhere")


def test_settings_reach_the_simulated_image(source):
    first = source.capture_set().frames["SIM-C01"]
    assert (first.bits, first.image.dtype, first.exposure_us) == (8, np.uint8, 10_000.0)
    assert not first.image.flags.writeable
    source.apply({"SIM-C01": CameraSettings(exposure_us=5000, pixel_format="Mono12", region=Region(10, 20, 300, 200))})
    second = source.capture_set().frames["SIM-C01"]
    assert (second.bits, second.image.shape) == (12, (200, 300))
    same = first.image[20:220, 10:310].astype(float)
    assert second.image.mean() / 16 == pytest.approx(same.mean() / 2, rel=0.15)


def test_what_moves_is_seen_at_the_moments_of_exposure(stage, monkeypatch):
    """However long drawing takes, each camera shows what was there at the moment that its image states."""
    shown = {}
    draw = stage.picture

    def slow(camera, view, rendered=False, artefact=None):
        time.sleep(0.01)
        shown[camera] = artefact or stage.at()
        return draw(camera, view, rendered, artefact)

    monkeypatch.setattr(stage, "picture", slow)
    began = time.perf_counter()
    stage.show("P1")
    stage.carry(lambda at_s: ((1000.0 * (at_s - began), 0.0, 0.0), (0.0, 0.0, 0.0)))
    with SimulatedSource(stage=stage) as source:
        source.open(source.discover().serials, {})
        taken = source.capture_set()
    assert taken.spread_s == pytest.approx(0.005)
    for camera, frame in enumerate(taken.frames.values()):
        assert shown[camera].shift_mm[0] == pytest.approx(1000.0 * (frame.taken_s - began), abs=1e-6)
    stage.show("P1")
    assert stage.at().shift_mm == (0.0, 0.0, 0.0)


def test_the_ball_moves_by_hand(source, stage):
    before = source.capture_set().frames["SIM-C01"].image.astype(int)
    still = source.capture_set().frames["SIM-C01"].image.astype(int)
    stage.move((5.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    moved = source.capture_set().frames["SIM-C01"].image.astype(int)
    assert np.abs(moved - before).mean() > 3 * np.abs(still - before).mean()
    with pytest.raises(InputError, match="P9"):
        source.show("P9")


def test_a_live_view_keeps_only_the_newest_image(source):
    source.capture_set()  # compiled
    source.start_live(20.0)
    seen = set()
    end = time.monotonic() + 10.0
    while len(seen) < 4 and time.monotonic() < end:
        frame = source.latest("SIM-C04")
        seen.add(frame.frame_id)
        time.sleep(0.02)
    assert len(seen) >= 4
    assert source.statuses()["SIM-C04"].state is CameraState.STREAMING
    source.stop_live()
    last = source.latest("SIM-C04")
    time.sleep(0.1)
    assert source.latest("SIM-C04") is last
    assert source.statuses()["SIM-C04"].state is CameraState.CONNECTED


def test_faults_by_script(stage):
    stage.show("P1")
    faults = ["lose:C03@2", "drop:C01@3", "delay:C02:9@4", "bump:C04:1@5-", "dim:C05:0.2@5"]
    with SimulatedSource(stage=stage, faults=[parse_fault(text) for text in faults]) as source:
        source.open(source.discover().serials, {})
        whole = source.capture_set()
        assert whole.complete
        lost = source.capture_set(CaptureRequest(retries=1))
        assert [one.camera for one in lost.missing] == ["SIM-C03"]
        assert lost.attempts == 2
        assert source.statuses()["SIM-C03"].state is CameraState.LOST
        assert any(event.camera == "SIM-C03" and event.hint for event in source.take_events())
        retried = source.capture_set()
        assert retried.complete
        assert (retried.attempts, retried.late) == (2, ("SIM-C01",))
        assert source.statuses()["SIM-C03"].state is CameraState.CONNECTED
        late = source.capture_set(CaptureRequest(timeout_s=0.05, retries=0))
        assert [one.camera for one in late.missing] == ["SIM-C02"]
        bumped = source.capture_set()
        apart = np.abs(bumped.frames["SIM-C04"].image.astype(int) - whole.frames["SIM-C04"].image.astype(int)).mean()
        assert apart > 3.0
        assert bumped.frames["SIM-C05"].image.mean() < 0.4 * whole.frames["SIM-C05"].image.mean()


@pytest.mark.parametrize("text", ["melt:C01", "lose", "lose:C01@x", "blur:C01:much"])
def test_a_fault_that_is_not_understood_is_explained(text):
    with pytest.raises(InputError, match="KIND:CAMERA"):
        parse_fault(text)


def test_errors_name_the_camera_and_what_to_do(source):
    with pytest.raises(CameraError, match=r"There is no camera X.*SIM-C01"):
        source.open(["X"], {})
    with pytest.raises(CameraError, match="X is not open"):
        source.capture_set(CaptureRequest(cameras=("X",)))
    with pytest.raises(InputError, match="no camera source 'webcam'"):
        open_source("webcam")
    with pytest.raises(Cancelled):
        source.capture_set(None, Context(is_cancelled=lambda: True))


# --- averaging -------------------------------------------------------------------------------------------------------


def test_an_average_keeps_fractions_of_grey_values():
    frames = [
        Frame("1", np.full((2, 2), value, np.uint8), 8, "Mono8", 0.0, 0.0, temperature_c=t)
        for value, t in ((10, 40.0), (11, 41.0), (11, 42.0), (255, 43.0))
    ]
    mean = average(frames[:3])
    assert mean.bits == 16
    assert mean.image[0, 0] == round((10 + 11 + 11) / 3 * 256)
    assert (mean.averaged, mean.temperature_c) == (3, 41.0)
    assert average([frames[3]] * 2).image.max() == 255 * 256


def test_an_averaged_set_has_a_common_clock_where_all_its_sets_have():
    clocks = [True, True, True, False]
    frame = Frame("1", np.zeros((2, 2), np.uint8), 8, "Mono8", 0.0, 0.0)

    class Clocked:
        def capture_set(self, request, context):
            return FrameSet(1, {"1": frame}, spread_s=0.001, common_clock=clocks.pop(0))

    clocked = cast(CameraSource, Clocked())
    assert take_averaged(clocked, 2, None).taken.common_clock
    assert not take_averaged(clocked, 2, None).taken.common_clock


def test_a_still_scene_is_still_and_a_moving_one_is_not(stage, source):
    detector = Detector(stage.session.target_set)
    request = CaptureRequest(("SIM-C01", "SIM-C02"), retries=0)
    still = take_averaged(source, 4, detector, request)
    assert not still.moved
    for one in still.stillness.values():
        assert one.motion_px < 0.005
        assert one.noise_px is not None and 0.002 < one.noise_px < 0.03
    single = source.capture_set(request).frames["SIM-C01"].image.astype(float)
    averaged = still.taken.frames["SIM-C01"].image / 256.0
    corner = np.s_[:100, :100]  # background: noise only
    assert averaged[corner].std() < 0.7 * single[corner].std()

    class Shaken:
        def capture_set(self, request, context):
            stage.move((0.05, 0.0, 0.0))  # 0.07 px
            return source.capture_set(request, context)

    shaken = take_averaged(cast(CameraSource, Shaken()), 4, detector, request)
    assert set(shaken.moved) == {"SIM-C01", "SIM-C02"}
    assert shaken.stillness["SIM-C01"].motion_px > 0.02


def test_a_turn_about_the_line_of_sight_is_motion(stage):
    detector = Detector(stage.session.target_set)
    stage.show("P1")
    image = (stage.picture(0, StageView()) * 250).astype(np.uint8)
    found = detector.detect(image)
    angle = 2e-4  # 0.1 px at 500 px from the middle, no shift on the whole
    middle = found.uv.mean(axis=0)
    turned = replace(found, uv=found.uv + angle * (found.uv - middle)[:, ::-1] * [1, -1])
    one = stillness("C01", [found, turned])
    assert one.motion_px is not None
    assert one.motion_px > 0.02
    assert stillness("C01", [found, found]).still
    assert stillness("C01", []).motion_px is None


# --- doctor ----------------------------------------------------------------------------------------------------------


def test_the_doctor_names_the_lost_camera(source):
    source.inject(SimulatedFault("lose", "C02"))
    found = examine(source, seconds=2.0, rate_hz=5.0)
    errors = {finding.where[0] for finding in found.findings if finding.severity == "error"}
    assert errors == {"SIM-C02"}
    assert not found.well
    assert found.trigger.complete == 0
    source.heal("C02")
    well = examine(source, seconds=2.0, rate_hz=5.0)
    assert well.trigger.complete == well.trigger.sets == 10
    assert not any(f.severity == "error" for f in well.findings), well.findings


def test_a_covered_lens_tells_which_camera_it_is(source):
    before = brightness(source)
    assert covered_camera(source, before) is None
    source.inject(SimulatedFault("dim", "C05", 0.05))
    assert covered_camera(source, before) == "SIM-C05"
    source.inject(SimulatedFault("dim", "C06", 0.05))
    assert covered_camera(source, before) is None


# --- commands --------------------------------------------------------------------------------------------------------


def test_capture_writes_a_session_with_its_metadata(captured):
    folder, said = captured
    assert said.startswith("SIMULATED")
    session = read_session(folder)
    assert [p.id for p in session.placements] == ["P1", "P2"]
    assert [p.bar for p in session.bar_poses] == ["A", "A", "B", "B"]
    assert session.cameras[0].serial == "SIM-C01"
    capture = json.loads((folder / "capture.json").read_text())
    assert capture["source"]["simulated"] is True
    taken = {one["id"]: datetime.fromisoformat(one["taken"]) for one in capture["sets"]}
    assert session.recorded_at == taken["P2"] < taken[session.bar_poses[0].id]
    about = capture["sets"][0]["cameras"]["C01"]
    assert about["exposure_us"] == 10_000.0
    assert 30 < about["temperature_c"] < 50
    assert about["time_stamp_ns"] > 0
    assert read_image(session.placements[1].images["C06"]).dtype == np.uint8


def test_an_averaged_capture_by_a_plan(captured, tmp_path, capsys):
    document = json.loads((captured[0] / "session.json").read_text())
    document["placements"], document["bar_poses"] = [{"id": "P2"}], []
    (tmp_path / "plan.json").write_text(json.dumps(document))
    (tmp_path / "targets.json").write_bytes((captured[0] / "targets.json").read_bytes())
    folder = tmp_path / "session"
    line = ["cameras", "capture", "--source", "simulated", "--profile", str(tmp_path / "p.json"), "-o", str(folder)]
    assert main([*line, "--plan", str(tmp_path / "plan.json"), "--average", "2"]) == 0
    assert "noise floor" in capsys.readouterr().out
    session = read_session(folder)
    assert [p.id for p in session.placements] == ["P2"]
    assert read_image(session.placements[0].images["C06"]).dtype == np.uint16
    about = json.loads((folder / "capture.json").read_text())["sets"][0]["cameras"]["C01"]
    assert (about["averaged"], about["bits"]) == (2, 16)
    assert about["motion_px"] < 0.02


def test_an_unfinished_capture_goes_on_and_a_whole_one_is_never_replaced(tmp_path, capsys):
    folder = tmp_path / "session"
    line = [
        "cameras",
        "capture",
        "--source",
        "simulated",
        "-o",
        str(folder),
        "--profile",
        str(tmp_path / "p.json"),
        "--placements",
        "2",
    ]
    assert main([*line, "--before-each", 'test "$SPHERECAL_SET" != P2']) == 2
    assert "failed before set P2" in capsys.readouterr().err
    assert [p.id for p in read_session(folder).placements] == ["P1"]
    first = (folder / "placements/P1/C01.png").read_bytes()
    assert main(line) == 2
    assert "--continue" in capsys.readouterr().err
    assert main([*line, "--continue"]) == 0
    assert [p.id for p in read_session(folder).placements] == ["P1", "P2"]
    assert (folder / "placements/P1/C01.png").read_bytes() == first


def test_a_capture_without_a_camera_says_so_by_its_exit_code(tmp_path, capsys):
    folder = tmp_path / "session"
    line = [
        "cameras",
        "capture",
        "--source",
        "simulated",
        "-o",
        str(folder),
        "--profile",
        str(tmp_path / "p.json"),
        "--placements",
        "1",
        "--retries",
        "0",
        "--fault",
        "lose:C02@1",
    ]
    assert main(line) == 3
    assert "missing: C02" in capsys.readouterr().out
    session = read_session(folder)
    assert "C02" not in session.placements[0].images
    assert "C02" in session.bar_poses[0].images


def test_list_show_set_and_doctor_on_the_simulated_rig(tmp_path, capsys):
    profile = ["--source", "simulated", "--profile", str(tmp_path / "p.json")]
    assert main(["cameras", "list", *profile, "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert listed["label"].startswith("SIMULATED")
    assert len(listed["cameras"]) == 6
    assert (
        main(["cameras", "set", "C03", *profile, "--name", "door", "--exposure-us", "2500", "--focal-length-mm", "8"])
        == 0
    )
    assert main(["cameras", "show", "door", *profile, "--json"]) == 0
    out = capsys.readouterr().out
    shown = json.loads(out[out.index("{") :])
    assert shown["camera"]["serial"] == "SIM-C03"
    assert shown["settings"]["exposure_us"] == 2500
    assert shown["focal_length_mm"] == 8
    assert main(["cameras", "set", "C04", *profile, "--name", "door"]) == 2
    assert "already has the name" in capsys.readouterr().err
    assert main(["cameras", "show", "window", *profile]) == 2
    assert "C01" in capsys.readouterr().err
    assert main(["cameras", "doctor", *profile, "--seconds", "0.3"]) in (0, 3)
    assert "SIM" not in capsys.readouterr().out.split("\n")[0]


def test_a_real_camera_without_a_lens_is_recorded_with_a_start_that_says_so():
    from spherecal_cameras.plan import camera_spec_json

    for pitch, focal in ((None, 8.0), (3.45, None), (None, None)):
        entry = camera_spec_json("left", "1", "m", (100, 80), pitch, focal)
        assert entry["prior"]["assumed"] == ["focal_length"] and "focal_length_mm" not in entry
        assert entry["prior"]["matrix"][0] == [120.0, 0.0, 49.5]
    assert "prior" not in camera_spec_json("left", "1", "m", (100, 80), 3.45, 8.0)


def test_sources_end_their_threads(stage):
    before = set(threading.enumerate())
    with SimulatedSource(stage=stage) as source:
        source.open(["SIM-C01"], {})
        source.start_live(50.0)
        source.capture_set()
    assert set(threading.enumerate()) <= before
