"""ArUco and AprilTag markers as targets: found in rendered images, calibrated against the truth, read and printed."""

import csv
import json
import re
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from pypdf import PdfReader
from scipy.spatial.transform import Rotation

from benchmarks.simulators.rendered_stickers import (
    StickerBall,
    StickerCamera,
    camera_ring,
    painted_stickers,
    render_stickers,
    sticker_ball,
    write_sticker_session,
)
from benchmarks.studies.markers import compared
from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.geometry.camera import project
from spherecal.targets.detection import Detections, DetectionSettings, Detector
from spherecal.targets.family import DOTS
from spherecal.targets.marker_set import CORNERS
from spherecal.targets.target_set import TargetSet
from spherecal_app.cli.main import main
from spherecal_documents.sheets.sticker_sheet import scaled, sticker_places, write_sheet
from spherecal_files.rig_file import read_rig
from spherecal_files.target_set_file import make_marker_set, read_target_set, sticker_mm, write_target_set
from spherecal_gui.coverage import Dots
from spherecal_gui.tasks.placement_advice import observations_of, printed_scale
from spherecal_measuring.live_sets import collected
from spherecal_measuring.search_regions import _joined
from tests.documents.test_targets_sheet import MM_PER_POINT, NUMBER, pages

SIZE = (560, 448)


class Scene(NamedTuple):
    targets: TargetSet
    image: np.ndarray
    places: dict[tuple[int, str], np.ndarray]  # px


def sticker_points(ball: StickerBall) -> dict[tuple[int, str], FloatArray]:
    """The places (3,) mm of all points in the ball's own frame, by target and point."""
    found = {}
    for i, (target, layout) in enumerate(ball.targets.layouts.items()):
        up, right = ball.places[i], ball.right[i]
        for name, (x, y) in layout.items():
            arc = np.hypot(x, y)
            flat = (x * right + y * np.cross(right, up)) / arc
            angle = arc / ball.radius_mm
            found[target, name] = ball.radius_mm * (np.cos(angle) * up + np.sin(angle) * flat)
    return found


def scene(dictionary: str, **options: object) -> Scene:
    """One image of a ball with markers, and where their corners are in it, of those seen less obliquely than 60 deg."""
    random = np.random.default_rng(4)
    targets = make_marker_set(dictionary, 28.0, range(100), **options)  # type: ignore[arg-type]
    ball = sticker_ball(targets, 200.0, random)
    camera = camera_ring(3, SIZE, 960.0, 1000.0, random)[1]
    turn = Rotation.random(rng=random).as_matrix()
    image = render_stickers(ball, painted_stickers(targets), camera, turn, np.zeros(3), random)
    towards = -camera.rotation.T @ camera.translation
    facing = ball.places @ turn.T @ towards / np.linalg.norm(towards) > 0.5
    seen = {target for target, visible in zip(targets.layouts, facing, strict=True) if visible}
    points = {key: x for key, x in sticker_points(ball).items() if key[0] in seen}
    uv = project(np.array(list(points.values())) @ turn.T @ camera.rotation.T + camera.translation, camera.intrinsics)
    return Scene(targets, image, dict(zip(points, uv, strict=True)))


@pytest.fixture(scope="module", params=["DICT_4X4_250", "DICT_APRILTAG_36h11"])
def rendered(request: pytest.FixtureRequest) -> Scene:
    return scene(request.param)


def errors(found: Detections, places: dict[tuple[int, str], np.ndarray]) -> np.ndarray:
    keys = [(int(t), found.points[p]) for t, p in zip(found.target, found.point, strict=True)]
    known = [i for i, key in enumerate(keys) if key in places]
    return found.uv[known] - np.array([places[keys[i]] for i in known])


def test_corners_are_found_where_they_are(rendered: Scene) -> None:
    found = Detector(rendered.targets).detect(rendered.image)
    seen = {target for target, _ in rendered.places}
    assert len(seen & set(found.target_ids.tolist())) >= 0.65 * len(
        seen
    )  # 8 x 8 cells of 4 px: 16 of 23; 4 x 4 bits: 21
    off = errors(found, rendered.places)
    assert np.sqrt((off**2).mean()) < 0.12 and np.abs(off).max() < 0.7  # another corner or marker is 20 px off
    assert np.abs(off.mean(axis=0)).max() < 0.05
    assert 0.3 < np.sqrt((off**2).mean()) / np.median(found.sigma_uv) < 3
    assert (found.tilt_deg < 80).all() and 0.3 < np.median(found.blur_px) < 1.2


