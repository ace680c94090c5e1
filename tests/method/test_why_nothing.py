"""Why nothing was found: each cause told from a rendered image, in the findings of a session and by `detect`."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from spherecal.base.context import Context
from spherecal.base.messages.catalogue import phrase
from spherecal.calibrate import calibrate
from spherecal.data.session import Placement, Session
from spherecal.detect.session_images import nothing_found, observed
from spherecal.geometry.camera import project
from spherecal.targets.family import make_target_set
from spherecal.targets.images import read_image
from spherecal.targets.target_set import TargetSet
from spherecal.targets.why_nothing import Cause, why_nothing
from spherecal_app.cli.main import main
from spherecal_files.read_session import read_session
from spherecal_files.table_file import write_observations
from spherecal_files.target_set_file import write_target_set
from spherecal_sim.dot_truth import Station, ball_dots
from spherecal_sim.render_session import CLUTTERED, RENDERED, render_image
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.simulated_scene import ball_scene, lit_for

Grey = NDArray[np.uint8]
TARGETS = make_target_set(200)


@pytest.fixture(scope="module")
def picture() -> Grey:
    """Half of rig A's ball in its cluttered room, 900 x 700 px."""
    session, truth = simulate_session("rigA", 0, RENDERED)
    assert session.target_set is not None
    camera = truth.cameras[7]
    scene = lit_for(ball_scene(truth, session.target_set, 0, CLUTTERED), truth, 7, CLUTTERED)
    dots = ball_dots(truth.ball, session.target_set.dot_diameter_mm / 2, session.target_set.size_mm / 2)
    dots = dots.moved(truth.ball_rotations[0], truth.ball_places_mm[0])
    middle = project((truth.ball_places_mm[0] @ camera.rotation.T + camera.translation_mm)[None], camera.intrinsics)[0]
    intrinsics = camera.intrinsics.copy()
    intrinsics[2:4] -= np.rint(middle) - np.array([350, 350])
    station = Station(camera.id, camera.rotation, camera.translation_mm, intrinsics, (900, 700))
    image = render_image(scene, dots, station, CLUTTERED, np.random.default_rng(0)).image
    assert image.dtype == np.uint8
    return image.astype(np.uint8)


def noisy(light: NDArray[Any]) -> Grey:
    """With the noise of a sensor of 10 ke- at 255 grey."""
    light = light.astype(float)
    noise = np.random.default_rng(1).normal(size=light.shape) * np.sqrt(0.05 + light * 255 / 1e4)
    return np.clip(np.rint(light + noise), 0, 255).astype(np.uint8)


def shrunk(image: Grey) -> Grey:
    return noisy(cv2.resize(image, None, fx=0.22, fy=0.22, interpolation=cv2.INTER_AREA))


Change = Callable[[Grey], tuple[Any, TargetSet]]
CAUSES: dict[str, tuple[Change, str]] = {
    "polarity": (lambda i: (i, replace(TARGETS, polarity="dark-on-light")), "light on dark"),
    "mirrored": (lambda i: (i[:, ::-1], TARGETS), "mirrored"),
    "other-targets": (lambda i: (i, make_target_set(100, start_id=240)), "not in the target set"),
    "small": (lambda i: (shrunk(i), TARGETS), "enlarged"),
    "dark": (lambda i: (noisy(i / 60.0), TARGETS), "dark"),
    "blurred": (lambda i: (noisy(cv2.GaussianBlur(i, (0, 0), 6.0)), TARGETS), "out of focus"),
    "no-targets": (lambda i: (noisy(_tools(i)), TARGETS), "nothing in it"),
}


def _tools(image: Grey) -> Grey:
    """A sharp picture of other things."""
    rng, out = np.random.default_rng(2), np.full(image.shape, 60, np.uint8)
    for _ in range(150):
        a, b = (rng.uniform(0, image.shape[::-1], 2).astype(int).tolist() for _ in range(2))
        cv2.line(out, a, b, int(rng.integers(10, 220)), int(rng.integers(2, 20)), cv2.LINE_AA)
    return out


@pytest.mark.parametrize("kind", CAUSES)
def test_the_cause_is_told(picture: Grey, kind: str) -> None:
    change, says = CAUSES[kind]
    cause: Cause = why_nothing(*change(picture))
    assert cause.kind == kind
    assert says in phrase(cause.seen)
    assert phrase(cause.remedy).endswith(".")


@pytest.mark.parametrize(("bits", "high"), [(10, False), (12, True), (16, False)])
def test_the_same_in_16_bit_files(picture: Grey, bits: int, high: bool) -> None:
    shift = bits - 8 + (16 - bits if high else 0)
    deep = (picture.astype(np.uint16) << shift).astype(np.uint16)
    assert why_nothing(deep, replace(TARGETS, polarity="dark-on-light")).kind == "polarity"
    dark = (noisy(picture / 60.0).astype(np.uint16) << shift).astype(np.uint16)
    assert why_nothing(dark, TARGETS).kind == "dark"


