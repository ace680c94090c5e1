"""`session new`: sessions of images and videos, with what EXIF tells, what is assumed and what is missing."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

import spherecal
from spherecal.base.context import Context
from spherecal.base.errors import Cancelled, InputError, OutputError
from spherecal_app.cli.main import main
from spherecal_app.recordings.video_frames import _frames as video_frames
from spherecal_app.recordings.video_frames import common_moments

SIZE = (160, 120)
BOARD = {"kind": "chessboard", "rows": 6, "columns": 9, "pitch_mm": 25.0}


def image(path: Path, size=SIZE, exif: dict[int, object] | None = None, seed: int = 0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 255, size[::-1], np.uint8)
    made = Image.fromarray(pixels)
    tags = made.getexif()
    for tag, value in (exif or {}).items():
        if tag in (0x010F, 0x0110):
            tags[tag] = value
        else:
            tags.get_ifd(0x8769)[tag] = value
    made.save(path, exif=tags)


@pytest.fixture
def images(tmp_path: Path) -> Path:
    for c in ("cam1", "cam2"):
        for p in ("0001", "0002"):
            image(tmp_path / "images" / c / f"{p}.png", seed=hash_of(c + p))
    return tmp_path / "images"


def hash_of(text: str) -> int:
    return sum(map(ord, text))


def test_images_are_copied_as_they_are(images: Path, tmp_path: Path) -> None:
    made = spherecal.new_session(tmp_path / "new", images, board=BOARD)
    session = made.session
    assert made.layout == "a folder for each camera" and made.pattern == "{camera}/{placement}.png"
    assert [c.id for c in session.cameras] == ["cam1", "cam2"] and [p.id for p in session.placements] == [
        "0001",
        "0002",
    ]
    for placement in session.placements:
        for camera, path in placement.images.items():
            assert path.read_bytes() == (images / camera / f"{placement.id}.png").read_bytes()
            assert path.is_relative_to(tmp_path / "new") and not path.is_symlink()
    assert session.board is not None and len(session.board) == 54
    assert session.cameras[0].prior[0] == pytest.approx(1.2 * 160) and session.cameras[0].prior[2] == 79.5
    assert made.assumed == ("a focal length of 1.2 times the longer side, as a start (cam1, cam2)",)
    assert made.missing == () and "2 cameras, 2 placements, 4 images" in repr(made)
    assert all("focal_length" in camera.assumed for camera in session.cameras)
    again = spherecal.new_session(tmp_path / "new", images, board=BOARD)  # what we wrote may be replaced
    assert again.session.input_sha256 == session.input_sha256


def test_images_in_the_folder_stay_where_they_are(images: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in images.rglob("*.png")}
    made = spherecal.new_session(images, images, board=BOARD)
    assert {path: path.stat().st_mtime_ns for path in images.rglob("*.png")} == before
    assert {p.name for p in images.iterdir()} == {"cam1", "cam2", "session.json"}
    assert len(made.session.placements[0].images) == 2
    with pytest.raises(OutputError, match=r"already has a session.json"):
        spherecal.new_session(images, images, board=BOARD)
    outer = spherecal.new_session(images.parent, images, board=BOARD).session
    assert outer.placements[1].images["cam2"] == images / "cam2" / "0002.png"


def test_links_that_lead_out_are_no_part_of_a_session(images: Path, tmp_path: Path) -> None:
    image(tmp_path / "outside.png")
    (images / "cam1" / "0003.png").symlink_to(tmp_path / "outside.png")
    with pytest.raises(InputError, match="is a link that leads out of it"):
        spherecal.new_session(images, images, board=BOARD)
    assert not (images / "session.json").exists()
    made = spherecal.new_session(tmp_path / "new", images, board=BOARD)  # a copy is a file like others
    assert not made.session.placements[2].images["cam1"].is_symlink()


def test_exif_gives_the_prior(tmp_path: Path) -> None:
    tags = {0x0110: "DSC-1", 0x920A: 16.0, 0xA20E: 200.0, 0xA210: 3, 0xA431: "A-17", 0xA002: 320}
    places = {"cam1": tags, "cam2": {0xA405: 28}, "cam3": {0x920A: 16.0}, "cam4": {}}
    for camera, own in places.items():
        for p in ("p1", "p2"):
            image(tmp_path / "images" / camera / f"{p}.jpg", exif=own)
    made = spherecal.new_session(tmp_path / "new", tmp_path / "images")
    one, two, three, four = made.cameras
    # 200 pixels a centimetre at 320 px of width: 50 um, 100 um at 160 px
    assert one.focal_px == pytest.approx(160.0) and (one.model, one.serial) == ("DSC-1", "A-17")
    assert made.session.cameras[0].pixel_pitch_um == pytest.approx(100.0)
    assert two.focal_px == pytest.approx(28 * 200 / np.hypot(36, 24)) and two.focal_from == "EXIF, 35 mm equivalent"
    assert three.focal_from == four.focal_from == "assumed"
    assert "the focal length of 16 mm says nothing without a pixel pitch (cam3)" in made.assumed
    assert len(made.missing) == 2 and made.missing[0].startswith("what the images show")
    given = spherecal.new_session(tmp_path / "new", tmp_path / "images", pixel_pitch_um=50.0, focal_length_mm=10.0)
    assert [camera.focal_px for camera in given.cameras] == [200.0] * 4 and not given.assumed


def test_a_zoomed_lens_is_refused(tmp_path: Path) -> None:
    for p, focal in (("p1", 24.0), ("p2", 70.0)):
        image(tmp_path / "images" / "cam1" / f"{p}.jpg", exif={0x920A: focal})
        image(tmp_path / "images" / "cam2" / f"{p}.jpg")
    with pytest.raises(InputError, match=r"p1.jpg was taken with a focal length of 24 mm, cam1/p2.jpg with 70 mm"):
        spherecal.new_session(tmp_path / "new", tmp_path / "images")
    assert not (tmp_path / "new").exists()


def test_what_cannot_be_used_leaves_nothing(images: Path, tmp_path: Path) -> None:
    image(images / "cam2" / "0002.png", (200, 120))
    with pytest.raises(InputError, match=r'"cam2": cam2/0002.png has 200 x 120 pixels, but .* has 160 x 120'):
        spherecal.new_session(tmp_path / "new", images, board=BOARD)
    (images / "cam2" / "0002.png").write_bytes(b"no image")
    with pytest.raises(InputError, match=r"0002.png is not an image"):
        spherecal.new_session(tmp_path / "new", images, board=BOARD)
    image(images / "cam2" / "0002.png")
    for board, said in (
        ("chessboard,rows=6", "lacks"),
        ("cheesboard,rows=6", "must be"),
        ("chessboard,row=6", "cannot be read"),
        ({**BOARD, "rows": 0}, "rows"),
        ("charuco,rows=30,columns=40,pitch_mm=9,marker_mm=7,dictionary=DICT_4X4_50", "need"),
    ):
        with pytest.raises(InputError, match=said):
            spherecal.new_session(tmp_path / "new", images, board=board)
    with pytest.raises(InputError, match="must be above 0"):
        spherecal.new_session(tmp_path / "new", images, focal_length_mm=-8)
    with pytest.raises(Cancelled):
        spherecal.new_session(tmp_path / "new", images, board=BOARD, context=Context(is_cancelled=lambda: True))
    assert not (tmp_path / "new").exists()
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / "precious.txt").touch()
    with pytest.raises(OutputError, match="contains something other"):
        spherecal.new_session(tmp_path / "new", images, board=BOARD)


def test_targets_and_the_ball_go_into_the_session(images: Path, tmp_path: Path) -> None:
    made = spherecal.new_session(
        tmp_path / "new", images, targets=spherecal.make_targets(12), sphere_diameter_mm=500.0, lens_model="fisheye"
    )
    session = made.session
    assert session.target_set is not None and len(session.target_set.layouts) == 12
    assert session.sphere_diameter_mm == 500.0 and session.cameras[0].lens_model == "fisheye"
    assert made.missing == () and any("state what they measure" in one for one in made.assumed)
    scale = made.session.scale
    assert scale is not None and (scale.kind, scale.surface) == ("target_spacing", "sphere")
    first, second = (session.target_set.layouts[1][str(dot)] for dot in (scale.from_point, scale.to_point))
    assert scale.distance_mm == pytest.approx(float(np.linalg.norm(first - second))) and scale.distance_mm > 20


def test_the_command_says_what_it_read(images: Path, tmp_path: Path, capsys) -> None:
    board = tmp_path / "board.json"
    board.write_text(json.dumps(BOARD))
    image(images / "notes.jpg")
    line = ["session", "new", tmp_path / "new", "--images", images, "--board", board]
    assert main([str(word) for word in line]) == 2  # a photo beside the folders: not told which is the camera
    assert "Give a pattern of the whole path" in capsys.readouterr().err
    line += ["--pattern", "{camera}/{placement}.png"]
    assert main([str(word) for word in line]) == 0
    said = capsys.readouterr().out
    for words in ("2 cameras, 2 placements (0001 ... 0002)", "160 x 120", "assumed", "Left out: 1 file (notes.jpg)."):
        assert words in said
    assert main([str(word) for word in [*line, "--json"]]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["cameras"][1] == {
        "id": "cam2", "images": 2, "image_size": [160, 120], "focal_px": 192.0, "focal_from": "assumed", "model": None,
        "serial": None,
    }  # fmt: skip
    assert summary["placements"] == ["0001", "0002"] and summary["left_out"] == ["notes.jpg"]


def test_a_session_says_that_its_focal_lengths_are_assumed(images: Path, tmp_path: Path) -> None:
    from spherecal.data.assumed import assumed_of_session

    session = spherecal.new_session(tmp_path / "new", images, board=BOARD).session
    messages = [finding.message for finding in assumed_of_session(session)]
    assert any(m == "The focal lengths of cam1, cam2 are only assumed." for m in messages)


# --- videos ----------------------------------------------------------------------------------------------------------


def video(path: Path, shift: int, frames: int = 60, stop: tuple[int, ...] = (10, 30, 50)) -> None:
    """A textured scene that moves but for 7 frames about each of `stop`; one frame of every stop is blurred."""
    path.parent.mkdir(parents=True, exist_ok=True)
    scene = cv2.GaussianBlur(np.random.default_rng(shift).integers(0, 255, (240, 900), np.uint8), (0, 0), 1.5)
    scene = cv2.normalize(scene, np.empty_like(scene), 0, 255, cv2.NORM_MINMAX)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, (320, 240), False)
    at = 0
    for frame in range(frames):
        still = any(abs(frame - s) <= 3 for s in stop)
        at += 0 if still else 11
        shown = scene[:, at : at + 320]
        writer.write(cv2.GaussianBlur(shown, (0, 0), 2.0) if frame - 1 in stop else shown)
    writer.release()


def test_still_and_sharp_frames_of_videos_are_taken(tmp_path: Path) -> None:
    for number in (1, 2):
        video(tmp_path / "videos" / f"cam{number}.avi", number)
    made = spherecal.new_session(tmp_path / "new", tmp_path / "videos", board=BOARD, frames=3)
    frames = [int(placement.id[1:]) for placement in made.session.placements]
    assert len(frames) == 3 and all(min(abs(f - s) for s in (10, 30, 50)) <= 3 for f in frames)
    assert not set(frames) & {11, 31, 51}, "blurred"
    assert made.session.cameras[0].image_size == (320, 240) and made.cameras[1].images == 3
    kept = cv2.imread(str(made.session.placements[0].images["cam1"]), cv2.IMREAD_UNCHANGED)
    assert kept.shape == (240, 320) and kept.std() > 20
    assert any("one moment" in line for line in made.assumed)


def write_times(path: Path, header: str, times: dict[str, np.ndarray]) -> None:
    """A table of frame times, its rows in no order."""
    rows = [
        {"sync_index": i, "frame_index": i, "cam_id": number, "port": number, "frame_time": float(time)}
        for number, own in times.items()
        for i, time in enumerate(own)
    ]
    np.random.default_rng(1).shuffle(rows)  # pyright: ignore[reportArgumentType]
    names = header.split(",")
    path.write_text("\n".join([header, *(",".join(str(row[name]) for name in names) for row in rows)]) + "\n")


@pytest.mark.parametrize(
    ("table", "header", "stem"),
    [
        ("timestamps.csv", "cam_id,frame_time", "cam"),
        ("frame_time_history.csv", "sync_index,port,frame_index,frame_time", "port"),
    ],
)
def test_frames_of_one_moment_by_caliscopes_times(tmp_path: Path, table: str, header: str, stem: str) -> None:
    """The second camera began 8 frames later and dropped one: frame i of both is never of one moment."""
    clock = 1000.0 + 0.04 * np.arange(60)
    late = np.delete(clock[8:] + 0.005, 30)
    video(tmp_path / "videos" / f"{stem}_0.avi", 1)
    video(tmp_path / "videos" / f"{stem}_3.avi", 2, len(late), (2, 22, 41))  # still at the same times
    write_times(tmp_path / "videos" / table, header, {"0": clock, "3": late})
    made = spherecal.new_session(tmp_path / "new", tmp_path / "videos", board=BOARD, frames=3)
    frames = [int(placement.id[1:]) for placement in made.session.placements]
    assert len(frames) == 3 and all(min(abs(f - s) for s in (10, 30, 50)) <= 3 for f in frames)
    assert f"by the times in {table}, at most 5 ms apart" in " ".join(made.assumed)
    other = list(video_frames(tmp_path / "videos" / f"{stem}_3.avi"))
    for frame, placement in zip(frames, made.session.placements, strict=True):
        kept = cv2.imread(str(placement.images[f"{stem}_3"]), cv2.IMREAD_UNCHANGED)
        expected = int(np.argmin(np.abs(late - clock[frame])))
        assert kept is not None and np.array_equal(kept, other[expected]) and expected != frame


def test_moments_that_a_camera_missed_are_left_out() -> None:
    fast, slow = 0.01 * np.arange(100), 0.003 + 0.033 * np.arange(30)
    found = common_moments([fast, np.delete(slow, [4, 5])])
    assert list(found[:, 1]) == [*range(28)] and (np.abs(fast[found[:, 0]] - np.delete(slow, [4, 5])) <= 0.006).all()
    gap = np.delete(fast, np.arange(40, 60))
    found = common_moments([gap, slow])
    assert len(found) == 24 and (np.abs(gap[found[:, 0]] - slow[found[:, 1]]) <= 0.006).all()
    assert not len(common_moments([fast, slow + 100.0]))


def test_times_that_do_not_fit_the_videos(tmp_path: Path) -> None:
    clock, videos = 0.04 * np.arange(30), tmp_path / "videos"
    for number in (0, 1):
        video(videos / f"cam_{number}.avi", number, 30)
    for times, message in (
        ({"0": clock, "1": clock[:-1]}, r"cam_1.avi has 30 frames, but the table beside it has 29 times"),
        ({"0": clock}, r"has no rows of cam_1.avi; it names the cameras 0"),
        ({"0": clock, "1": clock + 60}, r"cam_0.avi and cam_1.avi were not recorded at the same time"),
        ({"0": clock, "1": clock * np.nan}, r"line \d+ has no time"),
    ):
        write_times(videos / "timestamps.csv", "cam_id,frame_time", times)
        with pytest.raises(InputError, match=message):
            spherecal.new_session(tmp_path / "new", videos, board=BOARD)
    (videos / "timestamps.csv").write_text("when,what\n12:00,began\n")  # of another program
    made = spherecal.new_session(tmp_path / "new", videos, board=BOARD)
    assert any(line.startswith("frame i of every video") for line in made.assumed)


def test_frames_that_show_the_same_are_taken_once(tmp_path: Path) -> None:
    for number in (1, 2):
        video(tmp_path / "videos" / f"cam{number}.avi", number, 60, tuple(range(0, 60, 3)))
    made = spherecal.new_session(tmp_path / "new", tmp_path / "videos", board=BOARD, frames=10)
    assert len(made.session.placements) == 1


def test_videos_that_cannot_be_used(tmp_path: Path) -> None:
    video(tmp_path / "videos" / "cam1.avi", 1, 30)
    video(tmp_path / "videos" / "cam2.avi", 2, 31)
    with pytest.raises(InputError, match=r"cam1.avi 30, cam2.avi 31"):
        spherecal.new_session(tmp_path / "new", tmp_path / "videos", board=BOARD)
    (tmp_path / "videos" / "cam2.avi").write_text("#EXTM3U\n#EXTINF:1,\n/etc/hostname\n")
    with pytest.raises(InputError, match=r"cam2.avi: is not a video"):
        spherecal.new_session(tmp_path / "new", tmp_path / "videos", board=BOARD)
    (tmp_path / "videos" / "cam2.avi").write_bytes((tmp_path / "videos" / "cam1.avi").read_bytes()[:300])
    with pytest.raises(InputError, match=r"cam2.avi: (cannot be read as a video|has 0 frames)"):
        spherecal.new_session(tmp_path / "new", tmp_path / "videos", board=BOARD)
    assert not (tmp_path / "new").exists()
