"""Result files: what is written is read back, the same result gives the same bytes, folders are written whole."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spherecal.base.errors import OutputError
from spherecal.data.observations import Observations, find_features
from spherecal.data.rig import Calibration, CameraSigma, PlacedSphere, Quality, Rig, RigCamera, RigScale
from spherecal.geometry.rotation import exp_rotation
from spherecal.result.build_result import quality_of
from spherecal.targets.family import make_target_set
from spherecal_files import atomic
from spherecal_files import filesystem as files
from spherecal_files.atomic import RESULT, check_folder, write_file_whole, write_folder_whole
from spherecal_files.findings_file import as_written
from spherecal_files.rig_file import read_rig, rig_bytes
from spherecal_files.table_file import read_observations, write_observations
from spherecal_files.target_set_file import read_target_set, write_target_set
from spherecal_files.write_result import write_result


def example_observations(n: int = 24, sigma: bool = False) -> Observations:
    rng = np.random.default_rng(3)
    index = np.arange(n)
    return Observations(
        ("P1", "P2"),
        ("C01", "C02", "C03"),
        ("A", "E"),
        placement=index // 12 % 2,
        camera=index % 3,
        target=5 + index // 6 % 2,
        point=index // 3 % 2,
        uv=rng.uniform(0, 1500, (n, 2)),
        sigma=rng.uniform(0.02, 0.1, (n, 2)) if sigma else None,
    )


def example_calibration() -> Calibration:
    rng = np.random.default_rng(7)
    cameras = []
    for i in range(3):
        intrinsics = np.r_[2318.123456789, 2317.9, 1031.5, 771.5, rng.normal(0, 0.01, 12)]
        sigma = CameraSigma(rng.uniform(0, 1e-3, 3), rng.uniform(0, 0.1, 3), rng.uniform(0, 1, 16))
        rotation = exp_rotation(rng.normal(0, 1, 3)) if i else np.eye(3)
        place = rng.normal(0, 1000, 3) * (i > 0)
        serial = None if i == 1 else f"serial {i} “ß”"
        cameras.append(RigCamera(f"C0{i + 1}", serial, (2064, 1544), intrinsics, rotation, place, 0.05, 8, sigma))
    cameras[2] = replace(cameras[2], sigma=None, rms_px=None)
    findings = (as_written("warning", "outliers-removed", "3 outliers\nwere removed.", "Look.", ("C01", "P1")),)
    quality = Quality(True, 0.051, 0.04, 0.039, findings)
    rig = Rig("C01", tuple(cameras), RigScale("target_spacing", 2.5e-4), quality, "ab" * 32)
    observations = example_observations()
    features = find_features(observations)
    points = rng.normal(0, 300, (len(features), 3))
    points[3] = np.nan
    sigma_mm = np.full(points.shape, 0.01)
    sigma_mm[0] = np.nan
    residuals = rng.normal(0, 0.04, (24, 2))
    residuals[5] = np.nan
    used = np.ones(24, dtype=bool)
    used[5] = False
    spheres = (PlacedSphere("P1", np.array([1.0, 2.0, 900.0]), 250.1, 0.7),)
    views = np.full(len(features), 3)
    return Calibration(
        rig, observations, features, points, sigma_mm, views, residuals, used, spheres, "free", {"all": 0.1}
    )


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def assert_same_rig(a: Rig, b: Rig) -> None:
    assert (a.reference_camera, a.scale, a.quality, a.input_sha256) == (
        b.reference_camera,
        b.scale,
        b.quality,
        b.input_sha256,
    )
    for one, other in zip(a.cameras, b.cameras, strict=True):
        for name, value in vars(one).items():
            again = getattr(other, name)
            if isinstance(value, CameraSigma):
                for part in vars(value):
                    np.testing.assert_array_equal(getattr(value, part), getattr(again, part))
            else:
                np.testing.assert_array_equal(value, again)


def test_rig_returns_exactly(tmp_path: Path) -> None:
    rig = example_calibration().rig
    write_file_whole(tmp_path / "rig.json", rig_bytes(rig))
    assert_same_rig(rig, read_rig(tmp_path / "rig.json"))


def test_unknown_numbers_are_null_and_return(tmp_path: Path) -> None:
    rig = example_calibration().rig
    sigma = CameraSigma(np.full(3, np.nan), np.zeros(3), np.full(16, np.nan))
    quality = Quality(False, None, None, None, ())
    rig = replace(rig, cameras=(replace(rig.cameras[0], sigma=sigma),), quality=quality, scale=RigScale("none", None))
    data = rig_bytes(rig)
    assert b"NaN" not in data
    (tmp_path / "rig.json").write_bytes(data)
    assert_same_rig(rig, read_rig(tmp_path / "rig.json"))


def test_rig_that_could_not_be_placed(tmp_path: Path) -> None:
    rig = Rig(None, (), RigScale("none", None), Quality(False, None, None, None, ()), "")
    (tmp_path / "rig.json").write_bytes(rig_bytes(rig))
    assert_same_rig(rig, read_rig(tmp_path / "rig.json"))


def test_rig_file_has_the_fields_of_the_interface(tmp_path: Path) -> None:
    document = json.loads(rig_bytes(example_calibration().rig, {"created": "2026-01-01"}))
    assert list(document) == [
        "format", "version", "reference_camera", "cameras", "scale", "quality", "software", "input_sha256",
    ]  # fmt: skip
    camera = document["cameras"][0]
    assert list(camera) == [
        "id", "serial", "image_size", "matrix", "distortion", "rotation", "translation_mm", "rms_px", "observations",
        "sigma",
    ]  # fmt: skip
    assert camera["distortion"]["model"] == "opencv"
    assert len(camera["distortion"]["coefficients"]) == 12
    assert [len(camera["sigma"][key]) for key in ("rotation_deg", "centre_mm", "matrix", "distortion")] == [3, 3, 4, 12]
    assert list(document["quality"]) == ["valid", "verdict", "affected", "rms_px", "mean_px", "sigma0", "findings"]
    assert document["software"]["created"] == "2026-01-01"


def test_result_folder(tmp_path: Path) -> None:
    calibration = example_calibration()
    write_result(calibration, tmp_path / "out")
    assert sorted(path.name for path in tmp_path.glob("out/*")) == [
        "observations.csv",
        "points.csv",
        "residuals.csv",
        "rig.json",
        "spheres.csv",
    ]
    points = table(tmp_path / "out" / "points.csv")
    assert len(points) == len(calibration.features) - 1  # the point without a place is left out
    assert points[0]["sigma_x_mm"] == ""
    found = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in points])
    np.testing.assert_allclose(found, np.delete(calibration.points_mm, 3, axis=0), rtol=1e-11)
    residuals = table(tmp_path / "out" / "residuals.csv")
    assert [row["used"] for row in residuals].count("0") == 1
    assert (residuals[5]["du"], residuals[5]["dv"], residuals[5]["used"]) == ("", "", "0")
    assert residuals[4]["camera"] == "C02"
    assert float(residuals[4]["dv"]) == pytest.approx(calibration.residuals_px[4, 1], rel=1e-6)
    assert table(tmp_path / "out" / "spheres.csv") == [
        {"placement": "P1", "x_mm": "1", "y_mm": "2", "z_mm": "900", "radius_mm": "250.1", "radial_sd_mm": "0.7"}
    ]


def test_same_result_same_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_result(example_calibration(), tmp_path / name)
    for file in (tmp_path / "one").iterdir():
        assert file.read_bytes() == (tmp_path / "two" / file.name).read_bytes()


def test_older_result_is_replaced_whole(tmp_path: Path) -> None:
    write_result(example_calibration(), tmp_path / "out")
    (tmp_path / "out" / "bars.csv").write_text("of the older calibration")
    write_result(example_calibration(), tmp_path / "out")
    assert not (tmp_path / "out" / "bars.csv").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_new_empty_and_linked_folders(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "empty")
    for place in ("empty", "link", "a/b/c"):
        write_result(example_calibration(), tmp_path / place)
        assert (tmp_path / place / "rig.json").is_file()
    assert (tmp_path / "link").is_symlink()


@pytest.mark.parametrize("survivor", ["older", "newer"])
def test_crash_while_replacing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, survivor: str) -> None:
    """The program dies before or after the new folder is in place; the next run finds one of the two, whole."""
    folder = tmp_path / "out"

    def build(text: str):
        return lambda new: (new / "rig.json").write_text(json.dumps({"format": "spherecal/rig", "is": text}))

    class Crash(BaseException):
        pass

    def crash(*_: object) -> None:
        raise Crash

    monkeypatch.setattr(atomic, "_exchange", lambda *_: False)  # as where folders cannot be exchanged in one step
    write_folder_whole(folder, build("older"), RESULT)
    if survivor == "older":
        real = files.move_below
        monkeypatch.setattr(
            files, "move_below", lambda root, name, to: crash() if to == folder.name else real(root, name, to)
        )
        monkeypatch.setattr(atomic, "_recover", crash)  # the process is gone, nobody tidies up
    else:
        monkeypatch.setattr(files, "remove_folder_below", crash)
    with pytest.raises(Crash):
        write_folder_whole(folder, build("newer"), RESULT)
    monkeypatch.undo()
    check_folder(folder, RESULT)
    assert json.loads((folder / "rig.json").read_text())["is"] == survivor
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_failing_rename_brings_the_older_result_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "out"
    write_result(example_calibration(), folder)
    before = (folder / "rig.json").read_bytes()
    real = files.move_below

    def refuse(root: Path, name: str, to: str) -> None:
        if name.endswith("partial"):
            raise OSError(16, "Device or resource busy")
        real(root, name, to)

    monkeypatch.setattr(atomic, "_exchange", lambda *_: False)
    monkeypatch.setattr(files, "move_below", refuse)
    with pytest.raises(OutputError, match="busy"):
        write_result(example_calibration(), folder)
    monkeypatch.undo()
    assert (folder / "rig.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("sigma", [False, True])
def test_observations_return_exactly(tmp_path: Path, sigma: bool) -> None:
    o = example_observations(sigma=sigma)
    write_observations(tmp_path / "observations.csv", o)
    again = read_observations(tmp_path / "observations.csv", o.placements, o.cameras, [(2064, 1544)] * 3)
    for name, value in vars(o).items():
        np.testing.assert_array_equal(value, getattr(again, name))


def test_targets_return_exactly(tmp_path: Path) -> None:
    targets = make_target_set(5, size_mm=14.0, polarity="dark-on-light")
    write_target_set(tmp_path / "targets.json", targets)
    again = read_target_set(tmp_path / "targets.json")
    assert (targets.family, targets.polarity, targets.size_mm) == (again.family, again.polarity, again.size_mm)
    assert list(targets.layouts) == list(again.layouts)
    for target, dots in targets.layouts.items():
        for name, place in dots.items():
            np.testing.assert_array_equal(place, again.layouts[target][name])


def test_the_quality_is_that_of_the_residuals_that_are_known() -> None:
    behind = [np.nan, np.nan]  # a point behind its camera
    found = quality_of(np.array([[3.0, 4.0], behind, [0.0, 1.0]]), 1.2, (), ("C01",))
    assert (found.rms_px, found.mean_px) == pytest.approx((np.sqrt(13), 3.0))
    nothing = quality_of(np.array([behind]), None, (), ("C01",))
    assert (nothing.rms_px, nothing.mean_px) == (None, None)
