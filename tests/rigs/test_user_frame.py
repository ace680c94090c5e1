"""The user's frame: by three places, offset and turns; its file, the command line, exports and points in it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import spherecal
from spherecal.base.errors import InputError, SpherecalError
from spherecal_app.cli.main import main
from spherecal_documents.export.write_export import FORMATS, export_rig
from spherecal_files.rig_file import rig_bytes
from spherecal_files.write_result import write_result
from spherecal_files.write_verification import write_verification
from spherecal_rigs.framed_rig import FRAME, in_frame, result_places, write_frame
from spherecal_rigs.user_frame import LEAST_ANGLE_DEG, TURNS, FrameDefinition, turn_matrix, user_frame
from spherecal_verify.verify_bars import verify
from tests.export_rigs import make_rig
from tests.method.test_session_fuzz import JSON_VALUES, leaves
from tests.networks import calibrated, one_thread

__all__ = ["one_thread"]

COORDINATE = st.floats(-3000, 3000)
PLACES = st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE), min_size=3, max_size=3).map(np.array)
OFFSET = st.tuples(COORDINATE, COORDINATE, COORDINATE)
THREE = FrameDefinition("P1", "P2", "P3")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A verified result of a simulated rig."""
    folder = tmp_path_factory.mktemp("frame") / "result"
    calibration, session, _ = calibrated("demo", 1, bar_poses=1)
    write_result(calibration, folder)
    write_verification(verify(session, calibration.rig), folder, folder / "rig.json")
    return folder


# --- geometry --------------------------------------------------------------------------------------------------------


def is_well_placed(places: np.ndarray) -> bool:
    try:
        user_frame(THREE, places)
    except InputError:
        return False
    return True


@settings(max_examples=50)
@given(PLACES, OFFSET, st.lists(st.sampled_from(TURNS), max_size=5))
def test_the_three_places_lie_where_the_definition_says(places, offset, turns):
    assume(is_well_placed(places))
    frame = user_frame(FrameDefinition("P1", "P2", "P3", offset, tuple(turns)), places)
    assert np.allclose(frame.rotation @ frame.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame.rotation) == pytest.approx(1)
    before_turning = frame.apply(places) @ turn_matrix(turns)  # the turns' inverse: they only exchange axes
    origin, x, xy = before_turning - np.array(offset)
    assert np.abs(origin).max() < 1e-8
    assert x == pytest.approx([frame.distance_mm, 0, 0], abs=1e-8)
    assert abs(xy[2]) < 1e-8 and xy[1] > 0
    assert np.degrees(np.arctan2(xy[1], xy[0])) == pytest.approx(frame.angle_deg)
    assert frame.apply(frame.origin_mm[None])[0] == pytest.approx([0, 0, 0], abs=1e-8)


def test_a_turn_takes_the_axes_along():
    frame = user_frame(FrameDefinition(turns=("z90",)))
    assert frame.rotation[0].tolist() == [0, 1, 0], "X points where Y did"
    assert user_frame(FrameDefinition(turns=("z90", "x90"))).rotation[1].tolist() == [0, 0, 1], "about the new X"
    for axis in "xyz":
        assert (turn_matrix([f"{axis}90"] * 4) == np.eye(3)).all()
        assert (turn_matrix([f"{axis}90", f"{axis}-90"]) == np.eye(3)).all()


def test_uncertainty_is_the_scatter_of_the_frame():
    random = np.random.default_rng(1)
    places = np.array([[0.0, 0, 0], [800, 100, 0], [300, 500, 200]])
    covariances = np.array([np.diag(np.square(s)) for s in ([0.1, 0.2, 0.1], [0.3, 0.1, 0.2], [0.1, 0.1, 0.4])])
    definition = FrameDefinition("a", "b", "c", (0.0, 50.0, 250.0), ("x90",))
    frame = user_frame(definition, places, covariances)
    moved = [
        user_frame(definition, places + np.array([random.multivariate_normal(np.zeros(3), c) for c in covariances]))
        for _ in range(1200)
    ]
    origins = np.array([frame.rotation @ (one.origin_mm - frame.origin_mm) for one in moved])
    turns = np.array([frame.rotation @ one.rotation.T for one in moved])
    about = np.degrees(np.stack([turns[:, 2, 1], turns[:, 0, 2], turns[:, 1, 0]], 1))
    assert origins.std(axis=0) == pytest.approx(frame.origin_sigma_mm, rel=0.1)
    assert about.std(axis=0) == pytest.approx(frame.axes_sigma_deg, rel=0.1)


