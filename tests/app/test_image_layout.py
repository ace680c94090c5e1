"""Which file is of which camera and placement: layouts that are recognised, and those that can be read in two ways."""

from pathlib import Path

import pytest

from spherecal.base.errors import InputError
from spherecal_app.recordings.image_layout import recognise


def folder(path: Path, names: list[str]) -> Path:
    for name in names:
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).touch()
    return path


def named(pattern: str, cameras: list[str], places: list[str]) -> list[str]:
    return [pattern.format(c=camera, p=place) for camera in cameras for place in places]


PLACES = ["0001", "0002", "0010"]
RECOGNISED = [
    ("{c}/{p}.png", ["cam1", "cam2", "cam10"], PLACES, "{camera}/{placement}.png"),
    ("{p}/{c}.png", ["cam1", "cam2", "cam10"], PLACES, "{placement}/{camera}.png"),
    ("placements/{p}/{c}.png", ["C01", "C02"], ["P1", "P2"], "placements/{placement}/{camera}.png"),
    ("{c}/IMG_{p}.JPG", ["left", "right"], PLACES, "{camera}/{placement}.JPG"),
    ("{c}/{c}{p}.jpg", ["left", "right"], PLACES, "{camera}/{camera}{placement}.jpg"),
    ("{c}/{c}_{p}.bmp", ["cam_a", "cam_b"], PLACES, "{camera}/{camera}_{placement}.bmp"),
    ("{p}/{c}_{p}.bmp", ["cam0", "cam1"], PLACES, "{placement}/{camera}_{placement}.bmp"),
    ("{c}_{p}.png", ["cam1", "cam2"], PLACES, "{camera}_{placement}.png"),
    ("{p}-{c}.tif", ["cam1", "cam2"], PLACES, "{placement}-{camera}.tif"),
    ("{c}{p}.png", ["left", "right"], ["01", "02"], "{camera}{placement}.png"),
    ("{c}_Frame_{p}.jpg", ["L", "R"], ["000", "003"], "{camera}_Frame_{placement}.jpg"),
    ("shot {p} view {c}.png", ["1", "2"], ["17", "18"], "shot {placement} {camera}.png"),
    ("{c}_{p}.png", ["cam1", "cam2"], ["2026-01-31_10-00-01", "2026-01-31_10-00-02"], "{camera}_{placement}.png"),
    ("{c}/{p}.png", ["50-0503343", "50-0503344"], ["pose1", "pose2"], "{camera}/{placement}.png"),
    ("{c}.png", ["cam1", "cam2", "cam3"], [""], "{camera}.png"),
    ("{c}/{p}.png", ["oben", "unten"], PLACES, "{camera}/{placement}.png"),
]


@pytest.mark.parametrize(
    ("names", "cameras", "places", "pattern"), RECOGNISED, ids=lambda v: v if isinstance(v, str) else ""
)
def test_layouts_are_recognised(tmp_path, names, cameras, places, pattern):
    layout = recognise(folder(tmp_path, named(names, cameras, places)))
    assert layout.pattern == pattern
    assert len(layout.files) == len(cameras) and len(layout.placements) == len(places)
    assert list(layout.files)[-1].endswith(cameras[-1].replace(" ", "_")) and not layout.left_out
    for camera, own in layout.files.items():
        assert len(own) == len(places), camera
        for path in own.values():
            assert (tmp_path / path).is_file()


def test_cameras_and_placements_are_in_natural_order(tmp_path):
    layout = recognise(folder(tmp_path, named("{c}/{p}.png", ["cam10", "cam2"], ["img10", "img9"])))
    assert list(layout.files) == ["cam2", "cam10"] and layout.placements == ("img9", "img10")


AMBIGUOUS = [
    named("{c}/{p}.png", ["1", "2"], ["0001", "0002"]),
    named("CalB-sys2-{p}_{c}.jpeg", ["0", "1"], PLACES),
    named("{c}/{p}.png", ["a", "b"], ["x", "y"]),
]


