"""Reading a session: what the files say arrives, in the units and frames of docs/conventions.md."""

import hashlib
import json
import time
from pathlib import Path

import numpy as np
import pytest

from spherecal.data.observations import Observations
from spherecal.data.session import Mark, Scale
from spherecal_files.read_session import read_session
from spherecal_files.table_file import read_observations, write_observations
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions
from tests.example_session import OBSERVATIONS, VALID, changed, make_session


def test_cameras(tmp_path: Path) -> None:
    first, second = read_session(make_session(tmp_path)).cameras
    assert (first.id, first.serial, first.image_size, first.prior_given) == ("C01", "50-0503343", (2064, 1544), True)
    np.testing.assert_array_equal(first.prior, [2318, 2318, 1031.5, 771.5] + 12 * [0])
    assert (second.id, second.serial, second.prior_given, second.intrinsics_group) == ("C02", None, False, "all")
    f_px = 8.0 / 3.45e-3
    np.testing.assert_allclose(second.prior, [f_px, f_px, 1031.5, 771.5] + 12 * [0], rtol=1e-14)


def test_each_camera_has_its_own_intrinsics_by_default(tmp_path: Path) -> None:
    document = changed("cameras", 0, "intrinsics_group", to=None)
    assert read_session(make_session(tmp_path, document)).cameras[0].intrinsics_group == "C01"


@pytest.mark.parametrize("length", [4, 5, 8, 12])
def test_distortion_is_filled_up(tmp_path: Path, length: int) -> None:
    numbers = [0.01 * (i + 1) for i in range(length)]
    session = read_session(make_session(tmp_path, changed("cameras", 0, "prior", "distortion", to=numbers)))
    np.testing.assert_array_equal(session.cameras[0].prior[4:], numbers + (12 - length) * [0.0])


def test_bars_scale_board_and_sphere(tmp_path: Path) -> None:
    session = read_session(make_session(tmp_path))
    (bar,) = session.bars
    assert bar.marks == {"A1": Mark(901, "centre"), "A2": Mark(902, "centre")}
    assert (bar.lengths[0].length_mm, bar.lengths[0].coverage_factor) == (412.345, 2.0)
    assert session.bar_poses[0].temperature_c == 21.5
    assert session.scale == Scale("target_spacing", "A", "E", 20.0, "sphere")
    assert session.sphere_diameter_mm == 500.0
    assert session.board is not None
    assert [(p.target, p.xyz_mm) for p in session.board[4:6]] == [(4, (0.0, 3.5, 0.0)), (5, (3.5, 3.5, 0.0))]
    points = [{"target": 2, "point": "centre", "xyz_mm": [1, 2, 3]}]
    board = read_session(make_session(tmp_path, changed("board", to={"points": points}))).board
    assert board is not None
    assert (board[0].target, board[0].point, board[0].xyz_mm) == (2, "centre", (1.0, 2.0, 3.0))


def test_only_cameras_are_needed_for_a_session_of_bars(tmp_path: Path) -> None:
    document = {key: VALID[key] for key in ("format", "version", "cameras", "bars", "bar_poses")}
    session = read_session(make_session(tmp_path, document, [OBSERVATIONS[0], OBSERVATIONS[3]]))
    assert session.placements == ()
    assert (session.scale, session.board, session.target_set, session.sphere_diameter_mm) == (None, None, None, None)


def test_observations(tmp_path: Path) -> None:
    o = read_session(make_session(tmp_path)).observations
    assert o is not None and o.sigma is not None
    assert (o.placements, o.cameras, o.points) == (("P1", "P2", "A-01"), ("C01", "C02"), ("A", "centre"))
    np.testing.assert_array_equal(o.placement, [0, 0, 2])
    np.testing.assert_array_equal(o.camera, [0, 1, 1])
    np.testing.assert_array_equal(o.target, [1, 1, 901])
    np.testing.assert_array_equal(o.point, [0, 0, 1])
    np.testing.assert_array_equal(o.uv, [[100.25, 200.5], [300.25, 200.5], [1000, 1000]])
    np.testing.assert_array_equal(o.sigma[2], [0.04, 0.05])


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.rstrip("\n"),
        lambda text: text + "\n\n",
        lambda text: text.replace("P1,C01,1,A", '"P1","C01",1,"A"').replace("placement", '"placement"'),
    ],
    ids=["mark", "CRLF", "no line end", "empty lines", "quoted"],
)
def test_spreadsheet_habits_are_tolerated(tmp_path: Path, spoil) -> None:
    folder = make_session(tmp_path)
    expected = read_session(folder).observations
    table = folder / "observations.csv"
    table.write_bytes(spoil(table.read_text()).encode())
    read = read_session(folder).observations
    assert expected is not None and read is not None
    assert read.points == expected.points
    np.testing.assert_array_equal(read.uv, expected.uv)