@pytest.mark.parametrize(
    ("places", "words"),
    [
        ([[0, 0, 0], [100, 0, 0], [500, 40, 0]], ["a, b, c are nearly on a line", "c is only 40 mm", "4.6 degrees"]),
        ([[0, 0, 0], [100, 0, 0], [-500, 0, 0]], ["nearly on a line", "0 mm off", "angle 1.8e+02"]),
        ([[0, 0, 0], [0, 0, 12], [500, 0, 0]], ["a and b are only 12 mm apart"]),
        ([[0, 0, 0], [500, 0, 0], [0, 0, 0]], ["a and c are only 0 mm apart"]),
    ],
)
def test_places_that_define_no_frame_are_refused_and_it_says_how_near(places, words):
    with pytest.raises(InputError) as caught:
        user_frame(FrameDefinition("a", "b", "c"), np.array(places, dtype=float))
    for word in words:
        assert word in str(caught.value)


def test_just_beside_the_line_is_enough():
    for angle, good in ((LEAST_ANGLE_DEG - 0.1, False), (LEAST_ANGLE_DEG + 0.1, True)):
        third = 500 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0])
        assert is_well_placed(np.array([[0.0, 0, 0], [100, 0, 0], third])) is good


def test_a_definition_needs_three_different_places():
    for definition, words in ((FrameDefinition("P1", "P2"), "not 2"), (FrameDefinition("P1", "P2", "P1"), "twice")):
        with pytest.raises(InputError, match=words):
            user_frame(definition, np.eye(3))


# --- a result's places -----------------------------------------------------------------------------------------------


def test_a_results_places_are_balls_marks_and_points_asked_for(result: Path):
    places = result_places(result, ("P1/1/A",))
    kinds = {kind: [name for name, p in places.items() if p.kind == kind] for kind in ("ball", "mark", "point")}
    assert kinds["ball"] == ["P1", "P2", "P3", "P4"]
    assert kinds["point"] == ["P1/1/A"]
    pose, mark = kinds["mark"][0].split("/")
    ends = [places[name].place_mm for name in kinds["mark"] if name.startswith(f"{pose}/")]
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(500, abs=1), f"{mark} and its other end"


def test_poses_of_a_bar_that_gives_the_scale_are_places(tmp_path: Path):
    write_result(calibrated("demo", 1, bar_poses=1, scale="bar")[0], tmp_path / "result")
    points = [name for name, place in result_places(tmp_path / "result").items() if place.kind == "point"]
    assert len(points) >= 2
    assert all(name.endswith("/centre") for name in points)


def test_a_rigid_balls_centre_is_one_point_of_it(result: Path):
    """Against the truth: the centres' distances, by hundredths of what fitted spheres of a bumpy ball are off."""
    _, _, truth = calibrated("demo", 1, bar_poses=1)
    places = result_places(result)
    found = np.array([places[name].place_mm for name in truth.placements])
    rows, right = [], []  # where in the ball that point is: from all placements together
    for i in range(len(found)):
        for j in range(i):
            apart = truth.ball_places_mm[i] - truth.ball_places_mm[j]
            rows.append(2 * (truth.ball_rotations[i] - truth.ball_rotations[j]).T @ apart)
            right.append(np.linalg.norm(found[i] - found[j]) ** 2 - apart @ apart)
    body = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]
    true = truth.ball_places_mm + np.einsum("pij,j->pi", truth.ball_rotations, body)
    off = [np.linalg.norm(found[i] - found[j]) - np.linalg.norm(true[i] - true[j]) for i in range(4) for j in range(i)]
    assert np.abs(off).max() < 0.03
    for name, place in zip(truth.placements, found, strict=True):
        assert np.sqrt(np.diag(places[name].covariance_mm2)).max() < 0.05, (name, place)


# --- a rig in the frame ----------------------------------------------------------------------------------------------


def some_frame(rig: spherecal.Rig) -> spherecal.UserFrame:
    places = np.array([[100.0, -50, 900], [700, 80, 1100], [300, 500, 950]])
    made = user_frame(FrameDefinition("P1", "P2", "P3", (10.0, 20.0, 250.0), ("x90", "z-90")), places)
    return replace(made, reference_camera=rig.reference_camera, input_sha256=rig.input_sha256)


