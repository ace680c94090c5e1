"""`spherecal measure` and `spherecal.measure`: series folders, live cameras, body files, the stream."""

import csv
import importlib.util
import json
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import spherecal
from spherecal.base.errors import InputError, OutputError
from spherecal.data.rig import Rig
from spherecal.targets.detection import DetectionSettings, Detector
from spherecal.targets.family import make_target_set
from spherecal_app.cli.main import main
from spherecal_cameras.protocol import CameraError, CameraInfo, Discovery
from spherecal_cameras.simulated.simulated_source import SimulatedSource
from spherecal_measuring.live_sets import LiveSets, LiveSettings, known_of, rig_cameras_of
from spherecal_measuring.measurer import Measurer
from spherecal_measuring.search_regions import RegionSearch, _boxes
from spherecal_measuring.series_file import run, sets_of_session, write_series
from spherecal_measuring.stream import MeasurementStream
from spherecal_rigs.kept_checks import read_checks
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions

BODY = {
    "format": "spherecal/body", "version": 1, "name": "tool",
    "points": [
        {"target": 1, "xyz_mm": [0, 0, 0]}, {"target": 2, "xyz_mm": [50, 0, 0], "sigma_mm": 0.01},
        {"target": 3, "point": "A", "xyz_mm": [0, 40, 0]},
    ],
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("measure")


@pytest.fixture(scope="module")
def session(folder: Path) -> Path:
    write_session(*simulate_session("demo", 1, SimulationOptions(targets=80, bar_poses=2)), folder / "session")
    return folder / "session"


@pytest.fixture(scope="module")
def result(session: Path, folder: Path) -> Path:
    assert main(["calibrate", str(session), "-o", str(folder / "result")]) == 0
    return folder / "result"


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


# --- series ----------------------------------------------------------------------------------------------------------


def test_the_command_writes_what_python_measures(session: Path, result: Path, tmp_path: Path) -> None:
    arguments = ["measure", str(session), "--rig", str(result), "-o", str(tmp_path / "series")]
    assert main([*arguments, "--temperature", "20"]) == 0
    loaded = spherecal.load_session(session)
    task = spherecal.Task(loaded.target_set, bars=loaded.bars, temperature_c=20.0)
    series = spherecal.measure(session, result, task)
    points = rows(tmp_path / "series" / "points.csv")
    assert len(points) == sum(len(one.names) for one in series.sets) > 100
    first, one = points[0], series.sets[0]
    assert (first["set"], first["id"], first["target"]) == ("1", one.id, str(one.names[0].target))
    np.testing.assert_allclose([float(first[k]) for k in ("x_mm", "y_mm", "z_mm")], one.points_mm[0], rtol=1e-11)
    assert float(first["sigma_z_mm"]) == pytest.approx(one.sigma_mm[0, 2], rel=1e-9)
    values = rows(tmp_path / "series" / "values.csv")
    assert [row["name"] for row in values] == [v.name for s in series.sets for v in s.values]
    assert float(values[0]["u_deviation"]) > 0
    document = json.loads((tmp_path / "series" / "series.json").read_text())
    assert (document["format"], document["sets"]) == ("spherecal/series", len(series.sets))
    assert len(rows(tmp_path / "series" / "cameras.csv")) == sum(len(s.cameras) for s in series.sets)


def test_a_series_is_replaced_and_nothing_else_is(session: Path, result: Path, tmp_path: Path) -> None:
    target = tmp_path / "series"
    spherecal.measure(session, result, output=target)
    spherecal.measure(session, result, output=target)
    (target / "mine.txt").write_text("mine")
    with pytest.raises(OutputError):
        spherecal.measure(session, result, output=target)
    assert (target / "mine.txt").read_text() == "mine"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGTERM")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_measurement_that_is_ended_keeps_its_sets(result: Path, tmp_path: Path, number: signal.Signals) -> None:
    words = ["--cameras", "simulated:demo", "--rig", result, "-o", tmp_path / "series", "--rate", "5", "--json"]
    process = subprocess.Popen(
        [sys.executable, "-m", "spherecal_app.cli.main", "measure", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: [signal.signal(one, signal.SIG_DFL) for one in (signal.SIGINT, signal.SIGTERM)],  # noqa: PLW1509
    )
    assert process.stdout is not None
    seen = [json.loads(process.stdout.readline()) for _ in range(2)]
    process.send_signal(number)
    rest, err = process.communicate(timeout=60)
    assert process.returncode in (0, 3), err
    shown = len(seen) + len(rest.splitlines())
    assert json.loads((tmp_path / "series" / "series.json").read_text())["sets"] in (shown, shown + 1)


def test_what_ends_a_measurement_loses_nothing(session: Path, result: Path, tmp_path: Path) -> None:
    rig = spherecal.load_rig(result)
    measurer = Measurer(rig)
    sets = list(sets_of_session(spherecal.load_session(session), rig))

    def lost():
        yield from sets[:3]
        raise CameraError("All cameras are gone.")

    with pytest.raises(CameraError, match="gone"):
        run(lost(), measurer, lambda _: None, tmp_path / "series")
    assert json.loads((tmp_path / "series" / "series.json").read_text())["sets"] == 3
    with pytest.raises(CameraError):  # nothing measured: no folder
        run((one for one in _raising()), Measurer(rig), lambda _: None, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def _raising():
    raise CameraError("None.")
    yield


@pytest.mark.skipif(importlib.util.find_spec("pyarrow") is not None, reason="pyarrow is installed")
def test_parquet_without_pyarrow_is_a_clear_error(
    session: Path, result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["measure", str(session), "--rig", str(result), "-o", str(tmp_path / "s"), "--table", "parquet"]
    assert main(command) == 2
    assert "pip install pyarrow" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_parquet_holds_what_csv_holds(session: Path, result: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="Parquet tables need pyarrow")
    spherecal.measure(session, result, output=tmp_path / "p", table="parquet")
    spherecal.measure(session, result, output=tmp_path / "c")
    for name in ("points", "values", "bodies", "cameras", "contradictions"):
        table = parquet.read_table(tmp_path / "p" / f"{name}.parquet")
        text = rows(tmp_path / "c" / f"{name}.csv")
        assert table.num_rows == len(text)
        for ours, theirs in zip(table.to_pylist(), text, strict=True):
            for key, value in ours.items():
                assert (
                    (value is None and theirs[key] == "")
                    or str(value) == theirs[key]
                    or value == pytest.approx(float(theirs[key]), rel=1e-9)
                )


def test_json_lines(session: Path, result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["measure", str(session), "--rig", str(result), "--json", "--distance", "3,5=100"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["set"] for line in lines] == list(range(1, len(lines) + 1))
    assert len(lines[0]["points"][0]["covariance_mm2"]) == 6
    assert all(value["deviation"] is not None for line in lines for value in line["values"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "either a session or live cameras"),
        (["SESSION", "--cameras", "simulated"], "either a session or live cameras"),
        (["SESSION", "--distance", "1"], "not a valid distance"),
        (["SESSION", "--bar", "X-7"], "no bar X-7"),
        (["SESSION", "--rate", "0"], "--rate"),
        (["SESSION", "--skew-ms", "-1"], "--skew-ms"),
        (["SESSION", "--stream", "99999"], "no port"),
        (["--cameras", "nonsense"], "no camera source"),
    ],
)
def test_bad_options_are_clear_errors(
    session: Path, result: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [str(session) if word == "SESSION" else word for word in options]
    assert main(["measure", *given, "--rig", str(result)]) == 2
    assert message in capsys.readouterr().err


# --- bodies ----------------------------------------------------------------------------------------------------------


def test_a_body_comes_back(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps(BODY))
    body = spherecal.load_body(tmp_path / "a.json")
    assert [str(point.name) for point in body.points] == ["1", "2", "3/A"]
    spherecal.save_body(body, tmp_path / "b.json")
    assert spherecal.load_body(tmp_path / "b.json") == body


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": BODY["points"][:2]}, "at least 3"),
        ({"points": [{"target": i, "xyz_mm": [i, 2 * i, 0]} for i in range(4)]}, "one line"),
        ({"points": [*BODY["points"], BODY["points"][0]]}, "same point"),  # type: ignore[misc]
        ({"points": [*BODY["points"], {"target": 9, "xyz_mm": [0, 0]}]}, "must have 3 values"),  # type: ignore[misc]
        ({"points": [*BODY["points"], {"target": -1, "xyz_mm": [0, 0, 0]}]}, "points\\[3\\].target"),  # type: ignore[misc]
        ({"name": "a/b"}, "name"),
        ({"version": 2}, "later version"),
        ({"format": "spherecal/rig"}, "is not a"),
    ],
)
def test_a_wrong_body_file_is_named(tmp_path: Path, change: dict, message: str) -> None:
    (tmp_path / "body.json").write_text(json.dumps({**BODY, **change}))
    with pytest.raises(InputError, match=message) as error:
        spherecal.load_body(tmp_path / "body.json")
    assert "body.json" in str(error.value)


def test_a_body_learned_from_a_set_lies_there_as_it_was(session: Path, result: Path, tmp_path: Path) -> None:
    first = spherecal.measure(session, result).sets[0]
    points = tuple(
        spherecal.BodyPoint(name, tuple(xyz.tolist()), 0.01)
        for name, xyz in zip(first.names[:8], first.points_mm[:8], strict=True)
    )
    spherecal.save_body(spherecal.Body("ball", points), tmp_path / "ball.json")
    series = tmp_path / "series"
    assert (
        main(["measure", str(session), "--rig", str(result), "--body", str(tmp_path / "ball.json"), "-o", str(series)])
        == 0
    )
    row = rows(series / "bodies.csv")[0]
    assert (row["set"], row["body"], row["points"], row["points_left_out"]) == ("1", "ball", "8", "")
    assert float(row["qw"]) == pytest.approx(1.0, abs=1e-9)
    assert abs(float(row["x_mm"])) < 1e-6
    assert 0 < float(row["cov_11"]) < 1e-4 and float(row["cov_44"]) > 0
    pytest.importorskip("pyarrow", reason="Parquet tables need pyarrow")
    task = spherecal.Task(
        spherecal.load_session(session).target_set, bodies=(spherecal.load_body(tmp_path / "ball.json"),)
    )
    spherecal.measure(session, result, task, output=tmp_path / "p", table="parquet")


# --- live ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bench() -> tuple[SimulatedSource, Rig]:
    """The demo rig's simulated cameras, and the rig as it truly is."""
    source = SimulatedSource("demo", 1)
    cameras = tuple(
        spherecal.RigCamera(c.id, None, c.kind.image_size, c.intrinsics, c.rotation, c.translation_mm, 0.05, 0, None)
        for c in source.stage.truth.cameras
    )
    return source, spherecal.Rig.from_opencv(
        {c.id: (c.K, c.dist, c.rotation, c.tvec) for c in cameras}, {c.id: c.image_size for c in cameras}
    )


def test_live_bars_come_out_right(bench: tuple[SimulatedSource, Rig]) -> None:
    source, rig = bench
    bench_session = source.stage.session
    assert bench_session.target_set is not None
    source.show("A-01")
    source.open(source.discover().serials, {})
    live = spherecal.live_sets(source, rig, bench_session.target_set, LiveSettings(rate_hz=50, sets=4))
    series = spherecal.measure(live, rig, spherecal.Task(bench_session.target_set, bars=bench_session.bars))
    assert [one.number for one in series.sets] == [1, 2, 3, 4]
    truth = {v.name: v for v in series.sets[-1].values}
    assert len(truth) == 3
    assert max(abs(v.deviation or 0.0) for v in truth.values()) < 0.02  # mm, at 0.02 px
    assert all(one.latency_s is not None and one.skew_s is not None for one in series.sets)


def test_cameras_are_found_by_serial_or_name(bench: tuple[SimulatedSource, Rig]) -> None:
    _, rig = bench
    rig = replace(rig, cameras=(replace(rig.cameras[0], serial="S7"), *rig.cameras[1:3]))
    infos = tuple(
        CameraInfo(serial, "m", "v", "p", user_name=name) for serial, name in (("S7", "x"), ("S8", "C02"), ("S9", "z"))
    )
    found = rig_cameras_of(rig, Discovery(infos), {"S9": "C03"})
    assert {serial: camera.id for serial, camera in found.items()} == {"S7": "C01", "S8": "C02", "S9": "C03"}
    twins = tuple(CameraInfo(serial, "m", "v", "p", user_name="C02") for serial in ("S1", "S2"))
    with pytest.raises(InputError, match="S1, S2"):  # whichever came first would measure with the other's lens
        rig_cameras_of(rig, Discovery(twins))
    impostor = CameraInfo("S1", "m", "v", "p", user_name="C01")
    found = rig_cameras_of(rig, Discovery((impostor, CameraInfo("S7", "m", "v", "p"))))
    assert {serial: camera.id for serial, camera in found.items()} == {"S7": "C01"}
    with pytest.raises(InputError, match="None of the cameras"):
        rig_cameras_of(rig, Discovery((CameraInfo("S1", "m", "v", "p", user_name="other"),)))


def test_images_of_another_size_are_refused(bench: tuple[SimulatedSource, Rig]) -> None:
    source, rig = bench
    smaller = replace(rig, cameras=tuple(replace(c, image_size=(640, 512)) for c in rig.cameras))
    source.open(source.discover().serials, {})
    live = LiveSets(source, rig_cameras_of(smaller, source.discover()), make_target_set(), LiveSettings(sets=1))
    with pytest.raises(InputError, match="sends images of 1280 x 1024"):
        list(live)


def test_the_command_measures_live_cameras(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["measure", "--cameras", "simulated:demo", "--rig", str(result), "--sets", "2", "-o", str(tmp_path / "s")]
    assert main([*command, "--stream", "0"]) == 0
    said = capsys.readouterr()
    assert "127.0.0.1:" in said.err
    assert "2 sets measured" in said.out
    times = [float(row["time_s"]) for row in rows(tmp_path / "s" / "cameras.csv")]
    assert times == sorted(times)


def test_health_is_kept_in_the_profile(session: Path, result: Path, tmp_path: Path) -> None:
    spherecal.save_to_profile(result, tmp_path / "rig", apply=True)
    rig = spherecal.load_rig(result)
    one = next(sets_of_session(spherecal.load_session(session), rig))
    measurer = Measurer(rig, spherecal.Task(spherecal.load_session(session).target_set))
    from spherecal_measuring.health import keep_health

    measurer.measure(one)
    assert keep_health(tmp_path / "rig", measurer.health, rig) is False  # too few to tell
    for number in range(2, 101):
        measurer.measure(replace(one, number=number))
    assert keep_health(tmp_path / "rig", measurer.health, rig, 21.0)
    (kept,), problems = read_checks(tmp_path / "rig")
    assert problems == ()
    assert kept.sentence.startswith("While measuring 100 sets")
    assert kept.verdict == "ok"
    assert kept.rms_px is not None and kept.temperature_c == 21.0
    assert keep_health(result, measurer.health, rig) is False  # no profile


# --- predicted regions -----------------------------------------------------------------------------------------------


def test_a_part_of_an_image_gives_what_the_whole_gives(bench: tuple[SimulatedSource, Rig]) -> None:
    source, rig = bench
    target_set = source.stage.session.target_set
    assert target_set is not None
    source.show("A-01")
    source.open(source.discover().serials, {})
    detector = Detector(target_set)
    images = source.capture_set().frames
    frame, known = max(
        ((images[f"SIM-{camera.id}"], known_of(camera)) for camera in rig.cameras),
        key=lambda pair: len(detector.detect(pair[0].image, pair[1])),
    )
    search = RegionSearch(detector.detect, known)
    whole = search.find(frame.image, 0.0)
    assert search.last_part == 1.0
    part = search.find(frame.image, 0.1)
    assert search.last_part < 0.4
    assert part.target.tolist() == whole.target.tolist() and part.point.tolist() == whole.point.tolist()
    assert np.abs(part.uv - whole.uv).max() < 0.01  # px; thresholds see a little less around
    search.find(frame.image, 1.05)
    assert search.last_part == 1.0  # once a second


def test_targets_that_move_are_followed_and_new_ones_found_with_the_whole_image() -> None:
    """A fake detector that sees only what lies in the part it is given."""
    from spherecal.targets.detection import Detections

    image = np.zeros((1024, 1280), np.uint8)
    truth: dict[int, np.ndarray] = {}

    def detect(part: np.ndarray, settings: DetectionSettings) -> Detections:
        assert settings.principal_point_px is not None
        offset = np.array([640.0, 512.0]) - settings.principal_point_px
        own = {t: uv - offset for t, uv in truth.items()}
        size = np.array(part.shape[::-1])
        own = {t: uv for t, uv in own.items() if ((uv > 20) & (uv < size - 20)).all()}
        ids = np.array(sorted(own), dtype=np.int64)
        uv = np.array([own[t] + d for t in sorted(own) for d in ([-15, -15], [15, 15])]).reshape(-1, 2)
        none = np.zeros(len(ids))
        return Detections(
            ("A", "B"), np.repeat(ids, 2), np.tile([0, 1], len(ids)), uv, np.ones_like(uv), ids, none, none, none
        )

    search = RegionSearch(detect, DetectionSettings(1000.0, (640.0, 512.0)))
    way = np.cumsum([0, 30, 60, *[90] * 7])  # px from image to image; the margin alone would follow 55
    for k in range(10):
        truth[1] = np.array([200.0 + way[k], 300.0])
        if k == 3:
            truth[2] = np.array([900.0, 800.0])
        found = search.find(image, 0.1 * k)
        assert 1 in found.target_ids
        assert 2 not in found.target_ids  # it is not around the last places
        if k:
            assert search.last_part < 0.2
    assert {1, 2} == set(search.find(image, 1.1).target_ids)


def test_boxes_hold_all_cells_and_do_not_overlap() -> None:
    rng = np.random.default_rng(1)
    for share in (0.0, 0.02, 0.1, 0.3):
        for _ in range(20):
            cells = rng.random((17, 23)) < share
            count = np.zeros(cells.shape, int)
            for box in _boxes(cells):
                count[box] += 1
            assert count.max(initial=0) <= 1
            assert (count[cells] == 1).all()


# --- the stream ------------------------------------------------------------------------------------------------------


def read_line(file) -> dict:
    return json.loads(file.readline())


def test_the_stream_sends_every_set_to_every_client() -> None:
    with MeasurementStream(0, {"cameras": ["C01"]}) as stream:
        sockets = [socket.create_connection(("127.0.0.1", stream.port), 5) for _ in range(2)]
        files = [one.makefile("r") for one in sockets]
        for file in files:
            hello = read_line(file)
            assert hello == {"format": "spherecal/measurements", "version": 1, "cameras": ["C01"]}
        for k in range(3):
            stream.send({"set": k})
        for file in files:
            assert [read_line(file)["set"] for _ in range(3)] == [0, 1, 2]
        sockets[0].sendall(b"anything that a client says is not read\n" * 100)
        stream.send({"set": 3})
        assert read_line(files[1])["set"] == 3
        stream.send({"set": 4})
    assert read_line(files[1])["set"] == 4  # what was sent before the end is delivered
    assert files[1].readline() == ""


def test_the_stream_listens_on_the_loopback_only() -> None:
    with MeasurementStream(0) as stream:
        assert stream._server.getsockname()[0] == "127.0.0.1"


def test_a_slow_client_is_dropped_and_holds_nobody_up() -> None:
    with MeasurementStream(0, queue_lines=4) as stream:
        slow = socket.socket()
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect(("127.0.0.1", stream.port))
        wait_until(lambda: stream.clients == 1)
        line = {"points": "x" * 1_000_000}
        for _ in range(40):
            stream.send(line)
            if stream.dropped:
                break
        assert stream.dropped == 1
        quick = socket.create_connection(("127.0.0.1", stream.port), 5)
        file = quick.makefile("r")
        assert read_line(file)["format"] == "spherecal/measurements"
        stream.send({"set": 1})
        assert read_line(file) == {"set": 1}


def test_a_port_in_use_is_a_clear_error() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(InputError, match="Cannot listen on port"):
            MeasurementStream(taken.getsockname()[1])


def wait_until(met, seconds: float = 5.0) -> None:
    until = time.monotonic() + seconds
    while not met():
        assert time.monotonic() < until
        time.sleep(0.005)


def test_a_wrong_table_is_not_written(result: Path, tmp_path: Path) -> None:
    """A generator that is not used is closed, and nothing is left behind."""
    rig = spherecal.load_rig(result)
    with pytest.raises(ValueError, match="boom"):
        write_series((_boom() for _ in range(1)), Measurer(rig), tmp_path / "s")
    assert list(tmp_path.iterdir()) == []


def _boom():
    raise ValueError("boom")
