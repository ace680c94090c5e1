"""The short example programs, each run as its user would run it, on data made by the simulator."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import ROOT

import spherecal

SHORT = (
    "after_a_bump", "arrays_to_rig", "board_on_the_wall", "load_and_triangulate", "rig_from_opencv", "through_opencv",
    "verify_kalibr_rig",
)  # fmt: skip


def run(name: str, *arguments: object) -> str:
    """What the program prints, in a process of its own."""
    path = os.pathsep.join([str(ROOT / "core"), os.environ.get("PYTHONPATH", "")])
    line = [sys.executable, ROOT / "examples" / f"{name}.py", *arguments]
    done = subprocess.run(
        [str(word) for word in line],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("examples")


@pytest.fixture(scope="module")
def session(folder: Path) -> spherecal.Session:
    return spherecal.simulate_session("demo", 1, folder=folder / "session")[0]


@pytest.fixture(scope="module")
def calibration(session: spherecal.Session, folder: Path) -> spherecal.Calibration:
    calibration = spherecal.calibrate_session(session)
    spherecal.save_calibration(calibration, folder / "result")
    return calibration


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_without_arguments_an_example_says_how_it_is_used(path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "core")}
    done = subprocess.run([sys.executable, path], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stdout == ""
    assert f"python {path.name} " in done.stderr and "Traceback" not in done.stderr


def test_arrays_become_a_rig(calibration, session, tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    middle = np.mean([sphere.centre_mm for sphere in calibration.spheres], axis=0)
    points = middle + random.uniform(-200, 200, (3, 60, 3))
    seen = {}
    for camera in calibration.rig:
        uv = camera.project(points) + random.normal(0, 0.05, (3, 60, 2))
        outside = ((uv < 0) | (uv > np.array(camera.image_size) - 1)).any(axis=-1)
        seen[camera.id] = np.where(outside[..., None], np.nan, uv)
    size = session.cameras[0].image_size
    f = calibration.rig["C01"].K[0, 0]
    K = np.array([[1.02 * f, 0, size[0] / 2], [0, f, size[1] / 2], [0, 0, 1]])
    np.savez(tmp_path / "points.npz", K=K, image_size=size, **seen)
    said = run("arrays_to_rig", tmp_path / "points.npz", tmp_path / "result")
    assert said.startswith("<Rig: 6 cameras (C01, C02, C03, C04, C05, C06)") and "arbitrary units: no scale" in said
    made = spherecal.load_rig(tmp_path / "result")
    ours, theirs = ([rig[c.id].centre_mm - rig["C01"].centre_mm for c in made] for rig in (made, calibration.rig))
    ratio = np.linalg.norm(ours[1:], axis=1) / np.linalg.norm(theirs[1:], axis=1)
    assert np.ptp(ratio) / np.mean(ratio) < 0.01


def test_points_are_triangulated(calibration, folder: Path, tmp_path: Path) -> None:
    place = calibration.spheres[0].centre_mm
    seen: dict[str, Any] = {**spherecal.project_points(calibration.rig, place[None])}
    np.savez(tmp_path / "seen.npz", **seen)
    x, y, z = place
    said = run("load_and_triangulate", folder / "result", tmp_path / "seen.npz")
    assert said.startswith(f"{x:.4f} {y:.4f} {z:.4f} mm, standard uncertainty 0.") and said.endswith(", 6 cameras\n")


def test_opencv_does_the_same(calibration, folder: Path, tmp_path: Path) -> None:
    camera = calibration.rig["C02"]
    image = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 255, camera.image_size[::-1], np.uint8), (0, 0), 3)
    cv2.imwrite(str(tmp_path / "image.png"), image)
    said = run("through_opencv", folder / "result", "C02", tmp_path / "image.png", tmp_path / "out.png")
    assert float(said.split("agree to ")[1].split(" px")[0]) < 1e-6
    theirs = cv2.undistort(image, camera.K, camera.dist)
    ours = cv2.imread(str(tmp_path / "out.png"), cv2.IMREAD_GRAYSCALE)
    assert np.abs(ours.astype(int) - theirs)[5:-5, 5:-5].max() <= 2


def test_a_stereo_calibration_becomes_a_rig(tmp_path: Path) -> None:
    K = np.array([[1210.0, 0, 640], [0, 1190, 480], [0, 0, 1]])
    R = cv2.Rodrigues(np.array([0.01, -0.3, 0.02]))[0]
    file = cv2.FileStorage(str(tmp_path / "stereo.yml"), cv2.FILE_STORAGE_WRITE)
    for name, value in (
        ("K1", K),
        ("D1", np.full((1, 5), 0.01)),
        ("K2", K),
        ("D2", np.zeros((1, 5))),
        ("R", R),
        ("T", np.array([[-450.0], [3], [60]])),
    ):
        file.write(name, value)
    file.release()
    run("rig_from_opencv", tmp_path / "stereo.yml", 1280, 960, tmp_path / "rig.json")
    rig = spherecal.load_rig(tmp_path / "rig.json")
    assert np.allclose(rig["right"].rotation, R, atol=1e-12) and np.array_equal(rig["right"].tvec, [-450, 3, 60])
    assert rig["left"].image_size == (1280, 960) and np.array_equal(rig["left"].dist[:5], [0.01] * 5)


def test_a_rig_of_kalibr_is_verified(calibration, folder: Path, tmp_path: Path) -> None:
    spherecal.export_rig(calibration.rig, "kalibr", tmp_path / "camchain.yaml", max_loss_px=1.0)
    lines = run("verify_kalibr_rig", tmp_path / "camchain.yaml", folder / "session").splitlines()
    known = spherecal.verify_rig(folder / "session", calibration.rig)
    assert len(lines) == len(known.lengths) + 1 and lines[-1] in ("consistent", "inconsistent")
    for line, length in zip(lines[:-1], known.lengths, strict=True):
        assert length.mean_error_mm is not None
        assert abs(float(line.split(": ")[1].split(" mm")[0]) - length.mean_error_mm) < 0.3, "four coefficients, no k3"


def test_a_bump_is_found_and_mended(calibration, folder: Path, tmp_path: Path) -> None:
    camera = calibration.rig["C02"]
    bumped = replace(camera, translation_mm=camera.translation_mm + np.array([3.0, 0, 0]))
    rig = replace(calibration.rig, cameras=tuple(bumped if c.id == "C02" else c for c in calibration.rig))
    spherecal.save_calibration(replace(calibration, rig=rig), tmp_path / "bumped")
    first, second = run("after_a_bump", folder / "session", tmp_path / "bumped", tmp_path / "new").splitlines()
    assert first.startswith("Camera C02 moved by about ") and second.startswith("The rig is as it was calibrated")


def test_a_rig_with_exchanged_cameras_is_told_without_a_crash(calibration, folder: Path, tmp_path: Path) -> None:
    """Every camera under another's name: nothing fits, and the verdict says so."""
    spherecal.export_rig(calibration.rig, "kalibr", tmp_path / "camchain.yaml", max_loss_px=1.0)
    ids = [camera.id for camera in calibration.rig]
    for turn in range(6):
        rig = spherecal.import_rig(tmp_path / "camchain.yaml", "kalibr", ids=ids[turn:] + ids[:turn])
        assert spherecal.verify_rig(folder / "session", rig).decision.verdict != "consistent"


