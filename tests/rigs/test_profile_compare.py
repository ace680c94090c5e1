"""Two calibrations compared: a moved camera is found whatever the world, the scale and the other cameras do."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from benchmarks.studies.profiles import trials
from spherecal.base.errors import InputError
from spherecal.data.rig import Rig
from spherecal.geometry.rotation import exp_rotation
from spherecal_documents.report.trend_chart import write_trend_chart
from spherecal_files.rig_file import rig_bytes
from spherecal_rigs.calibration_age import ValidityLimits, validity
from spherecal_rigs.compare_rigs import CameraChange, ComparisonVolume, MatchedCamera, compare, seen_volume, sights
from spherecal_rigs.entry import Entry
from spherecal_rigs.rig_source import read_source, volume_of
from spherecal_rigs.save_entry import SaveOptions, save_result
from spherecal_rigs.store import apply, create_profile, open_profile
from spherecal_rigs.trend import Trend, control_limits, make_trend
from spherecal_sim.truth import SimulationOptions
from tests.export_rigs import make_rig

RIG = make_rig(5, 8)
VOLUME = ComparisonVolume(*(seen_volume(RIG).low_mm + offset for offset in (0, 400)))


def elsewhere(rig: Rig, scale: float = 1.0) -> Rig:
    """The same rig in another world, longer by `scale`."""
    turn, shift = exp_rotation(np.array([0.4, -1.1, 0.3])), np.array([100.0, -250.0, 60.0])
    cameras = [
        replace(c, rotation=c.rotation @ turn.T, translation_mm=scale * c.translation_mm - c.rotation @ turn.T @ shift)
        for c in rig.cameras
    ]
    return replace(rig, cameras=tuple(cameras))


def moved(rig: Rig, name: str, w_deg: tuple[float, float, float], d_mm: tuple[float, float, float]) -> Rig:
    """One camera turned and shifted in its own frame (docs/conventions.md)."""
    turn = exp_rotation(np.deg2rad(w_deg))
    cameras = [
        c if c.id != name else replace(c, rotation=turn @ c.rotation, translation_mm=turn @ c.translation_mm + d_mm)
        for c in rig.cameras
    ]
    return replace(rig, cameras=tuple(cameras))


def change_of(cameras: tuple[CameraChange, ...], name: str) -> CameraChange:
    return next(camera for camera in cameras if camera.id == name)


def test_another_world_is_no_change() -> None:
    free, metric = compare(RIG, elsewhere(RIG), VOLUME)
    for comparison in (free, metric):
        assert comparison.point_mm is not None and comparison.point_mm < 1e-6
        assert max(camera.ray_max_mm for camera in comparison.cameras) < 1e-6
        assert not any(camera.moved for camera in comparison.cameras)
    assert abs(free.scale_ppm) < 1e-3


def test_another_scale_is_one_figure_and_a_metric_change() -> None:
    free, metric = compare(RIG, elsewhere(RIG, 1 + 200e-6), VOLUME)
    assert free.scale_ppm == pytest.approx(200, abs=1e-2)
    assert free.length_mm is not None and abs(free.length_mm) < 1e-5
    assert metric.length_mm is not None and metric.of_length_mm is not None
    assert metric.length_mm == pytest.approx(200e-6 * metric.of_length_mm, rel=0.05)


@pytest.mark.parametrize("name", ["C1", "C5"])  # C5 is the reference: the whole world moves with it
def test_the_camera_that_moved_is_named_with_its_motion(name: str) -> None:
    w, d = (0.01, -0.02, 0.015), (0.1, -0.05, 0.2)
    after = elsewhere(moved(RIG, name, w, d), 1.00005)
    free, _ = compare(RIG, after, VOLUME)
    assert [camera.id for camera in free.cameras if camera.moved] == [name]
    worst = free.cameras[0]
    assert worst.id == name
    np.testing.assert_allclose(worst.rotation_deg, w, atol=1e-4)
    centre = -RIG.camera(name).rotation.T @ np.array(d)  # type: ignore[union-attr]
    np.testing.assert_allclose(worst.centre_mm, centre, atol=2e-3)
    others = [camera for camera in free.cameras if camera.id != name]
    assert max(camera.ray_max_mm for camera in others) < 1e-3
    assert free.scale_ppm == pytest.approx(50, abs=1)


def test_two_of_eight_cameras_that_moved_do_not_pull_the_others() -> None:
    after = moved(moved(RIG, "C2", (0.1, 0, 0), (0, 0, 0)), "C7", (0, 0, 0), (2.0, 0, 0))
    free, _ = compare(RIG, elsewhere(after), VOLUME)
    assert sorted(camera.id for camera in free.cameras if camera.moved) == ["C2", "C7"]
    assert max(c.ray_max_mm for c in free.cameras if c.id not in ("C2", "C7")) < 0.01


def test_the_effect_is_that_of_measuring_with_the_wrong_camera() -> None:
    """Computed again: all of A's images of two points, measured with B's cameras, give the changed length."""
    from spherecal.data.rig_camera import posed
    from spherecal.geometry.camera import project
    from spherecal.geometry.triangulation import triangulate

    after = moved(RIG, "C3", (0.02, 0.01, 0), (0, 0, 0))
    _, metric = compare(RIG, after, VOLUME)
    points = VOLUME.surface()
    rows = [(i, k) for i in range(len(points)) for k in range(len(RIG.cameras))]
    places = ((RIG.cameras[k], points[i]) for i, k in rows)
    uv = np.array([project(c.rotation @ point + c.translation_mm, c.intrinsics) for c, point in places])
    size = np.array(RIG.cameras[0].image_size)
    inside = ((uv > -0.5) & (uv < size - 0.5)).all(axis=1).astype(float)
    feature, camera = (np.array(column) for column in zip(*rows, strict=True))
    measured = triangulate(
        feature,
        camera,
        uv,
        inside,
        len(points),
        posed(after.cameras),
    ).points
    assert metric.point_mm == pytest.approx(np.nanmax(np.linalg.norm(measured - points, axis=1)), rel=0.02)
    worst = change_of(metric.cameras, "C3")
    assert worst.length_mm is not None and metric.length_mm is not None
    assert worst.length_mm == pytest.approx(abs(metric.length_mm), rel=0.05)
    assert all(camera.length_mm is not None and camera.length_mm < 1e-2 for camera in metric.cameras[1:])


def test_a_lens_that_changed_is_told_by_its_rays() -> None:
    changed = RIG.cameras[5].intrinsics.copy()
    changed[:2] *= 1.0005
    after = replace(RIG, cameras=(*RIG.cameras[:5], replace(RIG.cameras[5], intrinsics=changed), *RIG.cameras[6:]))
    worst = compare(RIG, after, VOLUME)[0].cameras[0]
    assert (worst.id, worst.moved) == ("C6", True)
    assert worst.focal_px == pytest.approx(5e-4 * RIG.cameras[5].intrinsics[:2].mean())
    assert np.linalg.norm(worst.centre_mm) < 1e-2


def test_a_lens_that_folds_over_outside_the_image_sees_nothing_there() -> None:
    """The polynomial's far side maps points beside the camera into its image; they are none of its sights."""
    lens = RIG.cameras[0].intrinsics.copy()
    lens[4:9] = -0.2, 0.0, 0.0, 0.0, 0.0  # folds over at r = 1.29, 49 deg off the axis; the image's corner is at 0.56
    camera = replace(RIG.cameras[0], intrinsics=lens, rotation=np.eye(3), translation_mm=np.zeros(3))
    points = np.array([[100.0, 50.0, 1000.0], [2200.0, 0.0, 1000.0], [0.0, 0.0, -1000.0]])
    inside, uv = sights(MatchedCamera("C1", camera, camera), points)
    assert 0 < uv[1, 0] < camera.image_size[0]  # the trap
    assert inside.tolist() == [True, False, False]


