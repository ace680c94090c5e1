"""Sessions from arrays, targets in arrays, and each command as one function."""

import inspect
import pydoc
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import spherecal
from spherecal.geometry.camera import camera_matrix


@pytest.fixture(scope="module")
def simulated() -> tuple[spherecal.Session, spherecal.Truth]:
    return spherecal.simulate_session("demo", 1, spherecal.SimulationOptions(targets=80))


@pytest.fixture(scope="module")
def calibrated(simulated) -> spherecal.Calibration:
    return spherecal.calibrate_session(simulated[0])


def table_of(session: spherecal.Session) -> dict[str, Any]:
    """Its observations as somebody else's table."""
    o = session.observations
    assert o is not None
    return {
        "placement": np.array(o.placements)[o.placement],
        "camera": np.array(o.cameras)[o.camera],
        "target": o.target,
        "point": np.array(o.points)[o.point],
        "u": o.uv[:, 0],
        "v": o.uv[:, 1],
    }


def in_opencvs_terms(session: spherecal.Session) -> tuple[dict[str, Any], dict[str, tuple[int, int]]]:
    lenses = {c.id: (camera_matrix(c.prior), c.prior[4:9]) for c in session.cameras}
    return lenses, {c.id: c.image_size for c in session.cameras}


def rest_of(session: spherecal.Session) -> dict[str, Any]:
    return {
        "scale": session.scale, "bars": session.bars, "bar_poses": session.bar_poses, "target_set": session.target_set
    }  # fmt: skip


def cloud(simulated, placements: int = 3, count: int = 60) -> tuple[dict[str, np.ndarray], np.ndarray, Any]:
    """Points in front of the demo's cameras, seen with noise: (placements, count, 2) by camera, NaN where unseen."""
    _, truth = simulated
    random = np.random.default_rng(7)
    middle = truth.ball_places_mm.mean(axis=0)
    sizes = {camera.id: camera.image_size for camera in simulated[0].cameras}
    points = middle + random.uniform(-200, 200, (placements, count, 3))
    seen: dict[str, np.ndarray] = {}
    for camera in truth.cameras:
        K, dist = camera_matrix(camera.intrinsics), camera.intrinsics[4:]
        rvec = cv2.Rodrigues(camera.rotation)[0]
        uv = cv2.projectPoints(points.reshape(-1, 3), rvec, camera.translation_mm, K, dist)[0].reshape(
            *points.shape[:2], 2
        )
        outside = np.any((uv < 0) | (uv > np.array(sizes[camera.id]) - 1), axis=2)
        seen[camera.id] = np.where(outside[:, :, None], np.nan, uv + random.normal(0, 0.05, uv.shape))
    return seen, points, truth


def test_the_same_numbers_as_from_a_folder(simulated, calibrated) -> None:
    session = simulated[0]
    lenses, sizes = in_opencvs_terms(session)
    mine = spherecal.Session.from_arrays(table_of(session), lenses, sizes, **rest_of(session))
    assert mine.observations == session.observations
    found = spherecal.calibrate_session(mine)
    assert found.rig.cameras == calibrated.rig.cameras and found.rig.covariance == calibrated.rig.covariance
    assert len(found.rig.input_sha256) == 64
    assert spherecal.verify_rig(mine, found.rig).lengths == spherecal.verify_rig(session, calibrated.rig).lengths


def test_points_without_targets_give_the_rig_up_to_scale(simulated) -> None:
    seen, _, truth = cloud(simulated)
    lenses, sizes = in_opencvs_terms(simulated[0])
    done = spherecal.calibrate_points(seen, lenses, sizes)
    assert len(done.rig.cameras) == 6
    assert "no-scale" in {finding.code for finding in done.rig.quality.findings}
    ours = np.array([done.rig[c.id].centre_mm for c in truth.cameras])
    true = np.array([-c.rotation.T @ c.translation_mm for c in truth.cameras])
    ratio = np.linalg.norm(ours[1:] - ours[0], axis=1) / np.linalg.norm(true[1:] - true[0], axis=1)
    assert np.ptp(ratio) / ratio.mean() < 5e-3
    assert np.isfinite(done.points_mm).any()