def test_other_depths_and_polarities_give_the_same(rendered: Scene) -> None:
    plain = Detector(rendered.targets).detect(rendered.image)
    deep = Detector(rendered.targets).detect(rendered.image.astype(np.uint16) * 16 + 5)
    np.testing.assert_allclose(deep.uv[np.isin(deep.target, plain.target)].mean(), plain.uv.mean(), atol=2.0)
    inverted = make_marker_set(str(rendered.targets.dictionary), 28.0, range(100), "light-on-dark")
    light = Detector(inverted).detect(255 - rendered.image)
    assert len(light.target_ids) >= 0.9 * len(plain.target_ids)
    assert np.abs(errors(light, rendered.places)).max() < 0.7
    assert not len(Detector(inverted).detect(rendered.image))


def test_a_marker_that_is_there_twice_is_left_out(rendered: Scene) -> None:
    found = Detector(rendered.targets).detect(rendered.image)
    twice = np.hstack([rendered.image, rendered.image])
    assert not len(Detector(rendered.targets).detect(twice))
    one = int(found.target_ids[0])
    own = found.uv[found.target == one]
    (left, top), (right, low) = own.min(axis=0) - 14, own.max(axis=0) + 14
    part = rendered.image[int(top) : int(low), int(left) : int(right)]
    copied = np.pad(rendered.image, ((0, 0), (0, 200)), constant_values=60)
    copied[10 : 10 + part.shape[0], -180 : -180 + part.shape[1]] = part
    again = Detector(rendered.targets).detect(copied)
    assert one not in again.target_ids and len(again.target_ids) >= 0.8 * (len(found.target_ids) - 1)


def test_what_is_ignored_and_what_is_not_there(rendered: Scene) -> None:
    detector = Detector(rendered.targets)
    found = detector.detect(rendered.image)
    left = ((-1.0, -1.0, SIZE[0] / 2, SIZE[1] + 1.0),)
    right = detector.detect(rendered.image, DetectionSettings(ignore=left))
    assert 0 < len(right) < len(found) and (right.uv[:, 0] > SIZE[0] / 2 - 1).all()
    nothing = detector.detect(np.full((100, 100), 90, np.uint8))
    assert nothing.points == CORNERS and len(nothing) == 0 and nothing.uv.shape == (0, 2)
    few = make_marker_set(str(rendered.targets.dictionary), 30.0, [int(found.target_ids[0])])
    assert Detector(few).detect(rendered.image).target_ids.tolist() == [found.target_ids[0]]


class Recorded(NamedTuple):
    folder: Path
    cameras: list[StickerCamera]
    centres_mm: float  # the distance of the centres of two markers, and of their corners 0
    corners_mm: float