def test_what_cannot_be_compared() -> None:
    with pytest.raises(InputError, match="fewer than two cameras in common"):
        compare(RIG, replace(RIG, cameras=RIG.cameras[:1]), VOLUME)
    small = tuple(replace(camera, image_size=(640, 480)) for camera in RIG.cameras)
    with pytest.raises(InputError, match="images of another size"):
        compare(RIG, replace(RIG, cameras=small), VOLUME)
    away = ComparisonVolume(VOLUME.low_mm + 1e5, VOLUME.high_mm + 1e5)
    with pytest.raises(InputError, match="Fewer than two cameras see the volume"):
        compare(RIG, RIG, away)


def test_a_replaced_or_missing_camera_is_said() -> None:
    other = replace(RIG.cameras[1], serial="99-9")
    after = replace(RIG, cameras=(RIG.cameras[0], other, *RIG.cameras[2:7]))
    free, _ = compare(RIG, after, VOLUME)
    assert [camera.id for camera in free.cameras if camera.replaced] == ["C2"]
    assert (free.only_in_a, free.only_in_b) == (("C8",), ())


def test_calibrations_of_a_simulated_rig() -> None:
    """Through calibrate: noise alone names no camera, a bump of 0.3 mm and 0.03 deg names its own (study: 20 rigs)."""
    unchanged, bumped = trials("rigA", 1, SimulationOptions(targets=80, bar_poses=0), ((0.3, 0.03),))
    assert unchanged.named == ()
    assert bumped.named == (bumped.camera,)
    assert bumped.ratio > 3 * unchanged.ratio


# ---- validity


NOW = datetime(2026, 11, 21, 12, tzinfo=UTC)


def entry(hours: float, temperature_c: float | None = 20.0, **more: object) -> Entry:
    at = NOW - timedelta(hours=hours)
    fields: dict = {"valid": True, "rms_px": 0.05, "sigma0": 1.0, "input_sha256": "", "files": {}} | more
    return Entry(at, at, temperature_c=temperature_c, **fields)