@pytest.mark.parametrize("names", AMBIGUOUS)
def test_what_can_be_read_in_two_ways_is_refused_with_both(tmp_path, names):
    with pytest.raises(InputError, match="do not say which part is the camera") as refused:
        recognise(folder(tmp_path, names))
    assert names[0] in refused.value.message
    patterns = [part.split('"')[0] for part in refused.value.hint.split('--pattern "')[1:]]
    assert len(patterns) == 2
    read = [recognise(tmp_path, pattern) for pattern in patterns]
    assert {len(read[0].files), len(read[0].placements)} == {len(read[1].files), len(read[1].placements)}
    assert list(read[0].files) != list(read[1].files)


@pytest.mark.parametrize(
    "names",
    [["cam1/0001.png", "cam2/deeper/0001.png"], ["a.png", "b1.png"], ["x/cam1/1.png", "y/cam1/1.png", "x/cam2/1.png"]],
)
def test_what_has_no_order_is_refused(tmp_path, names):
    with pytest.raises(InputError, match="do not say which part is the camera"):
        recognise(folder(tmp_path, names))


def test_images_of_no_common_moment_are_refused(tmp_path):
    names = ["cam0/1385030208726607500.png", "cam0/1385030208826607500.png", "cam1/1385030208726607501.png"]
    with pytest.raises(InputError, match="no placement has images of two cameras"):
        recognise(folder(tmp_path, names))


def test_two_files_of_one_place_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"0001.jpg and cam1/0001.png would both be"):
        recognise(folder(tmp_path, ["cam1/0001.png", "cam1/0001.jpg", "cam2/0001.png"]))
    (tmp_path / "cam1" / "0001.jpg").unlink()
    folder(tmp_path, ["cam 2/0001.png", "cam_2/0001.png"])
    with pytest.raises(InputError, match="would get the same id"):
        recognise(tmp_path)


def test_patterns_say_what_names_do_not(tmp_path):
    folder(tmp_path, [*named("CalB-sys2-{p}_{c}.jpeg", ["0", "1"], PLACES), "notes/photo.jpg"])
    layout = recognise(tmp_path, "CalB-sys2-{placement}_{camera}.jpeg")
    assert list(layout.files) == ["0", "1"] and layout.left_out == ("notes/photo.jpg",)
    layout = recognise(tmp_path, "**/*-{placement}_{camera}.*")
    assert list(layout.files) == ["0", "1"]
    for pattern, said in (
        ("{placement}.png", "which part names the camera"),
        ("{camera}/{kamera}", "cannot be read"),
        ("{camera}.png", "none of 7 files matches"),
        ("*" * 9 + "{camera}", "cannot be read"),
    ):
        with pytest.raises(InputError, match=said):
            recognise(tmp_path, pattern)


def test_empty_and_missing_folders(tmp_path):
    with pytest.raises(InputError, match="neither images nor videos"):
        recognise(folder(tmp_path, ["readme.txt", ".hidden/cam1.png"]))
    with pytest.raises(InputError, match="no such folder"):
        recognise(tmp_path / "nothing")


# --- other programs' folders, as their manuals show them -------------------------------------------------------------


def test_kalibr(tmp_path):
    stamps = ["1385030208726607500", "1385030212176607500"]
    layout = recognise(folder(tmp_path, [*named("{c}/{p}.png", ["cam0", "cam1"], stamps), "imu0.csv"]))
    assert layout.words.startswith("Kalibr") and list(layout.files) == ["cam0", "cam1"]
    assert layout.placements == tuple(stamps)


def test_multical(tmp_path):
    cameras = ["cam1", "cam2", "cam3"]
    names = named("{c}/{p}", cameras, ["intrinsic/image01.jpg", "extrinsic/image01.jpg", "extrinsic/image02.jpg"])
    layout = recognise(folder(tmp_path, names))
    assert layout.words.startswith("multical") and list(layout.files) == cameras
    assert layout.placements == ("image01", "image02") and len(layout.left_out) == 3
    assert layout.pattern == "{camera}/extrinsic/{placement}.jpg"