def test_arrays_by_camera_by_placement_and_stacked_are_one_session(simulated) -> None:
    seen, _, _ = cloud(simulated)
    lenses, sizes = in_opencvs_terms(simulated[0])
    first = spherecal.Session.from_arrays(seen, lenses, sizes)
    by_placement = {f"P{t + 1}": {name: uv[t] for name, uv in seen.items()} for t in range(3)}
    stacked = {f"P{t + 1}": np.stack([uv[t] for uv in seen.values()]) for t in range(3)}
    assert spherecal.Session.from_arrays(by_placement, lenses, sizes) == first
    assert spherecal.Session.from_arrays(stacked, lenses, sizes) == first
    one = spherecal.Session.from_arrays({name: uv[0] for name, uv in seen.items()}, lenses, sizes)
    assert one == spherecal.Session.from_arrays(np.stack([uv[0] for uv in seen.values()]), lenses, sizes)
    assert [placement.id for placement in one.placements] == ["P1"] and one != first
    assert repr(one).startswith("<Session: 6 cameras, 1 placement, 0 bar poses, ")


def test_cameras_are_k_or_pairs_or_descriptions(simulated) -> None:
    seen, _, _ = cloud(simulated)
    session = simulated[0]
    lenses, sizes = in_opencvs_terms(session)
    bare = spherecal.Session.from_arrays(seen, {name: K for name, (K, _) in lenses.items()}, sizes)
    assert not bare.cameras[0].prior[4:].any() and bare.cameras[0].prior_given
    same = spherecal.Session.from_arrays(seen, {camera.id: camera for camera in session.cameras})
    assert same.cameras == session.cameras
    wide = spherecal.Session.from_arrays(
        seen, {n: (K, np.zeros(4)) for n, (K, _) in lenses.items()}, sizes, fisheye=["C02"]
    )
    assert [c.lens_model for c in wide.cameras][:3] == ["brown", "fisheye", "brown"]


def test_a_table_may_have_sigmas_and_gaps(simulated) -> None:
    session = simulated[0]
    lenses, sizes = in_opencvs_terms(session)
    table = table_of(session) | {
        "sigma_u": np.full(len(session.observations), 0.1),
        "sigma_v": [0.2] * len(session.observations),
    }
    table["u"] = table["u"].copy()
    table["u"][::10] = np.nan
    made = spherecal.Session.from_arrays(table, lenses, sizes, **rest_of(session)).observations
    assert made is not None and made.sigma is not None
    assert len(made) == len(session.observations) - len(table["u"][::10])
    assert np.array_equal(made.sigma[0], [0.1, 0.2])


UV = [[10.0, 20.0], [30.0, 40.0]]
K = [[1000.0, 0, 500], [0, 1000.0, 400], [0, 0, 1]]
ROW = {"camera": ["C1"], "target": [1], "u": [1.0], "v": [1.0]}


@pytest.mark.parametrize(
    ("observations", "message"),
    [
        ({"C1": UV, "C9": UV}, "C9"),
        ({"C1": UV, "C2": UV[:1]}, r"different numbers of image points at P1 \(1, 2\)"),
        ({"C1": [UV], "C2": [UV, UV]}, "different shapes"),
        ({"C1": [[1, 2, 3]]}, r"\(n, 2\) or \(placements, n, 2\)"),
        ({"C1": "text"}, "image points of C1 must be an array of numbers"),
        ([UV, UV[:1]], "observations must be an array of numbers. Give "),
        (ROW | {"sigma_u": [0.1]}, "only one of the columns sigma_u and sigma_v"),
        ({"C1": [[5000.0, 20.0]]}, r"outside the image of 1000 x 800 pixels"),
        (np.zeros((3, 5, 2)), r"\(2, n, 2\)"),
        ({"u": [1.0], "v": [1.0]}, "has no column camera"),
        (ROW | {"camera": ["C7"]}, 'names "C7"'),
        (ROW | {"target": [1.5]}, "not a whole number"),
        (ROW | {"v": ["x"]}, "not a number"),
        (ROW | {"placement": ["a/b"]}, "placement's id 'a/b'"),
        (ROW | {"point": ["a,b"]}, "point's name 'a,b'"),
        (ROW | {"sigma_u": [0.0], "sigma_v": [1.0]}, "sigma_u and sigma_v must be"),
        (ROW | {"target": [1, 2]}, "column target has 2 values"),
        ({name: values * 2 for name, values in ROW.items()}, "twice at P1"),
    ],
)
def test_observations_that_cannot_be_used_are_named(observations: Any, message: str) -> None:
    with pytest.raises(spherecal.InputError, match=message):
        spherecal.Session.from_arrays(observations, {"C1": K, "C2": K}, (1000, 800))