def test_a_rig_in_the_frame_sees_and_measures_the_same(result: Path):
    rig = spherecal.load_rig(result)
    frame = some_frame(rig)
    centre = next(iter(result_places(result).values())).place_mm
    points = centre + np.random.default_rng(1).uniform(-100, 100, (20, 3))
    seen = spherecal.project_points(rig, points)
    again = spherecal.project_points(rig, frame.apply(points), frame)
    for name, uv in seen.items():
        assert np.allclose(uv, again[name], atol=1e-8, equal_nan=True)
    plain = spherecal.triangulate_points(rig, seen, 0.05)
    turned = spherecal.triangulate_points(rig, seen, 0.05, frame)
    good = plain.views >= 2
    assert good.sum() > 10
    assert np.allclose(turned.points_mm[good], frame.apply(plain.points_mm[good]), atol=1e-6)
    expected = frame.rotation @ plain.covariance_mm2[good] @ frame.rotation.T
    assert np.allclose(turned.covariance_mm2[good], expected, rtol=1e-6, atol=1e-9)


def test_sigmas_of_centres_are_turned_with_their_covariance(result: Path):
    rig = spherecal.load_rig(result)
    assert rig.covariance is not None
    frame = some_frame(rig)
    width = 6 + len(rig.covariance.intrinsics)
    for i, (before, after) in enumerate(zip(rig.cameras, in_frame(rig, frame).cameras, strict=True)):
        assert before.sigma is not None and after.sigma is not None
        assert (after.sigma.rotation_deg == before.sigma.rotation_deg).all()
        first = i * width + 3
        shift = rig.covariance.matrix[first : first + 3, first : first + 3]
        to_user = frame.rotation @ before.rotation.T
        exact = np.sqrt(np.diag(to_user @ shift @ to_user.T))
        world = np.sqrt(np.diag(before.rotation.T @ shift @ before.rotation))
        assert before.sigma.centre_mm == pytest.approx(world, rel=0.25), "the covariance has the scale too"
        assert after.sigma.centre_mm == pytest.approx(exact, rel=0.25)
        assert (after.sigma.centre_mm**2).sum() == pytest.approx((before.sigma.centre_mm**2).sum())
    quarter = user_frame(FrameDefinition(turns=("z90",)))
    quarter = replace(quarter, reference_camera=rig.reference_camera)
    for before, after in zip(rig.cameras, in_frame(rig, quarter).cameras, strict=True):
        assert before.sigma is not None and after.sigma is not None
        assert after.sigma.centre_mm == pytest.approx(before.sigma.centre_mm[[1, 0, 2]])


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_poses_in_the_frame(tmp_path: Path, name: str):
    rig = make_rig(4, 6)
    frame = some_frame(rig)
    done = export_rig(rig, name, tmp_path / "out", frame=frame)
    most_px = {"maps": 1e-3, "mrcal-splined": 0.01}.get(name, 1e-6)  # maps are in float32, splines fitted
    assert done.largest_difference_px < most_px, "the projections of frame's points, read back"
    unit = 1000.0 if done.unit == "m" else 1.0
    read = {camera.id: camera for camera in FORMATS[name].read(tmp_path / "out")}
    plain = export_rig(rig, name, tmp_path / "plain")
    assert list(plain.ids) == list(done.ids), "cameras are numbered as without a frame"
    for camera, name_there in zip(rig.cameras, done.ids, strict=True):
        pose = read[name_there].pose
        assert pose is not None
        centre = -pose.rotation.T @ pose.translation * unit
        assert centre == pytest.approx(frame.apply(camera.centre_mm[None])[0], abs=1e-5)


def test_a_frame_of_another_reference_camera_is_refused(tmp_path: Path):
    rig = make_rig(4, 6)
    with pytest.raises(InputError, match="reference camera C1, but the rig's is C5"):
        export_rig(rig, "csv", tmp_path / "x", frame=replace(some_frame(rig), reference_camera="C1"))


# --- file and command line -------------------------------------------------------------------------------------------


def test_the_file_gives_the_same_frame_again(tmp_path: Path):
    frame = spherecal.define_frame(result_like(tmp_path), turns=("z90",))
    rich = some_frame(make_rig(4, 6))
    for i, one in enumerate((frame, rich)):
        write_frame(one, tmp_path / f"{i}.json")
        again = FRAME.read(tmp_path / f"{i}.json")
        assert (again.rotation == one.rotation).all() and (again.translation_mm == one.translation_mm).all()
        assert again.definition == one.definition
        assert (again.reference_camera, again.input_sha256) == (one.reference_camera, one.input_sha256)
        assert (again.distance_mm, again.angle_deg) == (one.distance_mm, one.angle_deg)


def result_like(folder: Path) -> Path:
    (folder / "rig.json").write_bytes(rig_bytes(make_rig(4, 3)))
    return folder


