"""Bad files: one clear message that names file and place, never another exception, nothing half-written."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from spherecal.base.errors import InputError, OutputError, SpherecalError
from spherecal.targets.family import make_target_set
from spherecal_files.atomic import RESULT, check_folder, write_file_whole, write_folder_whole
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig, rig_bytes
from spherecal_files.target_set_file import read_target_set, write_target_set
from tests.example_session import OBSERVATIONS, VALID, changed, make_session, without
from tests.method.test_results import example_calibration


def complaint(action: Callable[[], object]) -> str:
    with pytest.raises(SpherecalError) as caught:
        action()
    message = str(caught.value)
    assert caught.value.exit_code == 2
    assert "\n" not in message
    return message


BAD_VALUES = [
    # place in the file, bad value, what the message must name
    (("version",), 2, ["later version", "version is 2"]),
    (("version",), "one", ["version"]),
    (("format",), "spherecal/rig", ["spherecal/rig", "spherecal/session"]),
    (("cameras",), [], ["cameras"]),
    (("cameras",), {}, ["cameras", "a list"]),
    (("cameras", 0, "id"), "C02", ["cameras[1]", "C02", "cameras[0]"]),
    (("cameras", 0, "id"), "", ["cameras[0].id", "empty"]),
    (("cameras", 0, "id"), "a,b", ["cameras[0].id", "letters, digits"]),
    (("cameras", 0, "id"), "../x", ["cameras[0].id", "dot"]),
    (("cameras", 0, "id"), "a\nb", ["cameras[0].id", "letters, digits"]),
    (("cameras", 0, "id"), "\ud800", ["cameras[0].id", "letters, digits"]),
    (("cameras", 0, "id"), 7, ["cameras[0].id", "a text"]),
    (("cameras", 0, "image_size"), [2064], ["cameras[0].image_size", "2 values"]),
    (("cameras", 0, "image_size"), [2064, 0], ["cameras[0].image_size[1]", "1"]),
    (("cameras", 0, "image_size"), [2064, 1544.5], ["cameras[0].image_size[1]", "whole"]),
    (("cameras", 0, "image_size"), [2448, 2048], ["cameras[1]", "intrinsics_group", "size"]),
    (("cameras", 0, "prior", "matrix", 0, 0), float("nan"), ["cameras[0].prior.matrix[0][0]", "finite"]),
    (("cameras", 0, "prior", "matrix", 0, 0), float("inf"), ["cameras[0].prior.matrix[0][0]", "finite"]),
    (("cameras", 0, "prior", "matrix", 0, 0), 10**400, ["cameras[0].prior.matrix[0][0]"]),
    (("cameras", 0, "prior", "matrix", 0, 0), True, ["cameras[0].prior.matrix[0][0]", "a number"]),
    (("cameras", 0, "prior", "matrix", 0, 0), -5, ["cameras[0].prior.matrix", "fu, fv above 0"]),
    (("cameras", 0, "prior", "matrix", 0, 1), 0.5, ["cameras[0].prior.matrix", "form"]),
    (("cameras", 0, "prior", "distortion"), [0] * 6, ["cameras[0].prior.distortion", "4, 5, 8 or 12"]),
    (("cameras", 1, "pixel_pitch_um"), 0, ["cameras[1].pixel_pitch_um", "above 0"]),
    (("cameras", 1, "focal_length_mm"), None, ["cameras[1]", "prior", "focal_length_mm"]),
    (("cameras", 1, "focal_lenght_mm"), 8, []),  # the right name is there: ignored
    (("target_set",), "/etc/passwd", ["target_set", "below the session's folder"]),
    (("target_set",), "../targets.json", ["target_set", "below the session's folder"]),
    (("target_set",), "a/../../targets.json", ["target_set", "below the session's folder"]),
    (("target_set",), "C:\\targets.json", ["target_set", "below the session's folder"]),
    (("target_set",), "other.json", ["target_set", "does not exist"]),
    (("target_set",), "a\x00b", ["target_set"]),
    (("placements", 1, "id"), "P1", ["placements[1]", "P1", "placements[0]"]),
    (("placements", 1, "id"), "A-01", ["bar_poses[0]", "A-01", "placements[1]"]),
    (("placements", 1, "images"), {"C09": "x.png"}, ["placements[1].images.C09", "camera"]),
    (("placements", 1, "images"), {"C01": "../x.png"}, ["placements[1].images.C01"]),
    (("scale", "kind"), "rod", ["scale.kind", "target_spacing"]),
    (("scale", "to"), "A", ["scale.to", "same point"]),
    (("scale", "to"), "Q", ["scale.to", "no target"]),
    (("scale", "distance_mm"), 0, ["scale.distance_mm", "above 0"]),
    (("scale", "surface"), "cube", ["scale.surface", "flat"]),
    (("scale",), {"kind": "bar", "bar": "X"}, ["scale.bar", '"X"']),
    (("scale",), {"kind": "bar", "bar": "A"}, ["scale.bar", "role"]),
    (("bars", 0, "role"), "both", ["bars[0].role", "check"]),
    (("bars", 0, "lengths", 0, "to"), "A9", ["bars[0].lengths[0].to", "A9"]),
    (("bars", 0, "lengths", 0, "to"), "A1", ["bars[0].lengths[0].to", "same mark"]),
    (("bars", 0, "lengths", 0, "expanded_uncertainty_mm"), 40, ["expanded_uncertainty_mm", "5 %"]),
    (("bars", 0, "lengths", 0, "coverage_factor"), 0, ["coverage_factor"]),
    (("bars", 0, "lengths", 0, "nominal_mm"), 421, ["bars[0].lengths[0].nominal_mm", "1 %", "412.345"]),
    (("bars", 0, "lengths", 0, "nominal_mm"), "412", ["bars[0].lengths[0].nominal_mm", "a number"]),
    (("bars", 0, "expansion_per_kelvin"), 11.5, ["expansion_per_kelvin"]),
    (("bar_poses", 0, "bar"), "B", ["bar_poses[0].bar", '"B"']),
    (("bar_poses", 0, "temperature_c"), "warm", ["bar_poses[0].temperature_c", "a number"]),
    (("board",), {"points": []}, ["board.points"]),
    (("board",), {"rows": 3}, ["board", "columns"]),
    (("board",), {"points": 2 * [{"target": 1, "point": "A", "xyz_mm": [0, 0, 0]}]}, ["board.points[1]", "same"]),
    (("sphere",), {"nominal_diameter_mm": -1}, ["sphere.nominal_diameter_mm", "above 0"]),
]


@pytest.mark.parametrize(("path", "value", "words"), BAD_VALUES)
def test_bad_value(tmp_path: Path, path: tuple[str | int, ...], value: object, words: list[str]) -> None:
    make_session(tmp_path, changed(*path, to=value))
    if not words:
        read_session(tmp_path)
        return
    message = complaint(lambda: read_session(tmp_path))
    for word in ("session.json", *words):
        assert word in message


def test_misspelt_field_is_pointed_out(tmp_path: Path) -> None:
    document = without("cameras", 0, "intrinsics_group")
    document["cameras"][0]["intrinsic_group"] = "all"
    message = complaint(lambda: read_session(make_session(tmp_path, document)))
    assert "cameras[0]" in message
    assert '"intrinsics_group" meant' in message


@pytest.mark.parametrize(
    "path",
    [("cameras",), ("cameras", 0, "id"), ("cameras", 0, "image_size"), ("scale", "surface"), ("bars", 0, "marks")],
)
def test_missing_field(tmp_path: Path, path: tuple[str | int, ...]) -> None:
    message = complaint(lambda: read_session(make_session(tmp_path, without(*path))))
    assert f'lacks "{path[-1]}"' in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["not valid JSON", "line 1"]),
        (json.dumps(VALID)[:-40], ["not valid JSON", "cut off"]),
        (json.dumps(VALID, indent=1).replace('"version": 1,', '"version": 1'), ["not valid JSON", "line 4"]),
        ("[" * 100_000, ["nested too deeply"]),
        ('{"format": "spherecal/session", "version": 1' + "1" * 5000 + "}", ["too many digits"]),
        ('{"format": "spherecal/session", "version": 1, "cameras": [{"id": "a", "id": "b"}]}', ["cameras[0]", "twice"]),
        ('{"format": "spherecal/session", "version": 1, "note": [1e999]}', ["note[0]", "finite"]),
        ("[1, 2]", ["is not a"]),
        ("null", ["is not a"]),
    ],
)
def test_bad_json(tmp_path: Path, text: str, words: list[str]) -> None:
    make_session(tmp_path)
    (tmp_path / "session.json").write_text(text)
    message = complaint(lambda: read_session(tmp_path))
    for word in ("session.json", *words):
        assert word in message


def test_what_never_was_json_is_not_cut_off(tmp_path: Path) -> None:
    make_session(tmp_path)
    (tmp_path / "session.json").write_text("import numpy\n")
    message = complaint(lambda: read_session(tmp_path))
    assert "not valid JSON" in message and "cut off" not in message


def test_no_utf8_names_the_line(tmp_path: Path) -> None:
    make_session(tmp_path)
    (tmp_path / "session.json").write_bytes(b'{\n"format": "\xff"}')
    assert "session.json: line 2" in complaint(lambda: read_session(tmp_path))


def test_missing_things(tmp_path: Path) -> None:
    assert "nowhere" in complaint(lambda: read_session(tmp_path / "nowhere"))
    assert "contains no session.json. spherecal session new makes" in complaint(lambda: read_session(tmp_path))
    (tmp_path / "session.json").mkdir()
    assert "session.json" in complaint(lambda: read_session(tmp_path))


def test_without_observations_images_are_needed(tmp_path: Path) -> None:
    make_session(tmp_path)
    (tmp_path / "observations.csv").unlink()
    assert "placements[0].id has no images" in complaint(lambda: read_session(tmp_path))
    document = changed("placements", to=[{"id": "P1", "images": {"C01": "P1.png"}}])
    document["bar_poses"] = []
    (tmp_path / "session.json").write_text(json.dumps(document))
    assert "placements[0].images.C01 names a file that does not exist" in complaint(lambda: read_session(tmp_path))
    (tmp_path / "P1.png").write_bytes(b"picture")
    assert read_session(tmp_path).placements[0].images["C01"].read_bytes() == b"picture"


def test_link_that_leaves_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "session"
    folder.mkdir()
    make_session(folder, changed("placements", 1, "images", "C01", to="sub/secret.png"))
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "secret.png").write_bytes(b"x")
    (folder / "sub").symlink_to(tmp_path / "outside")
    message = complaint(lambda: read_session(folder))
    assert "placements[1].images.C01 leaves the session's folder" in message


BAD_LINES = [
    # line of the table (0 is the header), its text, what the message must name
    (0, "placement,camera,target,point,v,u", ["line 1", "placement,camera,target,point,u,v"]),
    (0, "placement;camera;target;point;u;v", ["line 1", "commas between the columns and decimal points"]),
    (0, "u,v,placement,camera,target,point", ["line 1", "placement,camera,target,point,u,v"]),
    (0, "", ["line 1"]),
    (1, "P9,C01,1,A,100,200,0.04,0.04", ["line 2", "column placement", "P9"]),
    (2, "P1,C09,1,A,100,200,0.04,0.04", ["line 3", "column camera", "C09"]),
    (2, "P1,C02,one,A,100,200,0.04,0.04", ["line 3", "column target", "whole number"]),
    (2, "P1,C02,1.5,A,100,200,0.04,0.04", ["line 3", "column target", "whole number"]),
    (2, "P1,C02,99999999999999999999,A,100,200,0.04,0.04", ["line 3", "column target"]),
    (2, "P1,C02,1,,100,200,0.04,0.04", ["line 3", "column point", "empty"]),
    (2, "P1,C02,1,A,nan,200,0.04,0.04", ["line 3", "column u", "finite"]),
    (2, "P1,C02,1,A,100,-inf,0.04,0.04", ["line 3", "column v", "finite"]),
    (2, "P1,C02,1,A,1_0,200,0.04,0.04", ["line 3", "column u", "1_0"]),
    (2, "P1,C02,1,A,,200,0.04,0.04", ["line 3", "column u"]),
    (2, "P1,C02,1,A,100,2500,0.04,0.04", ["line 3", "column v", "outside the image of 2064 x 1544"]),
    (2, "P1,C02,1,A,100,2000,0.04,0.04", ["line 3", "column v", "with u and v exchanged"]),
    (2, "P1,C02,1,A,100,200,0,0.04", ["line 3", "column sigma_u", "below"]),
    (2, "P1,C02,1,A,100,200,0.04,-1", ["line 3", "column sigma_v", "below"]),
    (2, "P1,C02,1,A,100,200", ["line 3", "6 fields"]),
    (2, "", ["line 3", "empty"]),
    (2, "P1,C01,1,A,100,200,0.04,0.04", ["line 3", "line 2", "same dot"]),
    (2, "P1,C02,1,A,1\x000,200,0.04,0.04", ["line 3", "not UTF-8"]),
    (2, "P1,C02,1,A,1" + "0" * 500 + ",200,0.04,0.04", ["line 3", "bytes"]),
]


@pytest.mark.parametrize(("number", "text", "words"), BAD_LINES)
def test_bad_observation(tmp_path: Path, number: int, text: str, words: list[str]) -> None:
    lines = [*OBSERVATIONS[:number], text, *OBSERVATIONS[number + 1 :]]
    message = complaint(lambda: read_session(make_session(tmp_path, lines=lines)))
    for word in ("observations.csv", *words):
        assert word in message


def test_bad_targets(tmp_path: Path) -> None:
    path = tmp_path / "targets.json"
    write_target_set(path, make_target_set(2))
    good = json.loads(path.read_text())
    for change, words in (
        ({"polarity": "blue"}, ["polarity", "light-on-dark"]),
        ({"size_mm": 1.0}, ["dot_diameter_mm"]),
        ({"targets": []}, ["targets"]),
        ({"targets": 2 * good["targets"]}, ["targets[2] has the same id", "targets[0]"]),
        ({"targets": [{"id": 1, "dots": {"A": [50, 0]}}]}, ["targets[0].dots", "off the sticker"]),
        ({"targets": [{"id": 1, "dots": {}}]}, ["targets[0].dots"]),
    ):
        path.write_text(json.dumps({**good, **change}))
        message = complaint(lambda: read_target_set(path))
        for word in ("targets.json", *words):
            assert word in message


def test_bad_rig(tmp_path: Path) -> None:
    path = tmp_path / "rig.json"
    good = json.loads(rig_bytes(example_calibration().rig))
    camera = good["cameras"][0]
    for change, words in (
        ({"version": 3}, ["later version"]),
        ({"reference_camera": "C99"}, ["reference_camera", "C99"]),
        ({"cameras": [{**camera, "rotation": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}]}, ["cameras[0].rotation"]),
        ({"cameras": [{**camera, "rotation": [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]}]}, ["cameras[0].rotation"]),
        ({"cameras": [camera, camera]}, ["cameras[1]", camera["id"]]),
        ({"scale": {"source": "guess"}}, ["scale.source"]),
    ):
        path.write_text(json.dumps({**good, **change}))
        message = complaint(lambda: read_rig(path))
        for word in ("rig.json", *words):
            assert word in message


def nothing_new(parent: Path) -> list[str]:
    return sorted(path.name for path in parent.iterdir())


def build_result(folder: Path) -> None:
    (folder / "rig.json").write_text('{"format": "spherecal/rig"}')


def test_folder_with_something_else_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "thesis.tex").write_text("years of work")
    message = complaint(lambda: write_folder_whole(folder, build_result, RESULT))
    assert "out: contains something other" in message
    assert nothing_new(tmp_path) == ["out"]
    assert nothing_new(folder) == ["thesis.tex"]
    (folder / "rig.json").write_text('{"format": "somebody/else"}')
    complaint(lambda: check_folder(folder, RESULT))


def test_recording_is_never_replaced_by_a_result(tmp_path: Path) -> None:
    make_session(tmp_path)
    build_result(tmp_path)
    complaint(lambda: check_folder(tmp_path, RESULT))


def test_unwritable_places(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for place in (tmp_path / "file", tmp_path / "file" / "out", Path("/proc/out"), Path("/proc/1/x/out"), Path("/")):
        with pytest.raises(OutputError):
            write_folder_whole(place, build_result, RESULT)
        with pytest.raises(OutputError):
            check_folder(place, RESULT)
    assert nothing_new(tmp_path) == ["file"]
    for path in (tmp_path / "file" / "x.csv", Path("/proc/x.csv"), tmp_path, Path("/"), Path("a\x00b")):
        with pytest.raises(OutputError):
            write_file_whole(path, b"x")
    assert nothing_new(tmp_path) == ["file"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_full_disk(tmp_path: Path) -> None:
    assert "/dev/full" in complaint(lambda: write_file_whole(Path("/dev/full"), b"x"))

    def fill(folder: Path) -> None:
        build_result(folder)
        Path("/dev/full").write_bytes(b"x")

    with pytest.raises(OutputError, match="no space left"):
        write_folder_whole(tmp_path / "deep" / "out", fill, RESULT)
    assert nothing_new(tmp_path) == []


def test_failing_build_leaves_the_older_result(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    write_folder_whole(folder, build_result, RESULT)

    def fail(new: Path) -> None:
        (new / "half.csv").write_text("half")
        raise InputError("No.")

    with pytest.raises(InputError):
        write_folder_whole(folder, fail, RESULT)
    assert nothing_new(tmp_path) == ["out"]
    assert nothing_new(folder) == ["rig.json"]