@pytest.mark.parametrize(
    ("cameras", "size", "message"),
    [
        ({}, (1000, 800), "at least one camera"),
        ({"C1": K}, None, 'image size of camera "C1" is not given'),
        ({"C1": K}, (1000,), 'image size of camera "C1" must be'),
        ({"C1": (K, np.zeros(14))}, (1000, 800), 'distortion of camera "C1" has 14 numbers'),
        ({"../x": K}, (1000, 800), "camera's id '../x'"),
    ],
)
def test_cameras_that_cannot_be_used_are_named(cameras: Any, size: Any, message: str) -> None:
    with pytest.raises(spherecal.InputError, match=message):
        spherecal.Session.from_arrays({"C1": UV}, cameras, size)


def test_messages_about_a_session_without_a_folder_say_so(simulated) -> None:
    seen, _, _ = cloud(simulated)
    lenses, sizes = in_opencvs_terms(simulated[0])
    made = spherecal.Session.from_arrays({name: uv[0] for name, uv in seen.items()}, lenses, sizes)
    with pytest.raises(spherecal.InputError, match=r"^the session in memory: 1 placement: too few to leave one out"):
        spherecal.cross_validate_session(made)


def test_the_folder_one_is_in_is_no_session_in_memory(tmp_path: Path, monkeypatch) -> None:
    """`spherecal calibrate .` left out the check of capture times, and its messages named no folder."""
    options = spherecal.SimulationOptions(targets=12, placements=2)
    spherecal.simulate_session("demo", 1, options, folder=tmp_path / "session")
    monkeypatch.chdir(tmp_path / "session")
    session = spherecal.load_session(".")
    assert session.where == str(tmp_path / "session") and session.folder != Path()
    assert session == spherecal.load_session(tmp_path / "session")


def test_the_digest_of_arrays_holds_lens_models_and_targets(simulated) -> None:
    seen, _, _ = cloud(simulated)
    specs = {camera.id: camera for camera in simulated[0].cameras}
    rational = {name: replace(camera, lens_model="rational") for name, camera in specs.items()}
    made = [
        spherecal.Session.from_arrays(seen, specs),
        spherecal.Session.from_arrays(seen, rational),
        spherecal.Session.from_arrays(seen, specs, target_set=spherecal.make_targets(5)),
        spherecal.Session.from_arrays(seen, specs, target_set=spherecal.make_targets(6)),
    ]
    assert len({session.input_sha256 for session in made}) == 4


def test_bars_of_arrays_must_be_there(simulated) -> None:
    session = simulated[0]
    lenses, sizes = in_opencvs_terms(session)
    given = rest_of(session)
    with pytest.raises(spherecal.InputError, match="names a bar that is not given"):
        spherecal.Session.from_arrays(table_of(session), lenses, sizes, **{**given, "bars": ()})
    with pytest.raises(spherecal.InputError, match='role "scale"'):
        spherecal.Session.from_arrays(
            table_of(session), lenses, sizes, **{**given, "scale": spherecal.Scale("bar", bar="A")}
        )