def frame_document(folder: Path) -> dict:
    write_frame(some_frame(make_rig(4, 6)), folder / "frame.json")
    return json.loads((folder / "frame.json").read_text())


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("rotation", [[1, 0, 0], [0, 1, 0], [0, 0, -1]], "rotation is not a rotation matrix"),
        ("rotation", [[1, 0], [0, 1]], "rotation must have 3 values"),
        ("translation_mm", [0, 0], "translation_mm must have 3 values"),
        ("definition", {"origin": "P1"}, "definition must name all of"),
        ("definition", {"turns": ["z45"]}, "turns[0] must be"),
        ("definition", {"offset_mm": [0, 0, "x"]}, "offset_mm[2] must be a number"),
        ("origin_sigma_mm", [1, 2, -3], "origin_sigma_mm[2] must be"),
        ("version", 2, "written by a later version"),
        ("format", "spherecal/rig", "is not a"),
    ],
)
def test_a_file_that_is_wrong_says_where(tmp_path: Path, key: str, value: object, words: str):
    document = frame_document(tmp_path) | {key: value}
    (tmp_path / "frame.json").write_text(json.dumps(document))
    with pytest.raises(SpherecalError) as caught:
        FRAME.read(tmp_path / "frame.json")
    assert words in str(caught.value) and "frame.json" in str(caught.value)


@settings(max_examples=40)
@given(st.data(), JSON_VALUES)
def test_whatever_the_file_holds_it_is_a_frame_or_one_of_our_errors(tmp_path_factory, data, value):
    folder = tmp_path_factory.mktemp("fuzz")
    document = frame_document(folder)
    path = data.draw(st.sampled_from(leaves(document)[1:]))
    inner = document
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    (folder / "frame.json").write_text(json.dumps(document))
    try:
        frame = FRAME.read(folder / "frame.json")
    except SpherecalError:
        return
    assert np.allclose(frame.rotation @ frame.rotation.T, np.eye(3), atol=1e-4)


def test_from_the_command_line_to_an_export(result: Path, tmp_path: Path, capsys):
    frame, out = tmp_path / "frame.json", tmp_path / "out"
    line = ["frame", str(result), "-o", str(frame), "--origin", "P1", "--x", "P2", "--xy", "P3"]
    assert main([*line, "--offset", "0", "0", "-250", "--turn", "x90", "x90"]) == 0
    said = capsys.readouterr().out
    assert "User's frame: origin P1, +X P2, XY P3, offset 0 0 -250 mm, turned x90 x90." in said
    assert "Standard uncertainty: origin" in said
    made = FRAME.read(frame)
    p1 = result_places(result)["P1"].place_mm
    assert made.apply(p1[None])[0] == pytest.approx([0, 0, 250]), "two turns about X turn Z about"
    assert main(["export", str(result / "rig.json"), "--to", "opencv", "-o", str(out), "--frame", str(frame)]) == 0
    said = capsys.readouterr().out
    assert "Poses are given in the user's frame: origin P1" in said
    assert "another calibration" not in said
    told = json.loads((out / "export.json").read_text())
    assert told["frame"]["definition"]["origin"] == "P1"
    assert "user's frame: origin P1" in told["source"]


def test_another_calibrations_frame_is_used_and_said_so(result: Path, tmp_path: Path, capsys):
    frame = spherecal.define_frame(result, "P1", "P2", "P3")
    rig = spherecal.load_rig(result)
    spherecal.save_frame(replace(frame, input_sha256="0" * 64), tmp_path / "frame.json")
    words = ["export", str(result / "rig.json"), "--to", "csv", "-o", str(tmp_path / "x.csv")]
    assert main([*words, "--frame", str(tmp_path / "frame.json")]) == 0
    assert f"only if the reference camera {rig.reference_camera} has not moved" in capsys.readouterr().out


def test_bad_use_is_code_2_with_one_message(result: Path, tmp_path: Path, capsys):
    places = ["--origin", "P1", "--x", "P2"]
    for arguments, expected in (
        ([str(result), *places], "A frame needs three places, not 2."),
        ([str(result), *places, "--xy", "P9"], 'no place "P9". Ball centres and bar marks: P1, P2, P3, P4'),
        ([str(result), *places, "--xy", "P1"], '"P1" is named twice'),
        ([str(result), "--turn", "z45"], "Turns: x90"),
        ([str(result), "--offset", "0", "nan", "0"], "offset"),
        ([str(tmp_path / "none")], "no such file"),
    ):
        assert main(["frame", *arguments, "-o", str(tmp_path / "frame.json")]) == 2
        error = capsys.readouterr().err
        assert expected in error and error.count("\n") == 1
        assert not (tmp_path / "frame.json").exists()
