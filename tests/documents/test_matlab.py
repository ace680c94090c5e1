"""MATLAB's .mat files: what the two toolboxes save is read as they mean it, and nothing else is."""

import zlib
from pathlib import Path
from struct import pack

import cv2
import numpy as np
import pytest
from scipy.io import savemat

from spherecal.base.errors import InputError
from spherecal_documents.export.file_cameras import FileCamera
from spherecal_documents.export.import_rig import import_rig
from spherecal_documents.export.matlab import read_matlab

POINTS = np.random.default_rng(2).uniform([-300, -200, 1500], [300, 200, 2500], (40, 3))
TURN, SHIFT = cv2.Rodrigues(np.array([0.02, -0.3, 0.01]))[0], np.array([400.0, -5.0, 30.0])
MATRIX = np.array([[1500.0, 0, 639.0], [0, 1510.0, 511.0], [0, 0, 1]])
LENS = np.array([-0.1, 0.02, 0.001, -0.002, 0.003])


def seen(points: np.ndarray) -> np.ndarray:
    """Image points by OpenCV, the centre of the first pixel at (0, 0)."""
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, LENS)[0].reshape(-1, 2)


def bouguet(path: Path, **other: object) -> Path:
    values = {"om": cv2.Rodrigues(TURN)[0], "T": SHIFT[:, None], "nx": 1280, "ny": 1024, "n_ima": 5}
    for side in ("left", "right"):
        values |= {f"fc_{side}": [[1500.0], [1510.0]], f"cc_{side}": [[639.0], [511.0]], f"kc_{side}": LENS[:, None]}
        values[f"alpha_c_{side}"] = 0.0
    savemat(path, values | other, do_compression=True)
    return path


def toolbox(path: Path, old: bool = False, **other: object) -> Path:
    """As `toStruct` of stereo parameters: pixels from 1, image sizes rows first, rows times matrices."""
    matrix = MATRIX + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    camera = {
        "RadialDistortion": LENS[[0, 1, 4]],
        "TangentialDistortion": LENS[2:4],
        "ImageSize": [1024.0, 1280.0],
        **({"IntrinsicMatrix": matrix.T} if old else {"K": matrix}),
    }
    both = {"CameraParameters1": camera, "CameraParameters2": camera}
    savemat(path, both | {"RotationOfCamera2": TURN.T, "TranslationOfCamera2": SHIFT} | other)
    return path


def assert_a_pair(cameras: list[FileCamera] | tuple[FileCamera, ...]) -> None:
    one, other = cameras
    assert one.image_size == other.image_size == (1280, 1024)
    np.testing.assert_allclose(one.project(POINTS), seen(POINTS), atol=1e-9)
    np.testing.assert_allclose(other.project(POINTS), seen(POINTS @ TURN.T + SHIFT), atol=1e-9)


def test_bouguets_stereo_calibration(tmp_path: Path) -> None:
    assert_a_pair(list(read_matlab(bouguet(tmp_path / "Calib_Results_stereo.mat"))))


@pytest.mark.parametrize("old", [False, True], ids=["K", "IntrinsicMatrix"])
def test_stereo_parameters_as_a_struct(tmp_path: Path, old: bool) -> None:
    path = toolbox(tmp_path / "rig.mat", old)
    assert_a_pair(list(read_matlab(path)))
    rig = import_rig(path, "matlab", "m", ["C01", "C02"]).rig
    assert [camera.id for camera in rig.cameras] == ["C01", "C02"]
    np.testing.assert_allclose(rig.cameras[1].translation_mm, 1000 * SHIFT)


def test_one_camera_of_bouguets(tmp_path: Path) -> None:
    savemat(tmp_path / "one.mat", {"fc": [1500.0, 1510.0], "cc": [639.0, 511.0], "kc": LENS, "nx": 1280, "ny": 1024})
    (camera,) = read_matlab(tmp_path / "one.mat")
    np.testing.assert_allclose(camera.project(POINTS), seen(POINTS), atol=1e-9)


@pytest.mark.parametrize(
    ("values", "match"),
    [
        ({"alpha_c_left": 0.01}, "skewed"),
        ({"T": [1.0, 2.0]}, "T must be 3 finite numbers"),
        ({"fc_right": [1500.0, np.nan]}, "fc_right must be 2 finite"),
        ({"fc_right": [1500.0, -3.0]}, "above 0"),
        ({"kc_left": "text"}, "kc_left must be 5"),
        ({"R": np.zeros((3, 3))}, "rotation"),
    ],
)
def test_wrong_values_are_named(tmp_path: Path, values: dict[str, object], match: str) -> None:
    with pytest.raises(InputError, match=match):
        import_rig(bouguet(tmp_path / "a.mat", **values), "matlab")


def test_a_file_of_something_else_says_what_it_holds(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"spam": 1.0})
    with pytest.raises(InputError, match="spam"):
        read_matlab(tmp_path / "a.mat")
    (tmp_path / "b.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(126) + b"IM")
    with pytest.raises(InputError, match="version 7"):
        read_matlab(tmp_path / "b.mat")
    (tmp_path / "c.mat").write_bytes(b"x" * 500)
    with pytest.raises(InputError, match=r"no \.mat file"):
        read_matlab(tmp_path / "c.mat")


def test_a_small_file_cannot_take_much_memory(tmp_path: Path) -> None:
    bomb = zlib.compress(bytes(100 << 20), 9)
    path = tmp_path / "bomb.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + pack("<II", 15, len(bomb)) + bomb)
    assert path.stat().st_size < 200_000
    with pytest.raises(InputError, match="more than 64 MB"):
        read_matlab(path)


def element(kind: int, data: bytes) -> bytes:
    return pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def struct_array(count: int, names: bytes, shape: bytes | None = None) -> bytes:
    head = element(6, pack("<II", 2, 0)) + element(5, pack("<ii", 1, count) if shape is None else shape)
    return element(14, head + element(1, b"s") + element(5, pack("<i", 8)) + element(1, names))


@pytest.mark.parametrize(
    "content",
    [
        struct_array(20_000, b""),  # twenty thousand structs of nothing from 64 bytes
        struct_array(1, b"a".ljust(8, b"\0") * 5000),
        element(14, element(6, pack("<II", 6, 0)) + element(9, pack("<dd", float("nan"), 1e300)) + element(1, b"x")),
        element(14, element(6, bytes(1 << 20)) + element(5, pack("<ii", 1, 1)) + element(1, b"x")),
        element(
            14,
            element(6, pack("<II", 6, 0))
            + element(5, pack("<iiii", 0, 2**31 - 1, 2**31 - 1, 2**31 - 1))
            + element(1, b"x")
            + element(9, b""),
        ),
    ],
    ids=["structs without fields", "many fields", "no integers", "long flags", "no size"],
)
def test_hostile_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + content)
    with pytest.raises(InputError, match="damaged"):
        read_matlab(path)


def test_damaged_files_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    good = toolbox(tmp_path / "good.mat").read_bytes()
    refused = 0
    for _ in range(300):
        data = bytearray(good[: rng.integers(1, len(good) + 1)])
        for at in rng.integers(0, len(data), 4):
            data[at] = rng.integers(0, 256)
        (tmp_path / "bad.mat").write_bytes(data)
        try:
            import_rig(tmp_path / "bad.mat", "matlab")
        except InputError:
            refused += 1
    assert refused > 250