# --- targets in an image ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A flat sheet of twelve stickers, 5 px a millimetre, light dots on dark ground as on the ball."""
    made = spherecal.make_targets(12)
    scale, edge = 5.0, 30.0
    image = np.full((int(3 * edge * scale), int(4 * edge * scale)), 30, dtype=np.uint8)
    for i, layout in enumerate(made.layouts.values()):
        middle = (np.array([i % 4, i // 4]) + 0.5) * edge
        for place in layout.values():
            u, v = (middle + place) * scale
            cv2.circle(image, (round(u * 16), round(v * 16)), round(1.5 * scale * 16), 220, -1, cv2.LINE_AA, shift=4)
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    path = tmp_path_factory.mktemp("picture") / "sheet.png"
    cv2.imwrite(str(path), image)
    return path, image


def test_targets_of_an_array_are_those_of_the_file(picture, tmp_path: Path) -> None:
    path, image = picture
    found = spherecal.detect_targets(image)
    assert list(found.target_ids) == list(range(1, 13)) and len(found) == 96
    assert spherecal.detect_targets(path) == found == spherecal.detect_targets(str(path))
    colour = np.repeat(image[:, :, None], 3, axis=2)
    assert spherecal.detect_targets(colour) == found
    deep = spherecal.detect_targets(image.astype(np.uint16) * 256)
    assert np.abs(deep.uv - found.uv).max() < 1e-3
    spherecal.save_targets(spherecal.make_targets(5), tmp_path / "targets.json")
    assert spherecal.load_targets(tmp_path / "targets.json") == spherecal.make_targets(5)
    assert list(spherecal.detect_targets(image, tmp_path / "targets.json").target_ids) == [1, 2, 3, 4, 5]
    assert not len(spherecal.detect_targets(image, spherecal.make_targets(12, dark_on_light=True)))


@pytest.mark.parametrize("image", [np.zeros((100, 100)), np.zeros((100, 100, 7), np.uint8), np.zeros((9, 9), np.uint8)])
def test_an_image_of_another_kind_is_refused(image: np.ndarray) -> None:
    with pytest.raises(spherecal.InputError, match="image"):
        spherecal.detect_targets(image)


def test_a_sheet_is_written(tmp_path: Path) -> None:
    spherecal.write_target_sheet(spherecal.make_targets(12), tmp_path / "sheet.pdf")
    assert (tmp_path / "sheet.pdf").read_bytes().startswith(b"%PDF")


# --- each command as one function ------------------------------------------------------------------------------------


def test_check_guide_compare_and_recalibrate(simulated, calibrated, tmp_path: Path) -> None:
    session, rig = simulated[0], calibrated.rig
    spherecal.save_calibration(calibrated, tmp_path / "result")
    found = spherecal.check_rig(session, tmp_path / "result")
    assert found.verdict == "ok" and len(found.balls) == 4 and not found.to_repair
    assert spherecal.check_rig(session, rig, limit="0.5").verdict == "ok"
    with pytest.raises(spherecal.InputError, match="is not a limit"):
        spherecal.check_rig(session, rig, limit="little")
    assert spherecal.guide_next_placement(session).best is not None
    moved = replace(rig["C02"], translation_mm=rig["C02"].translation_mm + np.array([3.0, 0, 0]))
    bumped = replace(rig, cameras=tuple(moved if c.id == "C02" else c for c in rig))
    assert spherecal.check_rig(session, bumped).to_repair == ("C02",)
    assert spherecal.compare_rigs(rig, bumped)[0].cameras[0].id == "C02"
    again = spherecal.recalibrate_cameras(session, bumped, "C02", "pose").rig
    assert np.linalg.norm(again["C02"].centre_mm - rig["C02"].centre_mm) < 0.2
    assert spherecal.verify_rig(session, tmp_path / "result", limit="1+L/1000").procedure.acceptance.verdict == "pass"


def test_a_result_becomes_a_report_and_a_profile(simulated, calibrated, tmp_path: Path) -> None:
    spherecal.save_calibration(calibrated, tmp_path / "result")
    spherecal.write_report(tmp_path / "result", tmp_path / "report.html")
    assert b"<html" in (tmp_path / "report.html").read_bytes()[:300]
    saved = spherecal.save_to_profile(tmp_path / "result", tmp_path / "cell 4", note="first", apply=True)
    profile = spherecal.load_profile(tmp_path / "cell 4")
    assert profile.active_id == saved
    second = spherecal.save_to_profile(tmp_path / "result", tmp_path / "cell 4")
    assert spherecal.apply_calibration(tmp_path / "cell 4", second, note="again").active_id == second


def test_a_report_without_matplotlib_is_a_missing_package(tmp_path: Path) -> None:
    """In a process of its own: what has imported matplotlib before keeps it."""
    code = "import sys; sys.modules['matplotlib'] = None\nimport spherecal\n"
    code += "try: spherecal.write_report('result', 'report.pdf')\nexcept spherecal.MissingPackage as e: print(e)"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "A report or a chart needs matplotlib. Install it: pip install matplotlib\n"


def test_bars_and_balls_are_kept(simulated, calibrated, tmp_path: Path) -> None:
    bar = simulated[0].bars[0]
    kept = spherecal.RegisteredBar("S-1", bar.marks, bar.lengths, bar.expansion_per_kelvin)
    spherecal.save_bar(kept, tmp_path / "bars.json")
    assert spherecal.load_bars(tmp_path / "bars.json") == {"S-1": kept}
    assert spherecal.plan_bar_poses(calibrated.rig, [kept]).poses
    assert calibrated.ball is not None
    spherecal.save_ball(spherecal.BallProfile(calibrated.ball, "B-1"), tmp_path / "ball.json")
    ball = spherecal.load_ball(tmp_path / "ball.json")
    assert ball.name == "B-1"
    settings = spherecal.CalibrationSettings(ball=ball)
    done = spherecal.calibrate_session(simulated[0], settings=settings)
    assert done.rig.scale.source == "ball"
    spherecal.save_calibration(done, tmp_path / "on-ball")
    spherecal.write_report(tmp_path / "on-ball", tmp_path / "report.pdf")


def test_simulations_are_written_where_asked(tmp_path: Path) -> None:
    session, truth = spherecal.simulate_session(
        "demo", 3, spherecal.SimulationOptions(placements=2), folder=tmp_path / "s"
    )
    assert session == spherecal.load_session(tmp_path / "s") and len(truth.placements) == 2
    with pytest.raises(spherecal.InputError, match="need a folder"):
        spherecal.simulate_session("demo", images=True)


def test_cross_validation_leaves_each_placement_out(simulated) -> None:
    whole, found = spherecal.cross_validate_session(simulated[0])
    assert len(found) == 4 and repr(whole).startswith("<Calibration (auto): <Rig: 6 cameras")


# --- as people have them ---------------------------------------------------------------------------------------------


def by_camera_and_frame(session: spherecal.Session) -> dict[str, dict[str, tuple[np.ndarray, np.ndarray]]]:
    """{camera: {frame: (ids, uv)}} of one point of each target."""
    o = session.observations
    assert o is not None
    found: dict[str, dict[str, tuple[np.ndarray, np.ndarray]]] = {}
    for c, camera in enumerate(o.cameras):
        for t, frame in enumerate(o.placements):
            rows = (o.camera == c) & (o.placement == t) & (o.point == 0)
            if rows.any():
                found.setdefault(camera, {})[frame] = (o.target[rows], o.uv[rows])
    return found


def test_points_with_ids_by_camera_and_frame(simulated) -> None:
    """Refused before, without a word on what is accepted."""
    session = simulated[0]
    lenses, sizes = in_opencvs_terms(session)
    points = by_camera_and_frame(session)
    table = {name: values[session.observations.point == 0] for name, values in table_of(session).items()}
    first = spherecal.Session.from_arrays(table | {"point": ["centre"] * len(table["u"])}, lenses, sizes)
    turned = {
        frame: {camera: points[camera][frame] for camera in points if frame in points[camera]}
        for frame in first.observations.placements
    }
    by_id = {
        camera: {frame: dict(zip(ids.tolist(), uv.tolist(), strict=True)) for frame, (ids, uv) in frames.items()}
        for camera, frames in points.items()
    }
    charuco = {
        camera: {frame: (ids[:, None], uv[:, None]) for frame, (ids, uv) in frames.items()}
        for camera, frames in points.items()
    }
    rows = first.observations
    for given in (points, turned, by_id, charuco):
        made = spherecal.Session.from_arrays(given, lenses, sizes).observations
        assert {(made.cameras[c], made.placements[t], i, *uv) for c, t, i, uv in _rows(made)} == {
            (rows.cameras[c], rows.placements[t], i, *uv) for c, t, i, uv in _rows(rows)
        }
    done = spherecal.calibrate_points(points, lenses, sizes)
    assert len(done.rig.cameras) == 6 and done.rig.quality.rms_px < 0.2
    assert "lengths in arbitrary units" in repr(done.rig)


def _rows(o: spherecal.Observations | None):
    assert o is not None
    return zip(o.camera.tolist(), o.placement.tolist(), o.target.tolist(), o.uv.tolist(), strict=True)


def test_frames_by_number_keep_their_order_and_markers_their_corners() -> None:
    corners = np.arange(16, dtype=float).reshape(2, 4, 2)
    given = {"a": {2: ([7, 9], corners), 10: (None, None)}, "b": {1: ([[7]], corners[:1]), 10: ([9], corners[1:])}}
    made = spherecal.Session.from_arrays(given, {"a": K, "b": K}, (1000, 800)).observations
    assert (
        made is not None
        and made.placements == ("1", "2", "10")
        and made.points == ("0", "1", "2", "3")
        and len(made) == 16
    )
    assert sorted(set(made.target.tolist())) == [7, 9]


def test_one_matrix_serves_all_cameras() -> None:
    for lens in (K, np.array(K), (K, np.zeros(5))):
        made = spherecal.Session.from_arrays({"left": UV, "right": UV}, lens, (1000, 800))
        assert [camera.id for camera in made.cameras] == ["left", "right"]
        table = {name: values * 2 for name, values in ROW.items()} | {"camera": ["x", "y"]}
        assert [c.id for c in spherecal.Session.from_arrays(table, lens, (1000, 800)).cameras] == ["x", "y"]


@pytest.mark.parametrize(
    ("observations", "cameras", "more", "message"),
    [
        (
            {"C1": {"P1": (["x"], [[1.0, 2.0]])}},
            {"C1": K},
            {},
            r"C1, P1 must be \(ids, uv\).*\['x'\].*Give \{camera: \{frame",
        ),
        ({"C1": {"P1": ([1, 2], [[1.0, 2.0]])}}, {"C1": K}, {}, "C1, P1: 2 ids, but 1 image point"),
        (
            {"C1": {"P1": ([1], [[1, 2]])}, "C9": {"P1": ([1], [[1, 2]])}},
            {"C1": K},
            {},
            '"C9" is not in cameras. It has C1',
        ),
        ({"C9": UV}, {"C1": K}, {}, '"C9" is neither a camera nor a column.*Give '),
        ({"C1": {"P1": {1: (1, 2), 2: ("3,5", 4)}}}, {"C1": K}, {}, r"C1, P1 must be .* but are \{2: \('3,5', 4\)"),
        ({"C1": {"P1": {"dot1": (1, 2)}}}, {"C1": K}, {}, r"C1, P1 must be .* but are \{'dot1': \(1, 2\)"),
        ({"C1": {"P1": np.zeros((500, 2))}}, {"C1": K}, {}, r"C1, P1 must be .* but are an array \(500, 2\)"),
        (
            [{"camera": "C1", "target": 1, "u": 3.0, "v": 4.0}],
            {"C1": K},
            {},
            "must be an array of numbers. Give .*table",
        ),
        ({"camera": ["C1"], "target": [1], "x": [3.0], "y": [4.0]}, {"C1": K}, {}, "has no column u and no column v"),
        ({"camera": ["C1"], "id": [1], "u": [3.0], "v": [4.0]}, K, {}, "has no column target.*Give "),
        (ROW | {"u": ["388,66"]}, {"C1": K}, {}, "The column u has '388,66', which is not a number"),
        (ROW | {"target": [np.nan]}, {"C1": K}, {}, "The column target has nan, which is not a whole number"),
        (None, K, {}, "observations are None, which names no cameras.*Give "),
        (
            {"C1": UV},
            {"C1": {"K": K, "dist": [0, 0, 0, 0]}},
            {},
            r'lens of camera "C1" must be K \(3, 3\), \(K, dist\)',
        ),
        (7, {"C1": K}, {}, "observations are 7, which holds no image points.*Give "),
        ({}, {"C1": K}, {}, "no image points.*Give "),
        ({"C1": UV}, 1000.0, {}, r"cameras must be \{camera: K\}.*but is 1000.0"),
        ({"C1": UV}, "lens.json", {}, r"cameras must be \{camera: K\}"),
        ({"P1": {"C1": UV}}, K, {}, "One K for all cameras.*which are frames.*name: K for"),
        ({"C1": UV}, {"C1": K}, {"scale": 500.0}, "scale must be a Scale.*sphere_diameter_mm.*, but is 500.0"),
        ({"C1": UV}, {"C1": K}, {"target_set": "targets.json"}, "target_set must be a TargetSet.*load_targets"),
        ({"C1": UV}, {"C1": K}, {"bars": [400.0]}, "Each item of bars must be a Bar, but is 400.0"),
        ({"C1": UV}, {"C1": K}, {"sphere_diameter_mm": {}}, r"sphere_diameter_mm must be a number .* is \{\}"),
        ({"C1": UV}, {"C1": K}, {"sphere_diameter_mm": -5}, "sphere_diameter_mm must be above 0, but is -5"),
        ({"C1": UV}, {"C1": K}, {"settings": {"method": "free"}}, "settings must be CalibrationSettings"),
    ],
)
def test_what_cannot_be_taken_says_what_can(
    observations: Any, cameras: Any, more: dict[str, Any], message: str
) -> None:
    """Raw errors of numpy and Python before."""
    with pytest.raises(spherecal.InputError) as refused:
        spherecal.calibrate_points(observations, cameras, (1000, 800), **more)
    assert re.search(message, str(refused.value), re.DOTALL), str(refused.value)


def test_what_was_not_seen_may_be_none() -> None:
    """Of detectors that give None for a frame or an id that they do not find, and tables with a column "frame"."""
    seen = {1: (10.0, 20.0), 2: None, 3: (30.0, 40.0)}
    given = {"C1": {"f1": seen, "f2": None}, "C2": {"f1": None, "f2": {1: [1.0, 2.0]}}, "C3": None}
    made = spherecal.Session.from_arrays(given, dict.fromkeys(given, K), (1000, 800)).observations
    assert made is not None and made.placements == ("f1", "f2")
    assert made.target.tolist() == [1, 3, 1] and made.camera.tolist() == [0, 0, 1]
    table = {name: values * 2 for name, values in ROW.items()} | {"frame": [7, 8]}
    made = spherecal.Session.from_arrays(table, {"C1": K}, (1000, 800)).observations
    assert made is not None and made.placements == ("7", "8")


@pytest.mark.parametrize("sigma", [{}, "0.1", None, 0, -1, float("nan"), [0.1, 0.2], True])
def test_a_sigma_that_is_no_number_is_named(calibrated, sigma: Any) -> None:
    with pytest.raises(spherecal.InputError, match=r"sigma_px must be (a number )?above 0, but is "):
        spherecal.triangulate_points(calibrated.rig, {"C01": UV, "C02": UV}, sigma_px=sigma)


loose: Any = spherecal  # called as no type checker would let pass
# Arrays, whose shapes are checked where they are used, and a protocol.
OPEN = {"calibrate_points": {"observations", "cameras"}, "detect_targets": {"image"}, "live_sets": {"source"}}


def test_every_argument_of_another_kind_is_refused_with_what_is_accepted() -> None:
    """`'dict' object has no attribute 'repairs'` before, and the like of 15 others."""
    named = 0
    for name in spherecal.__all__:
        function = getattr(spherecal, name)
        if not inspect.isfunction(function) or function.__module__ != "spherecal_app.api":
            continue
        for argument in inspect.signature(function).parameters:
            if argument not in OPEN.get(name, ()):
                with pytest.raises(spherecal.InputError, match=rf"^{argument} must be .+, but is <object"):
                    function(**{argument: object()})
                named += 1
    assert named > 120


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda s, rig: loose.calibrate_session(s, settings={"lens": "brown"}), "settings must be Calibr.*method="),
        (lambda s, rig: loose.calibrate_session(s, context=print), r"a Context \(such as Context\(on_progress"),
        (lambda s, rig: loose.calibrate_session(s, "fast"), "no method fast|has the method fast.*Methods: auto"),
        (lambda s, rig: loose.verify_rig(s, rig, limit=0.03), "limit must be a LengthLimit.*0.03.L/20000"),
        (lambda s, rig: loose.measure(s, rig, task="3,5"), "task must be a Task or None, but is '3,5'"),
        (lambda s, rig: loose.plan_bar_poses(rig, "B1"), "Each item of bars must be a RegisteredBar.*load_bars"),
        (lambda s, rig: loose.recalibrate_cameras(s, rig, None), "cameras must be a list of strings"),
        (lambda s, rig: loose.save_calibration(rig, "x"), "calibration must be a Calibration .*calibrate_session"),
        (lambda s, rig: loose.write_target_sheet("x", "s.pdf"), "targets must be a TargetSet .load_targets"),
        (lambda s, rig: loose.detect_targets(np.zeros((9, 9), np.uint8), [1]), "or the path of a targets.json"),
        (lambda s, rig: loose.simulate_session("demo", 1, {"targets": 40}), r"SimulationOptions\(targets="),
        (lambda s, rig: loose.define_frame("x", offset_mm=5), "offset_mm must be 3 numbers"),
        (lambda s, rig: loose.new_session("o", ".", sphere_diameter_mm="500"), "must be a number or None"),
        (lambda s, rig: loose.project_points(rig, [0, 0, 1], frame="x"), "frame must be a UserFrame"),
        (lambda s, rig: loose.Rig.from_opencv([K], (1000, 800)), r"\{camera: \(K, dist, rvec, tvec\)\}"),
        (lambda s, rig: loose.triangulate_points(rig, {"C01": UV, "C02": UV}).length_mm(0, 99), "not found"),
    ],
)
def test_a_wrong_argument_is_named_with_what_is_accepted(simulated, calibrated, call: Any, said: str) -> None:
    with pytest.raises(spherecal.InputError) as refused:
        call(simulated[0], calibrated.rig)
    assert re.search(said, f"{refused.value}", re.DOTALL), f"{refused.value}"