@pytest.mark.parametrize("name", [name for name, form in spherecal.FORMATS.items() if not form.fields])
def test_rigs_of_all_formats_are_imported(calibration, name: str, tmp_path: Path) -> None:
    rig = calibration.rig
    done = spherecal.export_rig(rig, name, tmp_path / "out", max_loss_px=1.0)
    ids = list(done.ids)
    read = spherecal.import_rig(tmp_path / "out", name, done.unit)
    assert sorted(camera.id for camera in read) == sorted(ids)
    assert read.quality.verdict == "use-with-care" and read.scale.source == "given"
    points = np.array([sphere.centre_mm for sphere in calibration.spheres])
    largest = done.largest_difference_px + max([loss.max_px for loss in done.losses.values()], default=0.0)
    first = read[ids[0]].rotation.T @ rig.cameras[0].rotation  # worlds may be the frame of the file's first camera
    moved = points @ rig.cameras[0].rotation.T + rig.cameras[0].translation_mm
    moved = (moved - read[ids[0]].translation_mm) @ read[ids[0]].rotation
    assert np.allclose(first @ first.T, np.eye(3), atol=1e-9)
    for camera, own in zip(rig, ids, strict=True):
        assert np.abs(read[own].project(moved) - camera.project(points)).max() < largest + 0.5
    renamed = spherecal.import_rig(tmp_path / "out", name, done.unit, ids=[f"R{i}" for i in range(6)])
    assert [camera.id for camera in renamed] == [f"R{i}" for i in range(6)]
    with pytest.raises(spherecal.InputError, match="6 cameras, but 1 id is given"):
        spherecal.import_rig(tmp_path / "out", name, done.unit, ids=["R1"])