def test_caliscope(tmp_path):
    names = named("calibration/{p}/cam_{c}.mp4", ["0", "1", "3"], ["intrinsic", "extrinsic"])
    layout = recognise(folder(tmp_path, [*names, *named("recordings/walk/cam_{c}.mp4", ["0", "1"], [""])]))
    assert layout.words.startswith("caliscope") and layout.videos
    assert list(layout.files) == ["cam_0", "cam_1", "cam_3"] and len(layout.left_out) == 5


def test_a_recording_of_caliscope(tmp_path):
    names = [*named("port_{c}.mp4", ["0", "1", "10"], [""]), *named("HOLISTIC/port_{c}_HOLISTIC.mp4", ["0", "1"], [""])]
    layout = recognise(folder(tmp_path, names))
    assert layout.words == "videos as caliscope names them" and len(layout.left_out) == 2
    assert list(layout.files) == ["port_0", "port_1", "port_10"]


def test_a_set_of_matlabs_stereo_calibrator(tmp_path):
    layout = recognise(folder(tmp_path, named("{c}/{c}{p}.png", ["left", "right"], ["01", "02", "03"])))
    assert list(layout.files) == ["left", "right"] and layout.placements == ("01", "02", "03")


def test_anipose(tmp_path):
    names = [
        *named("calibration/vid_v1_cam{c}.avi", ["1", "2"], [""]),
        *named("videos-raw/vid_a_cam{c}.avi", ["1"], [""]),
    ]
    layout = recognise(folder(tmp_path, names))
    assert layout.words.startswith("Anipose") and layout.videos and list(layout.files) == ["cam1", "cam2"]


def test_anipose_says_by_cam_regex_which_camera_it_is(tmp_path):
    names = ["calibration/calib-day1-camA-run1.avi", "calibration/calib-day1-camB-run2.avi"]
    root = folder(tmp_path / "project" / "session", [*names, "videos-raw/walk-camA.avi"]).parent
    (root / "config.toml").write_text("[triangulation]\ncam_regex = 'cam([A-Z])'\n")
    layout = recognise(root / "session")
    assert layout.files == {"A": {"P1": names[0]}, "B": {"P1": names[1]}} and layout.videos
    assert layout.left_out == ("videos-raw/walk-camA.avi",)
    (root / "config.toml").write_text("[triangulation]\ncam_regex = 'cam([1-9])'\n")
    with pytest.raises(InputError) as refused:
        recognise(root / "session")
    assert refused.value.code == "error-pattern-fits-none"


@pytest.mark.parametrize("regex", ["cam[A-Z]", "(a+)+b", "(", "([a-z]*){9}"])
def test_a_cam_regex_that_cannot_be_used_is_refused(tmp_path, regex):
    own = folder(tmp_path / "session", ["calibration/x-camA.avi", "calibration/x-camB.avi", "videos-raw/y-camA.avi"])
    (own / "config.toml").write_text(f"[triangulation]\ncam_regex = '{regex}'\n")
    with pytest.raises(InputError) as refused:
        recognise(own)
    assert refused.value.code == "error-cam-regex"
    assert recognise(own, "calibration/x-cam{camera}.avi").files.keys() == {"A", "B"}


def test_images_beside_videos_are_asked_about(tmp_path):
    with pytest.raises(InputError, match=r"2 images .* and 2 videos"):
        recognise(folder(tmp_path, ["cam1.png", "cam2.png", "cam1.mp4", "cam2.mp4"]))
    assert recognise(tmp_path, "{camera}.mp4").videos
    with pytest.raises(InputError, match="which part is the camera"):  # two videos of each camera
        recognise(folder(tmp_path / "more", named("cam{c}_{p}.mp4", ["1", "2"], ["a", "b"])))