@pytest.mark.parametrize("wrong", [7, None, {"cameras": []}, [1, 2]])
def test_neither_a_rig_nor_a_path_is_said(wrong: Any) -> None:
    for call, what in (
        (lambda: spherecal.load_rig(wrong), "a path"),
        (lambda: spherecal.calibrate_session(wrong), "a Session, or the path of its folder"),
        (lambda: spherecal.triangulate_points(wrong, {"C01": UV}), "a Rig"),
        (lambda: spherecal.project_points(wrong, [0, 0, 1]), "a Rig"),
        (lambda: spherecal.export_rig(wrong, "opencv", "x"), "a Rig, or the path"),
        (lambda: spherecal.compare_rigs(wrong, wrong), "a Rig, or the path"),
    ):
        with pytest.raises(spherecal.InputError, match=what):
            call()


def test_one_camera_alone_is_said(calibrated) -> None:
    with pytest.warns(UserWarning, match=r"2 of 2 points are seen by one camera alone .*two cameras"):
        measured = spherecal.triangulate_points(calibrated.rig, {"C01": UV})
    assert repr(measured) == "<MeasuredPoints: 0 of 2 found, 2 seen by one camera alone>"


def test_results_show_themselves_in_a_notebook(simulated, calibrated) -> None:
    rig = calibrated.rig
    some = spherecal.project_points(rig, calibrated.spheres[0].centre_mm[None])
    for shown, word in (
        (calibrated, "Calibration"),
        (simulated[0], "Session"),
        (spherecal.triangulate_points(rig, some), "MeasuredPoints"),
        (spherecal.verify_rig(simulated[0], rig), "Verification"),
    ):
        page = shown._repr_html_()
        assert word in page and "<table>" in page and page.count("<tr>") == page.count("</tr>") > 1, page[:300]
        assert len(page) < 20_000


