"""Recordings as people name them: ten in at most one command each, and what is refused when the session is made."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

import spherecal
from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.diagnose.plausibility import implausible
from spherecal.targets.detection import detect
from spherecal_app.recordings.video_frames import grouped_by_time
from spherecal_sim.render_session import render_placement
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions

SIZE = (320, 240)


def picture(path: Path, seed: int = 0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.random.default_rng(seed).integers(0, 255, SIZE[::-1], np.uint8))


def files(*names: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        for name in names:
            picture(folder / name)

    return make


def poses(path: Path, frames: int, rate: float = 10.0, noise: float = 3.0, shift: int = 0) -> None:
    """A video in which every frame shows a board at another place."""
    path.parent.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(7)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate, (320, 240), False)
    for _ in range(frames):
        x, y = random.integers(10, (150, 120))
        shown = np.full((240, 320), 120.0)
        shown[y : y + 90, x + shift : x + shift + 126] = 220 * (np.indices((90, 126)).sum(axis=0) // 18 % 2)
        writer.write(np.clip(shown + random.normal(0, noise, shown.shape), 0, 255).astype(np.uint8))
    writer.release()


def videos(*rates: float, frames: int = 12) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        for i, rate in enumerate(rates):
            poses(folder / f"cam{i}.avi", frames, rate, shift=3 * i)

    return make


BASLER = "Basler_acA1920-40gm__{}__20231015_10451{}{}_{:04}.png"
# what people have -> cameras, placements, what is said of the layout or assumed
NAMED: dict[str, tuple[Callable[[Path], None], int, int, str]] = {
    "times in milliseconds, 37 ms apart": (
        files(*(f"cam{c}/170000000{i}{37 * c:03}.png" for c in (0, 1) for i in range(5))), 2, 5, "up to 37 ms apart",
    ),
    "times in nanoseconds": (
        files(*(f"cam{c}/140363657976355{i}{c * 2}27.png" for c in (0, 1) for i in range(5))), 2, 5,
        "up to 200 ns apart",
    ),
    "dates, and clocks that differ": (
        files(*(f"{c}/2023-10-15_10-{m}-0{i}.png" for c, m in (("left", 45), ("right", 51)) for i in range(4))), 2, 4,
        "by order",
    ),
    "Basler's viewer": (
        files(*(BASLER.format(c, 2, 300 + i, i) for c in (22334455, 22334466) for i in range(1, 5))), 2, 4, "",
    ),
    "Basler's viewer, each camera its own time": (
        files(*(BASLER.format(c, c % 10, 300 + i, i) for c in (22334455, 22334466) for i in range(1, 5))), 2, 4, "",
    ),
    "overlays beside the images": (
        files(*(f"cam{c}/000{i}{end}.png" for c in (0, 1) for i in range(1, 5) for end in ("", "_annot"))), 2, 4, "",
    ),
    "left01 right01": (files(*(f"{side}0{i}.png" for side in ("left", "right") for i in (1, 2, 3))), 2, 3, ""),
    "a folder a pose": (files(*(f"pose{i}/cam{c}.png" for i in range(3) for c in range(4))), 4, 3, ""),
    "videos in which every frame is another pose": (videos(10, 10, 10, 10), 4, 12, "frame i of every video"),
    "videos of two rates": (videos(10, 25, frames=40), 2, 16, "rates differ (cam0 10, cam1 25 frames a second)"),
}  # fmt: skip


@pytest.mark.parametrize("kind", NAMED)
def test_one_command_is_enough(kind: str, tmp_path: Path) -> None:
    make, cameras, placements, said = NAMED[kind]
    make(tmp_path / "in")
    made = spherecal.new_session(tmp_path / "s", tmp_path / "in")
    assert len(made.cameras) == cameras
    found = len(made.session.placements)
    assert found == placements if "rates" not in kind else 8 <= found <= placements
    assert said in " ".join((made.layout, *made.assumed))
    if "overlays" in kind:
        assert len(made.left_out) == 8 and all("_annot" in name for name in made.left_out)
    if "milliseconds" in kind:  # the second camera's third image belongs to the first's third
        third = made.session.placements[2]
        assert third.id == "1700000002000" and set(third.images) == {"cam0", "cam1"}


def test_a_dropped_frame_moves_nobody_elses() -> None:
    names = {"a": [f"170000000{i}000" for i in range(6)], "b": [f"170000000{i}020" for i in (0, 1, 3, 4, 5)]}
    grouped = grouped_by_time(names)
    assert grouped is not None
    moments, said = grouped
    assert len(moments) == 5 and "20 ms" in said
    assert all(abs(int(names["a"][a]) - int(names["b"][b])) == 20 for a, b in moments)


def test_names_that_are_no_times() -> None:
    assert grouped_by_time({"a": ["1", "2"], "b": ["3", "4"]}) is None
    assert grouped_by_time({"a": ["1700000000000"], "b": ["x"]}) is None
    assert grouped_by_time({"a": ["20231515104500"], "b": ["20231515104501"]}) is None  # no date


@pytest.mark.parametrize("fault", ["float", "cut", "serial"])
def test_what_cannot_be_calibrated_is_refused_at_once(fault: str, tmp_path: Path) -> None:
    for c in (0, 1):
        for i in range(3):
            picture(tmp_path / "in" / f"cam{c}" / f"{i}.png", 3 * c + i)
    if fault == "float":
        (tmp_path / "in" / "cam1" / "2.png").unlink()
        Image.fromarray(np.random.default_rng(1).normal(0, 1, SIZE[::-1]).astype(np.float32)).save(
            tmp_path / "in" / "cam1" / "2.tif"
        )
    elif fault == "cut":
        path = tmp_path / "in" / "cam1" / "2.png"
        path.write_bytes(path.read_bytes()[:900])
    else:
        for c in (0, 1):
            for i in range(3):
                (tmp_path / "in" / f"cam{c}" / f"{i}.png").unlink()
                exif = Image.Exif()
                exif[0x0110] = "Camera"
                exif.get_ifd(0x8769)[0xA431] = "4711"
                Image.new("L", SIZE, 30 * i).save(tmp_path / "in" / f"cam{c}" / f"{i}.jpg", exif=exif)
    with pytest.raises(InputError) as refused:
        spherecal.new_session(tmp_path / "s", tmp_path / "in")
    assert {"float": "2.tif", "cut": "2.png", "serial": "4711"}[fault] in str(refused.value)
    assert not (tmp_path / "s").exists()


def mirrored_images(folder: Path, session, truth, c: int, places: tuple[int, ...], others: bool = False):
    """The session with rendered images of camera c as a mirror shows them, and with what is found in them.

    `others`: its images at other placements have observations, as the other cameras have.
    """
    o, targets = session.observations, session.target_set
    assert o is not None and targets is not None
    placements = list(session.placements)
    kept = (o.camera != c) | (others & ~np.isin(o.placement, places))
    parts, uv = [(o.placement[kept], o.camera[kept], o.target[kept], o.point[kept])], [o.uv[kept]]
    for p in places:
        path = folder / f"{p}.png"
        cv2.imwrite(str(path), render_placement(session, truth, p, c).image[:, ::-1])
        placements[p] = replace(placements[p], images={session.cameras[c].id: path})
        found = detect(np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)), targets)
        parts.append((np.full(len(found), p), np.full(len(found), c), found.target, found.point))
        uv.append(found.uv)
    placement, camera, target, point = (np.concatenate(column) for column in zip(*parts, strict=True))
    mixed = replace(
        o, placement=placement, camera=camera, target=target, point=point, uv=np.concatenate(uv), sigma=None
    )
    return replace(session, placements=tuple(placements), observations=mixed)


def test_a_camera_of_mirrored_images_is_called_mirrored(tmp_path: Path) -> None:
    """Some of its targets still decode, as themselves or as others, and nothing links it.

    Two rendered images of it, as a mirror shows them, with what is found in them; the other cameras have observations.
    """
    session, truth = simulate_session("demo", 1, SimulationOptions(targets=100, placements=4, bar_poses=0))
    c = 1
    done = calibrate(mirrored_images(tmp_path, session, truth, c, (0, 1)))
    found = [f for f in done.rig.quality.findings if f.code == "mirrored"]
    assert [(f.kind, f.where) for f in found] == [("camera", (session.cameras[c].id,))]
    assert done.rig.quality.verdict == "not-valid"


def test_a_mirrored_image_is_named_and_left_out(tmp_path: Path) -> None:
    """Not among what contradicts the rest, as before, but by itself: a setting changed during the recording."""
    session, truth = simulate_session("demo", 1, SimulationOptions(targets=100, placements=4, bar_poses=0))
    spoilt = mirrored_images(tmp_path, session, truth, 1, (2,), others=True)
    name, place = session.cameras[1].id, session.placements[2].id
    assert [(f.code, f.kind, f.where) for f in implausible(spoilt)] == [("mirrored", "image", (name, place))]
    quality = calibrate(spoilt).rig.quality
    assert "mirrored" not in {f.code for f in quality.findings} and quality.valid
    assert [f.where for f in quality.findings if f.code == "left-out"]