def test_detect_says_the_cause_and_ends_well(picture: Grey, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.pgm").write_bytes(b"P5\n900 700\n255\n" + picture.tobytes())
    write_target_set(tmp_path / "targets.json", replace(TARGETS, polarity="dark-on-light"))
    arguments = ["detect", tmp_path / "a.pgm", "--targets", tmp_path / "targets.json", "--csv", tmp_path / "out.csv"]
    assert main([str(argument) for argument in arguments]) == 0
    assert (tmp_path / "out.csv").read_text() == "image,target,point,u,v\n"
    assert '"polarity" to "light-on-dark"' in capsys.readouterr().err


# --- sessions ----------------------------------------------------------------------------------------------------


def of_images(folder: Path, images: dict[tuple[str, str], Grey], targets: TargetSet) -> Session:
    """The demo rig's cameras with the given images by placement and camera."""
    session, _ = simulate_session("demo", 0)
    size = next(iter(images.values())).shape[::-1]
    cameras = tuple(replace(camera, image_size=(size[0], size[1])) for camera in session.cameras)
    shots: dict[str, dict[str, Path]] = {}
    for (placement, camera), image in images.items():
        path = folder / f"{placement}-{camera}.png"
        cv2.imwrite(str(path), image)
        shots.setdefault(placement, {})[camera] = path
    placements = tuple(Placement(name, of) for name, of in shots.items())
    return replace(
        session,
        cameras=cameras,
        placements=placements,
        bar_poses=(),
        bars=(),
        scale=None,
        target_set=targets,
        observations=None,
    )


def test_a_session_in_which_nothing_was_found(picture: Grey, tmp_path: Path) -> None:
    shots = {("P1", camera): picture for camera in ("C1", "C2", "C3")}
    cameras = [camera.id for camera in simulate_session("demo", 0)[0].cameras][:3]
    shots = {("P1", camera): picture for camera in cameras}
    session = of_images(tmp_path, shots, replace(TARGETS, polarity="dark-on-light"))
    quality = calibrate(session).rig.quality
    first = quality.findings[0]
    assert not quality.valid
    assert (first.severity, first.code) == ("error", "no-targets")
    assert "any of the 3 images" in first.message and "light on dark" in first.message


def test_a_camera_and_a_placement_in_which_nothing_was_found(picture: Grey, tmp_path: Path) -> None:
    first, second, third = [camera.id for camera in simulate_session("demo", 0)[0].cameras][:3]
    blurred, dark = noisy(cv2.GaussianBlur(picture, (0, 0), 6.0)), noisy(picture / 60.0)
    shots = {(p, c): picture for p in ("P1", "P2") for c in (first, second)}
    shots |= {(p, third): blurred for p in ("P1", "P2")} | {("P3", c): dark for c in (first, second)}
    session = observed(of_images(tmp_path, shots, TARGETS), Context())
    of_camera, of_placement = nothing_found(session, from_images=True)
    assert (of_camera.code, of_camera.where) == ("no-targets-here", (third,))
    assert "out of focus" in of_camera.message
    assert of_placement.where == ("P3",) and "dark" in of_placement.message
    assert nothing_found(session, from_images=False) == ()


def test_an_empty_table(tmp_path: Path) -> None:
    session, truth = simulate_session("demo", 0)
    assert session.observations is not None
    write_session(session, truth, tmp_path / "s")
    empty = session.observations.select(np.zeros(len(session.observations), dtype=bool))
    write_observations(tmp_path / "s" / "observations.csv", empty)
    quality = calibrate(read_session(tmp_path / "s")).rig.quality
    assert quality.findings[0].code == "empty-table"
    assert not quality.valid


def test_a_table_of_other_cameras_is_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session, truth = simulate_session("demo", 0)
    assert session.observations is not None
    write_session(session, truth, tmp_path / "s")
    others = tuple(f"X{k}" for k in range(len(session.cameras)))
    write_observations(tmp_path / "s" / "observations.csv", replace(session.observations, cameras=others))
    assert main(["calibrate", str(tmp_path / "s"), "-o", str(tmp_path / "r")]) == 2
    said = capsys.readouterr().err
    assert "X" in said and "observations.csv" in said


# --- PGM and PPM -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
@pytest.mark.parametrize("kind", ["P2", "P5"])
def test_pgm_gives_the_camera_s_digits(tmp_path: Path, bits: int, kind: str) -> None:
    top = 2**bits - 1
    pixels = np.rint(np.linspace(0, top, 80 * 90)).reshape(80, 90).astype(np.uint8 if bits == 8 else np.uint16)
    stored = pixels.astype(">u2").tobytes() if bits > 8 else pixels.tobytes()
    body = stored if kind == "P5" else " ".join(map(str, pixels.ravel())).encode()
    path = tmp_path / "a.pgm"
    path.write_bytes(f"{kind}\n# of a camera\n90 80\n{top}\n".encode() + body)
    read = read_image(path)
    assert read.dtype == pixels.dtype
    np.testing.assert_array_equal(read, pixels)


@pytest.mark.parametrize("body", [b"", b"123", b"\xff" * 7199])
def test_a_pgm_cut_short_is_refused(tmp_path: Path, body: bytes) -> None:
    path = tmp_path / "a.pgm"
    path.write_bytes(b"P5\n90 80\n255\n" + body)
    with pytest.raises(Exception, match=r"a\.pgm is damaged"):
        read_image(path)