def test_results_show_themselves_at_the_prompt(simulated, calibrated, tmp_path: Path) -> None:
    """A verification filled pages with its arrays."""
    rig = calibrated.rig
    for shown, word in (
        (spherecal.verify_rig(simulated[0], rig), "<Verification: consistent, 48 lengths, largest error 0.0"),
        (spherecal.check_rig(simulated[0], rig), "<Check: ok; "),
        (spherecal.export_rig(rig, "opencv", tmp_path / "out"), "<Exported: OpenCV YAML, 6 cameras in mm, largest "),
        (rig.quality.findings[0], f"<Finding {rig.quality.findings[0].code} ("),
    ):
        assert repr(shown).startswith(word) and len(repr(shown)) < 500, repr(shown)


def test_help_is_short_and_names_what_it_takes() -> None:
    for name in spherecal.__all__:  # type: ignore[attr-defined]
        thing = getattr(spherecal, name)
        if inspect.isclass(thing) or inspect.isroutine(thing):
            text = pydoc.plain(pydoc.render_doc(thing))
            assert "_SupportsArray" not in text, name
    parameters = inspect.signature(spherecal.calibrate_points).parameters
    assert {"scale", "fisheye", "bars", "bar_poses", "target_set", "sphere_diameter_mm"} <= set(parameters)
    made = inspect.signature(spherecal.Session.from_arrays).parameters
    assert {n: p.default for n, p in made.items()} == {n: parameters[n].default for n in made}


def test_verbs_are_no_modules() -> None:
    """`spherecal.calibrate(...)` was "'module' object is not callable"."""
    code = (
        "import spherecal; spherecal.Rig\n"
        "for name in ('calibrate', 'verify', 'detect', 'cross_validate'):\n"
        "    try:\n        getattr(spherecal, name)\n"
        "    except AttributeError as error:\n        print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    said = done.stdout.splitlines()
    assert len(said) == 4 and "calibrate_points or calibrate_session meant?" in said[0] and "verify_rig" in said[1]


def test_importing_loads_neither_numpy_nor_temporary_files() -> None:
    """33 ms before, 7 ms after; `spherecal --version` took 0.19 processor seconds, then 0.10."""
    for code in ("import spherecal", "from spherecal_app.cli import main"):
        line = f"import sys; before = set(sys.modules); {code}; print(*set(sys.modules) - before)"
        done = subprocess.run([sys.executable, "-c", line], capture_output=True, text=True, check=True)
        loaded = {name.partition(".")[0] for name in done.stdout.split()}
        assert "numpy" not in loaded and ("tempfile" not in loaded or "cli" in code), loaded