MARKS = (31, 57)  # seen well at P3


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Four cameras, three placements of a ball with ArUco markers, of which two serve as a bar too."""
    random = np.random.default_rng(2)
    folder = tmp_path_factory.mktemp("markers") / "session"
    cameras = camera_ring(4, SIZE, 960.0, 1000.0, random, 100.0)
    ball = sticker_ball(make_marker_set("DICT_4X4_100", 28.0, range(100)), 200.0, random)
    write_sticker_session(folder, ball, cameras, 3, random)
    points = sticker_points(ball)
    first, second = (np.array([points[mark, corner] for corner in CORNERS]) for mark in MARKS)
    centres, corners = np.linalg.norm(first.mean(axis=0) - second.mean(axis=0)), np.linalg.norm(first[0] - second[0])
    session = json.loads((folder / "session.json").read_text(encoding="utf-8"))
    names = {"A": (MARKS[0], "centre"), "B": (MARKS[1], "centre"), "C": (MARKS[0], "0"), "D": (MARKS[1], "0")}
    session["bars"] = [
        {
            "id": "pair",
            "role": "check",
            "marks": {name: {"target": target, "point": point} for name, (target, point) in names.items()},
            "lengths": [
                {"from": a, "to": b, "length_mm": float(length), "expanded_uncertainty_mm": 0.01}
                for a, b, length in (("A", "B", centres), ("C", "D", corners))
            ],
        }
    ]
    pose = {"id": "B1", "bar": "pair", "temperature_c": 20.0, "images": session["placements"][2]["images"]}
    (folder / "session.json").write_text(json.dumps(session | {"bar_poses": [pose]}), encoding="utf-8")
    return Recorded(folder, cameras, float(centres), float(corners))


@pytest.fixture(scope="module")
def result(recorded: Recorded) -> Path:
    """Calibrated and verified."""
    folder = recorded.folder.parent / "result"
    assert main(["calibrate", str(recorded.folder), "-o", str(folder), "-q"]) == 0
    assert main(["verify", str(recorded.folder), "--rig", str(folder), "-o", str(folder), "-q"]) == 0
    return folder


@pytest.mark.slow
def test_a_session_with_markers_is_calibrated(recorded: Recorded, result: Path) -> None:
    figures = compared(read_rig(result / "rig.json"), recorded.cameras)
    assert figures.verdict in ("valid", "use-with-care")
    assert figures.rms_px < 0.2 and figures.observations > 400
    assert figures.over_stated < 4  # three placements with free lenses leave much open, and the result says how much
    assert figures.centre_mm < 30.0 and figures.turn_deg < 3.0 and abs(figures.scale_ppm) < 10_000


def test_an_image_without_markers_does_not_rename_the_corners_of_the_others(rendered: Scene) -> None:
    found = Detector(rendered.targets).detect(rendered.image)
    empty = _joined([])
    assert empty.points == DOTS and len(empty) == 0, "as a part of an image gives it"
    together = collected([0, 1], [empty, found], ("C1", "C2"))
    assert together.points == CORNERS and set(together.camera.tolist()) == {1} and len(together) == len(found)


def test_the_windows_table_has_the_names_of_corners(rendered: Scene) -> None:
    found = Detector(rendered.targets).detect(rendered.image)
    dots = {"P1": {"C1": Dots(found.target, found.point, found.uv, SIZE)}}
    assert observations_of(["P1"], ["C1"], dots, rendered.targets).points == CORNERS
    assert observations_of(["P1"], ["C1"], dots, None).points == DOTS
    scale = printed_scale(rendered.targets)
    assert scale is not None and {scale["from"], scale["to"]} in ({"0", "2"}, {"1", "3"})
    assert scale["distance_mm"] == pytest.approx(28 * 2**0.5)


# --- what follows a calibration --------------------------------------------------------------------------------------


def told(capsys: pytest.CaptureFixture[str], *words: object) -> list[dict]:
    """The documents that a command prints."""
    capsys.readouterr()
    assert main([*(str(word) for word in words), "--json"]) == 0
    text = capsys.readouterr().out
    return [json.loads(line) for line in text.splitlines()] if words[0] == "measure" else [json.loads(text)]


@pytest.mark.slow
def test_lengths_between_markers_are_verified(recorded: Recorded, result: Path) -> None:
    found = json.loads((result / "verification.json").read_text(encoding="utf-8"))
    assert found["decision"]["verdict"] == "consistent"
    assert [(one["from"], one["to"], one["n"]) for one in found["lengths"]] == [("A", "B", 1), ("C", "D", 1)]
    for length in found["lengths"]:  # without that, any error would be consistent
        assert abs(length["mean_error_mm"]) < length["expanded_uncertainty_mm"] < 0.5
    assert {one["state"] for one in found["cameras"]} == {"verified"}


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["html", "pdf", "json"])
def test_the_report_shows_them(
    recorded: Recorded, result: Path, tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = tmp_path / f"report.{ending}"
    if ending == "pdf":  # the scene is rendered for the other
        monkeypatch.setattr("spherecal_documents.scene.picture.scene_picture", lambda *_, **__: None)
    assert main(["report", str(result), "-o", str(report), "--session", str(recorded.folder), "-q"]) == 0
    if ending == "html":
        text = report.read_text(encoding="utf-8")
        assert all(camera.id in text for camera in recorded.cameras) and "pair" in text
    elif ending == "pdf":
        assert len(PdfReader(report).pages) > 3
    else:
        found = json.loads(report.read_text(encoding="utf-8"))
        assert len(found["verdicts"]) == 2 and "pair" in json.dumps(found["sections"])


@pytest.mark.slow
def test_markers_are_measured(recorded: Recorded, result: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a, b = MARKS
    centres, corners = f"{a},{b}={recorded.centres_mm}", f"{a}/0,{b}/0={recorded.corners_mm}"
    sets = told(
        capsys, "measure", recorded.folder, "--rig", result, "--distance", centres, "--distance", corners, "--not-kept"
    )
    assert [one["id"] for one in sets] == ["P1", "P2", "P3", "B1"] and all(len(one["points"]) > 15 for one in sets)
    measured = [value for one in sets[2:] for value in one["values"] if value["kind"] == "distance"]
    assert len(measured) >= 4
    for value in measured:
        assert abs(value["deviation"]) < 2 * value["u"] < 0.4


@pytest.mark.slow
def test_the_next_place_of_a_ball_with_markers_is_advised(
    recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    (found,) = told(capsys, "guide", recorded.folder)
    assert found["candidates"] and found["candidates"][0]["expanded_mm"] < found["now_mm"]


@pytest.mark.slow
def test_a_rig_is_checked_and_its_ball_used_again(
    recorded: Recorded, result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (found,) = told(capsys, "check", recorded.folder, "--profile", result, "--only", "P1", "--not-kept")
    assert found["verdict"] == "ok" and not found["balls"][0]["changed"]
    ball = tmp_path / "ball.json"
    (kept,) = told(capsys, "ball", "export", result, "-o", ball, "--session", recorded.folder)
    assert kept["targets"] > 30 and abs(kept["radius_mm"] - 200) < 2
    (again,) = told(capsys, "calibrate", recorded.folder, "--ball", ball, "-o", tmp_path / "again")
    assert again["form"]["name"] == "rigid" and "ball profile" in again["form"]["reason"]


# --- files -----------------------------------------------------------------------------------------------------------


def test_detect_writes_the_corners(rendered: Scene, tmp_path: Path) -> None:
    short = tmp_path / "targets.json"
    text = {
        "format": "spherecal/targets",
        "version": 1,
        "family": "aruco",
        "size_mm": 28,
        "dictionary": rendered.targets.dictionary,
    }
    short.write_text(json.dumps(text))
    table = tmp_path / "found.csv"
    cv2.imwrite(str(tmp_path / "image.png"), rendered.image)
    assert main(["detect", str(tmp_path / "image.png"), "--targets", str(short), "--csv", str(table)]) == 0
    rows = list(csv.DictReader(table.open()))
    assert len(rows) >= 40 and {row["point"] for row in rows} == set(CORNERS)
    assert {int(row["target"]) for row in rows} <= set(range(100))


def test_sets_are_read_as_they_were_written(tmp_path: Path) -> None:
    made = scaled(make_marker_set("DICT_5X5_50", 40.0, [3, 7]), 100.2, 99.9)
    write_target_set(tmp_path / "t.json", made)
    assert read_target_set(tmp_path / "t.json") == made
    assert (
        main(
            [
                "targets",
                "export",
                "--markers",
                "DICT_5X5_50",
                "--count",
                "2",
                "--first-id",
                "3",
                "-o",
                str(tmp_path / "c.json"),
            ]
        )
        == 0
    )
    assert sorted(read_target_set(tmp_path / "c.json").layouts) == [3, 4]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dictionary": "DICT_9X9"}, "not the name of an OpenCV dictionary"),
        ({"dictionary": None}, 'lacks "dictionary"'),
        ({"size_mm": 0}, "above 0"),
        ({"dot_diameter_mm": 3.0}, "for markers"),
        ({"targets": [{"id": 50, "dots": {}}]}, "at least one dot"),
        ({"targets": [{"id": 50, "dots": {name: [1, 1] for name in CORNERS}}]}, "the dictionary does not have"),
        ({"targets": [{"id": 5, "dots": {"A": [1, 1]}}]}, "must have the dots 0, 1, 2, 3"),
        ({"dictionery": "x", "dictionary": None}, "dictionary"),
    ],
)
def test_what_is_no_set_of_markers_is_refused(tmp_path: Path, change: dict[str, object], message: str) -> None:
    document = {
        "format": "spherecal/targets",
        "version": 1,
        "family": "aruco",
        "size_mm": 30,
        "dictionary": "DICT_5X5_50",
    }
    (tmp_path / "t.json").write_text(json.dumps(document | change))
    with pytest.raises(InputError, match=message):
        read_target_set(tmp_path / "t.json")


@pytest.mark.parametrize("polarity", ["dark-on-light", "light-on-dark"])
def test_a_printed_sheet_is_read_again(tmp_path: Path, polarity: str) -> None:
    targets = make_marker_set("DICT_APRILTAG_36h11", 30.0, range(5, 12), polarity)  # type: ignore[arg-type]
    write_sheet(tmp_path / "sheet.pdf", targets)
    page = pages(tmp_path / "sheet.pdf")[1]
    px_per_mm, height_mm = 8.0, 297.0
    image = np.full((int(height_mm * px_per_mm), int(210 * px_per_mm)), 255, np.uint8)
    grey = 0.0
    for found in re.finditer(rf"{NUMBER} g\b|{NUMBER} {NUMBER} {NUMBER} {NUMBER} re f", page):
        if found[1] is not None:
            grey = float(found[1])
            continue
        x, y, width, height = (float(found[i]) * MM_PER_POINT * px_per_mm for i in range(2, 6))
        top = height_mm * px_per_mm - y - height
        image[round(top) : round(top + height), round(x) : round(x + width)] = round(255 * grey)
    # a printer's edges are not those of pixels
    read = Detector(targets).detect(np.asarray(cv2.GaussianBlur(image, (0, 0), 1.2), np.uint8))
    assert read.target_ids.tolist() == list(range(5, 12))
    side = sticker_mm(targets)
    for target, place in zip(range(5, 12), sticker_places("A4", side), strict=False):
        expected = (targets.places(target, CORNERS) + np.array(place) + side / 2) * px_per_mm - 0.5
        np.testing.assert_allclose(read.uv[read.target == target], expected, atol=1.0)