def test_table_of_only_the_header(tmp_path: Path) -> None:
    o = read_session(make_session(tmp_path, lines=OBSERVATIONS[:1])).observations
    assert o is not None
    assert (len(o), o.points) == (0, ())


def test_image_points_just_outside_are_tolerated(tmp_path: Path) -> None:
    """Noise and the eccentricity correction may push a dot at the border a little outside; 10 % is ample."""
    lines = [OBSERVATIONS[0], "P1,C01,1,A,-3.5,1546.5,0.04,0.04"]
    assert read_session(make_session(tmp_path, lines=lines)).observations is not None


def test_hash_is_that_of_sha256sum_over_all_named_files(tmp_path: Path) -> None:
    folder = make_session(tmp_path)
    listing = "".join(
        f"{hashlib.sha256((folder / name).read_bytes()).hexdigest()}  {name}\n"
        for name in ("observations.csv", "session.json", "targets.json")
    )
    missing = "missing  P2/C01.png\n" + listing  # capitals come first
    assert read_session(folder).input_sha256 == hashlib.sha256(missing.encode()).hexdigest()
    (folder / "P2").mkdir()
    before = read_session(folder).input_sha256
    (folder / "P2" / "C01.png").write_bytes(b"picture")
    session = read_session(folder)
    assert session.input_sha256 != before
    assert session.placements[1].images == {"C01": (folder / "P2" / "C01.png").absolute()}


def test_unknown_fields_are_ignored(tmp_path: Path) -> None:
    document = changed("remarks", to=["taken on a Friday"])
    assert len(read_session(make_session(tmp_path, document)).cameras) == 2


def test_simulated_session_returns(tmp_path: Path) -> None:
    session, truth = simulate_session("rigA", 1, SimulationOptions(placements=2, targets=20, bar_poses=2))
    write_session(session, truth, tmp_path / "session")
    again = read_session(tmp_path / "session")
    assert session.observations is not None and again.observations is not None
    names = again.observations.points
    np.testing.assert_array_equal(again.observations.uv, session.observations.uv)
    before = [session.observations.points[i] for i in session.observations.point]
    assert [names[i] for i in again.observations.point] == before
    assert (again.bars, again.bar_poses, again.scale) == (session.bars, session.bar_poses, session.scale)


def test_real_recording(shared_data: Path) -> None:
    session = read_session(shared_data / "dome15")
    assert session.observations is not None
    assert (len(session.cameras), len(session.placements), len(session.observations)) == (15, 12, 6560)
    assert {camera.intrinsics_group for camera in session.cameras} == {"gopro"}


def test_deep_and_wide_names_survive(tmp_path: Path) -> None:
    document = json.loads(json.dumps(VALID).replace("C01", "Kamera-Süd_1"))
    lines = [line.replace("C01", "Kamera-Süd_1") for line in OBSERVATIONS]
    o = read_session(make_session(tmp_path, document, lines)).observations
    assert o is not None and o.cameras[0] == "Kamera-Süd_1"


def test_a_million_rows_take_seconds(tmp_path: Path) -> None:
    n = 200_000
    index = np.arange(n)
    ids = tuple(f"P{i}" for i in range(20)), tuple(f"C{i}" for i in range(50)), ("A", "B", "C", "D")
    uv = np.random.default_rng(0).uniform(0, 1500, (n, 2))
    o = Observations(*ids, index // 10_000, index % 50, index // 200 % 50, index // 50 % 4, uv)
    write_observations(tmp_path / "observations.csv", o)
    start = time.perf_counter()
    again = read_observations(tmp_path / "observations.csv", *ids[:2], [(2064, 1544)] * 50)
    assert time.perf_counter() - start < 5.0  # 0.6 s was measured; a busy machine may take longer
    np.testing.assert_array_equal(again.uv, uv)