@pytest.mark.parametrize(
    ("hours", "now_c", "state"),
    [
        (0, 20.0, "fresh"), (4.9, 20.9, "fresh"), (5.1, 20.0, "ageing"), (0, 21.0, "ageing"), (0, 18.9, "ageing"),
        (11.9, 21.9, "ageing"), (12.0, 20.0, "stale"), (0, 22.0, "stale"), (0, 17.9, "stale"), (13, None, "stale"),
        (1, None, "fresh"), (-0.05, 20.0, "fresh"), (-3, 20.0, "stale"),
    ],
)  # fmt: skip
def test_the_chip(hours: float, now_c: float | None, state: str) -> None:
    found = validity(entry(hours), ValidityLimits(), NOW, now_c)
    assert found.state == state
    assert found.reasons


def test_the_chip_names_its_reasons_and_takes_the_worst() -> None:
    found = validity(entry(6), ValidityLimits(), NOW, 23.0)
    assert (found.state, found.reasons) == ("stale", ("the temperature has changed by +3.0 K",))
    assert (found.age_hours, found.change_kelvin) == (6.0, 3.0)
    assert validity(None, ValidityLimits()).state == "none"
    assert validity(entry(0, valid=False), ValidityLimits(), NOW).reasons == ("the calibration is marked as not valid",)
    assert validity(entry(0, verdict="inconsistent"), ValidityLimits(), NOW).state == "stale"
    assert validity(entry(0, None), ValidityLimits(), NOW, 40.0).change_kelvin is None


def test_the_limits_are_the_user_s() -> None:
    limits = ValidityLimits(24, 48, 5, 10)
    assert validity(entry(20), limits, NOW, 24.0).state == "fresh"
    assert validity(entry(30), limits, NOW, 24.0).state == "ageing"
    with pytest.raises(InputError):
        ValidityLimits(float("nan"), 5)


# ---- trend


@pytest.fixture(scope="module")
def history(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a profile `p` of eight calibrations with a little noise; from the seventh on C4 has moved."""
    tmp_path = tmp_path_factory.mktemp("history")
    random = np.random.default_rng(3)
    folder = tmp_path / "p"
    made = create_profile(folder, "Rig 7")
    for i in range(8):
        rig = RIG
        for camera in RIG.cameras:
            turn, shift = random.normal(0, 5e-4, 3), random.normal(0, 5e-3, 3)
            rig = moved(rig, camera.id, tuple(turn.tolist()), tuple(shift.tolist()))
        if i >= 6:
            rig = moved(rig, "C4", (0, 0.02, 0), (0, 0, 0))
        result = tmp_path / f"r{i}"
        result.mkdir()
        rig = replace(rig, quality=replace(rig.quality, rms_px=0.05 + 1e-4 * (i % 3)))
        (result / "rig.json").write_bytes(rig_bytes(rig))
        save_result(made, result, SaveOptions(calibrated_at=NOW + timedelta(days=i), temperature_c=20 + 0.1 * (i % 2)))
    apply(open_profile(folder), "0008")
    return tmp_path


@pytest.fixture(scope="module")
def trend(history: Path) -> Trend:
    return make_trend(open_profile(history / "p"))


def test_the_trend_finds_when_and_which_camera(trend: Trend) -> None:
    outside = {series.name: [trend.ids[i] for i in series.outside] for series in trend.cameras}
    assert outside["C4"] == ["0007", "0008"]
    assert all("0007" not in ids for name, ids in outside.items() if name != "C4")
    assert [trend.ids[i] for i in trend.series[0].outside] == ["0007", "0008"]


def test_control_limits_by_hand() -> None:
    limits = control_limits(np.array([10.0, 12.0, np.nan, 11.0, 13.0, 12.0]))
    assert limits is not None
    assert limits.centre == 12.0
    # moving ranges 2 1 2 1, median 1.5
    assert limits.high - limits.centre == pytest.approx(3 * 1.5 / 0.954)
    assert control_limits(np.array([1.0, 2.0, 3.0])) is None
    assert control_limits(np.full(6, 21.95)) is None


@pytest.mark.parametrize("ending", ["pdf", "svg"])
def test_the_chart_is_vector_graphics(trend: Trend, tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"trend.{ending}"
    write_trend_chart(trend, path)
    data = path.read_bytes()
    assert data.startswith(b"%PDF" if ending == "pdf" else b"<?xml")
    assert b"/Subtype /Image" not in data and b"<image" not in data
    if ending == "svg":
        assert data.count(b"<path") > 50
    with pytest.raises(InputError, match=r"\.pdf or \.svg"):
        write_trend_chart(trend, tmp_path / "trend.png")


def test_what_may_be_compared(history: Path, tmp_path: Path) -> None:
    places = (history / "p", history / "p" / "history" / "0008", history / "r7", history / "r7" / "rig.json")
    rigs = [read_source(path).rig.cameras[0].translation_mm.tolist() for path in places]
    assert all(rig == rigs[0] for rig in rigs)
    assert volume_of(read_source(history / "r7")).low_mm.shape == (3,)
    with pytest.raises(InputError, match="neither a profile nor a result"):
        read_source(tmp_path)
