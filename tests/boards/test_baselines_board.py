"""Calibration by a board: against simulated truth, with parts missing, refused input, and a real recording."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from spherecal.base.context import Context
from spherecal.base.errors import InputError
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.geometry.rotation import log_rotation
from spherecal.geometry.transform import fit_similarity
from spherecal.steps.settings import CalibrationSettings
from spherecal_app.cli.main import main
from spherecal_boards.board import calibrate_board
from spherecal_boards.board_images import find_boards
from spherecal_boards.pattern_entry import read_board_pattern
from spherecal_files.read_session import read_session
from spherecal_files.table_file import write_observations
from spherecal_sim.simulated_boards import SimulatedRecording, simulate_board

PITCH = 33.0


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    with threadpool_limits(1, user_api="blas"):
        yield


@pytest.fixture(scope="module")
def recording() -> SimulatedRecording:
    return simulate_board("demo", 3, 16, rows=6, columns=8)


@pytest.fixture(scope="module")
def calibration(recording) -> Calibration:
    return calibrate_board(recording.session)


def codes(calibration: Calibration) -> set[str]:
    return {finding.code for finding in calibration.rig.quality.findings}


def errors_over_sigma(recording: SimulatedRecording, calibration: Calibration) -> dict[str, np.ndarray]:
    """Errors after a similarity over the points, divided by their stated uncertainties."""
    f = calibration.features
    truth = recording.points_mm[f.placement, f.target]
    seen = calibration.views > 0
    assert calibration.rig.scale.relative_uncertainty is not None
    fit = fit_similarity(calibration.points_mm[seen], truth[seen])
    errors = {
        "points": ((fit.apply(calibration.points_mm) - truth) @ fit.rotation / calibration.points_sigma_mm)[seen],
        "scale": np.array([(fit.scale - 1) / calibration.rig.scale.relative_uncertainty]),
    }
    true = {camera.id: camera for camera in recording.cameras}
    parts = {"centre": [], "rotation": [], "intrinsics": []}
    for camera in calibration.rig.cameras:
        assert camera.sigma is not None
        other = true[camera.id]
        moved = (fit.apply(camera.centre_mm[None])[0] - other.centre_mm) @ fit.rotation
        turned = np.rad2deg(log_rotation(camera.rotation @ fit.rotation.T @ other.rotation.T))
        free = camera.sigma.intrinsics > 0
        parts["centre"].append(moved / camera.sigma.centre_mm)
        parts["rotation"].append(turned / camera.sigma.rotation_deg)
        parts["intrinsics"].append((camera.intrinsics - other.intrinsics)[free] / camera.sigma.intrinsics[free])
    return errors | {name: np.concatenate(values) for name, values in parts.items()}


def test_errors_are_those_that_the_result_states(recording, calibration):
    assert calibration.rig.quality.valid
    assert len(calibration.rig.cameras) == 6
    assert calibration.rig.scale.source == "board"
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=0.03)
    for name, z in errors_over_sigma(recording, calibration).items():
        # 48 correlated intrinsics scatter by 15 %; the single scale by its own size
        assert np.sqrt((z**2).mean()) < (3.0 if name == "scale" else 1.5), name
    z = errors_over_sigma(recording, calibration)
    assert 0.7 < np.sqrt((z["points"] ** 2).mean()) < 1.3
    assert 0.7 < np.sqrt((z["intrinsics"] ** 2).mean()) < 1.3


def test_points_are_the_boards_at_every_placement(recording, calibration):
    f = calibration.features
    assert len(f) == 16 * 48
    board = np.array([p.xyz_mm for p in recording.session.board])
    for placement in range(16):
        own = calibration.points_mm[f.placement == placement]
        fit = fit_similarity(board, own)
        assert fit.scale == pytest.approx(1.0, abs=1e-9)
        assert np.abs(fit.apply(board) - own).max() < 1e-6
    assert (calibration.views == 0).any()  # corners that are out of every picture are there all the same


def test_shared_and_fixed_intrinsics(recording):
    cameras = tuple(replace(c, intrinsics_group="all") for c in recording.session.cameras)
    shared = calibrate_board(replace(recording.session, cameras=cameras))
    assert len({tuple(c.intrinsics) for c in shared.rig.cameras}) == 1
    true = {c.id: c.intrinsics for c in recording.cameras}
    cameras = tuple(replace(c, prior=true[c.id]) for c in recording.session.cameras)
    session = replace(recording.session, cameras=cameras)
    fixed = calibrate_board(session, CalibrationSettings(intrinsics="fixed"))
    for camera in fixed.rig.cameras:
        assert (camera.intrinsics == true[camera.id]).all()
        assert camera.sigma is not None and not camera.sigma.intrinsics.any()
    assert fixed.rig.quality.sigma0 == pytest.approx(0.04, rel=0.03)
    z = errors_over_sigma(recording, fixed)
    assert 0.7 < np.sqrt((z["points"] ** 2).mean()) < 1.3


def test_the_engines_agree(recording, calibration):
    other = calibrate_board(recording.session, context=Context())
    for a, b in zip(calibration.rig.cameras, other.rig.cameras, strict=True):
        assert np.abs(a.centre_mm - b.centre_mm).max() < 1e-4


def test_outliers_are_left_out(recording, calibration):
    rng = np.random.default_rng(5)
    o = recording.session.observations
    uv = o.uv.copy()
    wrong = rng.permutation(len(o))[: len(o) // 25]
    uv[wrong] += rng.uniform(5, 40, (len(wrong), 2)) * rng.choice([-1, 1], (len(wrong), 2))
    spoilt = calibrate_board(replace(recording.session, observations=replace(o, uv=uv)))
    assert spoilt.rig.quality.valid
    assert not spoilt.used[wrong].any()
    assert (~spoilt.used).sum() < 1.02 * len(wrong)
    for a, b in zip(calibration.rig.cameras, spoilt.rig.cameras, strict=True):
        assert np.linalg.norm(a.centre_mm - b.centre_mm) < 0.3


def without(session: Session, drop) -> Session:
    o = session.observations
    assert o is not None
    return replace(session, observations=o.select(~drop(o)))


def test_unlinked_cameras_are_named_group_by_group(recording):
    first, last = [0, 1, 3], [2, 4, 5]

    def drop(o):  # each half of the cameras has placements of its own
        return (np.isin(o.camera, first) & (o.placement % 2 == 0)) | (np.isin(o.camera, last) & (o.placement % 2 == 1))

    result = calibrate_board(without(recording.session, drop))
    assert not result.rig.quality.valid
    assert len(result.rig.cameras) == 3
    finding = next(f for f in result.rig.quality.findings if f.code == "cameras-unlinked")
    groups = {"C01 C02 C04", "C03 C05 C06"}
    listed = finding.message.split(": ", 1)[1].rstrip(".").split(" | ")
    assert set(listed) == groups
    assert set(finding.where) == {f"C0{i}" for i in range(1, 7)}


def test_a_single_camera_is_a_rig(recording):
    alone = calibrate_board(_only(recording.session, 0))
    assert alone.rig.quality.valid
    assert alone.rig.reference_camera == "C01"
    assert alone.rig.cameras[0].intrinsics[0] == pytest.approx(recording.cameras[0].intrinsics[0], rel=1e-3)


def _only(session: Session, camera: int) -> Session:
    o = session.observations
    assert o is not None
    own = o.select(o.camera == camera)
    own = replace(own, cameras=(o.cameras[camera],), camera=np.zeros(len(own), dtype=np.int64))
    return replace(session, cameras=(session.cameras[camera],), observations=own)


def test_a_camera_with_one_view_is_held_by_its_prior(recording):
    once = {int(p) for p in recording.session.observations.placement[recording.session.observations.camera == 5]}
    kept = min(once)
    result = calibrate_board(without(recording.session, lambda o: (o.camera == 5) & (o.placement != kept)))
    finding = next(f for f in result.rig.quality.findings if f.code == "intrinsics-held")
    assert finding.where == ("C06",)
    held = next(c for c in result.rig.cameras if c.id == "C06")
    assert held.intrinsics[0] == pytest.approx(recording.session.cameras[5].prior[0], rel=0.03)


def test_a_solid_figure_of_points_serves_as_well(recording):
    rng = np.random.default_rng(1)
    lift = rng.uniform(0, 80, 48)
    board = tuple(
        replace(p, xyz_mm=(p.xyz_mm[0], p.xyz_mm[1], float(z)))
        for p, z in zip(recording.session.board, lift, strict=True)
    )
    solid = _observed_again(recording, board)
    result = calibrate_board(solid.session)
    assert result.rig.quality.valid
    z = errors_over_sigma(solid, result)
    assert 0.6 < np.sqrt((z["points"] ** 2).mean()) < 1.4


def _observed_again(recording: SimulatedRecording, board) -> SimulatedRecording:
    """The same placements with another figure, seen without noise but for 0.04 px."""
    from spherecal.geometry.camera import project

    flat = np.array([p.xyz_mm for p in recording.session.board])
    solid = np.array([p.xyz_mm for p in board])
    points = np.array([fit_similarity(flat, at, with_scale=False).apply(solid) for at in recording.points_mm])
    o = recording.session.observations
    assert o is not None
    noise = 0.04 * np.random.default_rng(7).normal(size=o.uv.shape)
    uv = np.empty_like(o.uv)
    for c, camera in enumerate(recording.cameras):
        own = o.camera == c
        x = points[o.placement[own], o.target[own]] @ camera.rotation.T + camera.translation_mm
        uv[own] = project(x, camera.intrinsics)
    session = replace(recording.session, board=board, observations=replace(o, uv=uv + noise))
    return SimulatedRecording(session, recording.cameras, points)


def test_observations_of_other_things_are_left_out(recording):
    board = tuple(p for p in recording.session.board if p.target < 40)
    result = calibrate_board(replace(recording.session, board=board))
    assert result.rig.quality.valid
    assert "not-on-board" in codes(result)
    assert result.features.target.max() == 39


def write(recording: SimulatedRecording, folder: Path, **board) -> Path:
    session = recording.session
    document = {
        "format": "spherecal/session",
        "version": 1,
        "cameras": [
            {"id": c.id, "image_size": list(c.image_size), "pixel_pitch_um": 4.8, "focal_length_mm": 8.0}
            for c in session.cameras
        ],
        "placements": [{"id": p.id} for p in session.placements],
        "board": {"rows": 6, "columns": 8, "pitch_mm": PITCH, **board},
    }
    folder.mkdir()
    (folder / "session.json").write_text(json.dumps(document))
    assert session.observations is not None
    write_observations(folder / "observations.csv", session.observations)
    return folder


def test_command_line_and_the_boards_own_uncertainty(recording, tmp_path):
    session = write(recording, tmp_path / "session", relative_uncertainty=2e-4)
    assert main(["calibrate", str(session), "-o", str(tmp_path / "r"), "--method", "board"]) == 0
    rig = json.loads((tmp_path / "r" / "rig.json").read_text())
    assert rig["scale"]["source"] == "board"
    assert rig["scale"]["relative_uncertainty"] == pytest.approx(2e-4, rel=0.05)
    assert rig["software"]["method"] == "board"
    assert len((tmp_path / "r" / "points.csv").read_text().splitlines()) == 1 + 16 * 48


@pytest.mark.parametrize(
    ("board", "says"),
    [
        ({"kind": "round"}, "board.kind must be"),
        ({"kind": "circles", "rings": [[6, 0]]}, "rings[0][0] must be from 0 to 5"),
        ({"kind": "charuco"}, 'lacks "marker_mm"'),
        ({"kind": "charuco", "marker_mm": 40, "dictionary": "DICT_5X5_100"}, "smaller than pitch_mm"),
        ({"kind": "charuco", "marker_mm": 20, "dictionary": "5X5"}, "not the name of an OpenCV dictionary"),
        ({}, 'lacks "kind"'),
    ],
)
def test_boards_for_images_are_checked(recording, tmp_path, board, says):
    folder = write(recording, tmp_path / "session", **board)
    with pytest.raises(InputError, match="board") as error:
        calibrate_board(replace(read_session(folder), observations=None))
    assert says in str(error.value)


def test_refused_sessions(recording, tmp_path):
    with pytest.raises(InputError, match="needs a board"):
        calibrate_board(replace(recording.session, board=None))
    far = replace(recording.session.observations, target=recording.session.observations.target + 1000)
    with pytest.raises(InputError, match="none of its observations"):
        calibrate_board(replace(recording.session, observations=far))


def test_a_badly_printed_board_is_noticed_and_estimated(tmp_path):
    recording = simulate_board("demo", 6, 24, rows=6, columns=8, print_sd_mm=0.08)
    nominal = calibrate_board(read_session(write(recording, tmp_path / "nominal", shape="nominal")))
    assert "board-shape" in codes(nominal)
    assert nominal.rig.quality.sigma0 > 0.05
    session = read_session(write(recording, tmp_path / "session", shape="estimated"))
    estimated = calibrate_board(session)
    assert "board-shape-estimated" in codes(estimated)
    by_itself = calibrate_board(recording.session)  # says nothing of the shape
    assert by_itself.rig.cameras[0].translation_mm == pytest.approx(estimated.rig.cameras[0].translation_mm)
    assert next(f for f in by_itself.rig.quality.findings if f.code == "board-shape-estimated").kind == "by-itself"
    assert estimated.rig.quality.sigma0 == pytest.approx(0.04, rel=0.03)
    (printed,) = (f for f in estimated.rig.quality.findings if f.code == "board-shape-estimated")
    # two of three coordinates are off by 0.08 mm; 48 points tell that to 7 %
    assert printed.values["off_mm"] == pytest.approx(0.08 * np.sqrt(2 / 3), rel=0.2)
    found = replace(recording, session=session)
    z = errors_over_sigma(found, estimated)
    for name, values in z.items():
        assert np.sqrt((values**2).mean()) < (3.0 if name == "scale" else 1.5), name
    assert 0.7 < np.sqrt((z["points"] ** 2).mean()) < 1.3
    worse = errors_over_sigma(recording, nominal)
    assert np.sqrt((worse["points"] ** 2).mean()) > 1.5  # what the finding warns of


def test_a_good_board_raises_no_doubts(calibration):
    assert "board-shape" not in codes(calibration)


@pytest.fixture(scope="module")
def dotboard(shared_data: Path, tmp_path_factory) -> Session:
    """The real recording with the dots found in it."""
    images = shared_data / "dotboard"
    if not images.is_dir():
        pytest.skip(f"no recording at {images}")
    folder = tmp_path_factory.mktemp("dotboard")
    placements = []
    for n in range(1, 15):
        names = {f"C{c}": f"CalB-sys2-{n:04d}_{c}.jpeg" for c in (0, 1)}
        for name in names.values():
            shutil.copy(images / name, folder / name)
        placements.append({"id": f"P{n:02d}", "images": names})
    camera = {"image_size": [2448, 2048], "pixel_pitch_um": 3.45, "focal_length_mm": 42.0}
    board = {"kind": "circles", "rows": 8, "columns": 10, "pitch_mm": 3.5, "rings": [[2, 2], [2, 7], [5, 2]]}
    document = {
        "format": "spherecal/session", "version": 1, "cameras": [{"id": "C0", **camera}, {"id": "C1", **camera}],
        "placements": placements, "board": board,
    }  # fmt: skip
    (folder / "session.json").write_text(json.dumps(document))
    session = read_session(folder)
    found = find_boards(session, read_board_pattern(session), Context())
    assert found.missed == ()
    board["shape"] = "estimated"  # not read by the session: the test with nominal points goes without its folder
    (folder / "session.json").write_text(json.dumps(document))
    return replace(session, observations=found.observations)


def test_real_boards_are_found_although_dots_run_out_of_the_picture(dotboard):
    o = dotboard.observations
    count = np.bincount(o.placement * 2 + o.camera)
    assert len(count) == 28
    assert count.min() >= 72
    assert count.max() == 80


@pytest.mark.parametrize(("camera", "rms_px"), [(0, 0.48), (1, 0.49)])
def test_real_camera_alone(dotboard, camera, rms_px):
    result = calibrate_board(_only(replace(dotboard, folder=Path()), camera))
    assert result.rig.quality.valid
    assert result.rig.quality.rms_px <= rms_px
    assert result.used.mean() > 0.98  # the figure is not bought by leaving dots out


def baseline(result: Calibration) -> float:
    return float(np.linalg.norm(result.rig.cameras[0].centre_mm - result.rig.cameras[1].centre_mm))


def test_real_pair(dotboard, tmp_path):
    document = json.loads((dotboard.folder / "session.json").read_text())
    document["board"]["shape"] = "nominal"
    (tmp_path / "session.json").write_text(json.dumps(document))
    result = calibrate_board(replace(dotboard, folder=tmp_path))
    assert result.rig.quality.valid
    assert result.rig.quality.rms_px <= 0.60
    assert result.used.mean() > 0.98
    assert "board-shape" in codes(result)  # a laser print on paper


@pytest.mark.parametrize("stated", [True, False])
def test_real_pair_with_the_print_estimated(dotboard, stated):
    result = calibrate_board(dotboard if stated else replace(dotboard, folder=Path()))
    assert result.rig.quality.valid
    assert result.rig.quality.rms_px < 0.05
    assert result.used.mean() > 0.98
    # twin cameras with twin lenses, which nothing in the adjustment knows
    first, second = (c.intrinsics for c in result.rig.cameras)
    assert first[0] == pytest.approx(second[0], rel=1e-3)
    assert np.abs([first[6:8], second[6:8]]).max() < 2e-3
    assert baseline(result) == pytest.approx(89.65, abs=0.1)


@pytest.mark.parametrize("cameras", [(1,), (0, 1)])
def test_real_image_points_with_u_and_v_exchanged_are_named(dotboard, cameras):
    o = dotboard.observations
    uv = np.where(np.isin(o.camera, cameras)[:, None], o.uv[:, ::-1], o.uv)
    result = calibrate_board(replace(dotboard, observations=replace(o, uv=uv), folder=Path()))
    told = [f for f in result.rig.quality.findings if f.code == "mirrored"]
    assert [(f.kind, f.where) for f in told] == [("axes", tuple(f"C{c}" for c in cameras))]
    assert result.rig.quality.verdict == "not-valid"


def test_a_focal_length_that_is_only_assumed_may_be_far_off(recording):
    """As `session new` writes it where EXIF says nothing: lenses may be four times as long."""
    session = without(recording.session, lambda o: o.placement % 2 == 1)  # half of the boards, in half of the time
    scaled = np.array([0.24, 0.24, 1, 1, *[1.0] * 12])
    cameras = tuple(replace(c, prior=c.prior * scaled, assumed=("focal_length",)) for c in session.cameras)
    found = calibrate_board(replace(session, cameras=cameras))
    assert found.rig.quality.valid and len(found.rig.cameras) == 6
    for ours, known in zip(found.rig, calibrate_board(session).rig, strict=True):
        assert ours.K[0, 0] == pytest.approx(known.K[0, 0], rel=1e-4)
    stated = tuple(replace(camera, assumed=()) for camera in cameras)
    refused = calibrate_board(replace(session, cameras=stated))
    assert not refused.rig.quality.valid or len(refused.rig.cameras) < 6 or refused.rig.quality.rms_px > 0.1
