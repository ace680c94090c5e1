"""`import spherecal`: its names, its laziness, its answers against the command line's, and the examples run."""

import csv
import importlib.util
import inspect
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

import spherecal
from spherecal.base.arrays import ByValue
from spherecal_app import api
from spherecal_app.cli.main import main
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import SimulationOptions


@pytest.fixture(scope="module")
def session_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("api") / "session"
    write_session(*simulate_session("demo", 1, SimulationOptions(targets=80)), folder)
    return folder


@pytest.fixture(scope="module")
def result_folder(session_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As the command line writes it."""
    folder = tmp_path_factory.mktemp("api") / "result"
    assert main(["calibrate", str(session_folder), "-o", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def rig(result_folder: Path) -> spherecal.Rig:
    return spherecal.load_rig(result_folder)


def test_the_package_and_the_page_name_the_same_things() -> None:
    names = [name for name in dir(spherecal) if name != "__version__"]
    assert sorted(api.__all__) == sorted(spherecal.__all__) == names
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    for name in api.__all__:
        assert getattr(spherecal, name) is getattr(api, name)
        assert f"`{name}" in page, f"docs/api.md does not tell of {name}"


def test_every_public_function_says_what_it_gives() -> None:
    for name in api.__all__:
        thing = getattr(api, name)
        if inspect.isroutine(thing) or inspect.isclass(thing):
            assert inspect.getdoc(thing), name


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = (
        "import sys, spherecal; assert spherecal.__version__; "
        "sys.exit(any(m in sys.modules for m in ('numpy', 'scipy', 'numba', 'cv2', 'spherecal_app.api')))"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=60, check=False).returncode == 0


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'calibrat'"):
        _ = spherecal.calibrat  # type: ignore[attr-defined]


def test_calibration_is_the_command_lines(session_folder: Path, result_folder: Path, tmp_path: Path) -> None:
    calibration = spherecal.calibrate_session(session_folder)
    spherecal.save_calibration(calibration, tmp_path / "mine", {"method": "auto", "seed": 0})
    assert (tmp_path / "mine" / "rig.json").read_bytes() == (result_folder / "rig.json").read_bytes()


def test_verification_is_the_command_lines(session_folder: Path, rig: spherecal.Rig, result_folder: Path) -> None:
    verification = spherecal.verify_rig(session_folder, rig)
    assert verification.decision.verdict == "consistent"
    again = spherecal.verify_rig(spherecal.load_session(session_folder), result_folder)
    assert (again.decision, again.lengths, again.measured) == (
        verification.decision,
        verification.lengths,
        verification.measured,
    )


def test_progress_and_cancelling(session_folder: Path) -> None:
    stages: list[str] = []
    context = spherecal.Context(lambda event: stages.append(event.stage), lambda: len(stages) > 2)
    with pytest.raises(spherecal.Cancelled):
        spherecal.calibrate_session(session_folder, context=context)
    assert stages


def test_points_come_back_from_their_images(rig: spherecal.Rig) -> None:
    truth = np.random.default_rng(1).uniform(-150, 150, (40, 3)) + centre_of_view(rig)
    measured = spherecal.triangulate_points(rig, spherecal.project_points(rig, truth))
    found = measured.views >= 2
    assert found.sum() >= 30
    assert np.abs(measured.points_mm - truth)[found].max() < 1e-6
    assert np.isnan(measured.points_mm[~found]).all()
    assert not measured.contradicting.any()
    assert np.linalg.eigvalsh(measured.covariance_mm2[found]).min() > 0


def test_covariance_of_points_grows_with_the_noise_and_holds_it(rig: spherecal.Rig) -> None:
    """The image noise's share is the scatter of noisy triangulations (Monte Carlo); the cameras' share adds to it."""
    place, random = centre_of_view(rig), np.random.default_rng(2)
    exact = spherecal.project_points(rig, np.tile(place, (2000, 1)))
    noisy = {name: uv + random.normal(0, 0.2, uv.shape) for name, uv in exact.items()}
    measured = spherecal.triangulate_points(rig, noisy, sigma_px=0.2)
    scatter = np.cov(measured.points_mm.T)
    stated = measured.covariance_mm2.mean(axis=0)
    cameras = spherecal.triangulate_points(rig, {n: uv[:1] for n, uv in exact.items()}, 1e-6).covariance_mm2[0]
    assert np.trace(stated - cameras) == pytest.approx(np.trace(scatter), rel=0.15)
    assert np.trace(cameras) > 0


def test_a_points_covariance_is_its_own(rig: spherecal.Rig) -> None:
    """What is stated of image points stays, whatever other points there are, and is tested."""
    place, random = centre_of_view(rig), np.random.default_rng(5)
    exact = spherecal.project_points(rig, place + random.uniform(-40, 40, (60, 3)))
    noisy = {name: uv + random.normal(0, 0.02, uv.shape) for name, uv in exact.items()}
    many = spherecal.triangulate_points(rig, noisy, sigma_px=0.2)
    few = spherecal.triangulate_points(rig, {name: uv[:2] for name, uv in noisy.items()}, sigma_px=0.2)
    assert many.covariance_mm2[:2] == pytest.approx(few.covariance_mm2, rel=1e-9)
    assert many.noise_ratio == pytest.approx(0.1, rel=0.15) and few.noise_ratio is None


def test_two_points_have_a_covariance_together(rig: spherecal.Rig) -> None:
    """Of a short length most of what cameras err by cancels."""
    place = centre_of_view(rig)
    ends = np.stack([place, place + np.array([20.0, 0.0, 0.0])])
    measured = spherecal.triangulate_points(rig, spherecal.project_points(rig, ends), sigma_px=1e-6)
    joint = measured.joint_covariance_mm2(0, 1)
    assert joint.shape == (6, 6) and joint == pytest.approx(joint.T)
    assert joint[:3, :3] == pytest.approx(measured.covariance_mm2[0]) and np.linalg.eigvalsh(joint).min() > -1e-12
    length, standard = measured.length_mm(0, 1)
    apart = np.sqrt(measured.covariance_mm2[0, 0, 0] + measured.covariance_mm2[1, 0, 0])
    assert length == pytest.approx(20.0) and 0 < standard < 0.7 * apart
    with pytest.raises(spherecal.InputError):
        spherecal.triangulate_points(rig, {"C01": np.zeros((2, 2))}).joint_covariance_mm2(0, 1)


def test_what_is_frozen_is_not_written_to(rig: spherecal.Rig, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="read-only"):
        rig.cameras[0].rotation[0, 0] = 2.0
    wrong = replace(rig.cameras[0], rotation=1.1 * rig.cameras[0].rotation)
    with pytest.raises(spherecal.InputError):
        spherecal.save_rig(replace(rig, cameras=(wrong, *rig.cameras[1:])), tmp_path / "rig.json")
    assert not (tmp_path / "rig.json").exists()


@pytest.mark.parametrize("name", spherecal.__all__)
def test_public_records_hold_arrays_that_are_not_written_to(name: str) -> None:
    public = getattr(spherecal, name)
    if inspect.isclass(public) and is_dataclass(public) and any("array" in str(f.type).lower() for f in fields(public)):
        assert issubclass(public, ByValue)
        assert public.__post_init__ is ByValue.__post_init__


def test_a_wrong_view_is_left_out_and_two_that_disagree_give_none(rig: spherecal.Rig) -> None:
    place = centre_of_view(rig)[None]
    seen = spherecal.project_points(rig, place)
    names = list(seen)
    seen[names[0]] = seen[names[0]] + 40.0
    measured = spherecal.triangulate_points(rig, seen)
    assert not measured.used[names[0]][0] and measured.used[names[1]][0]
    assert np.abs(measured.points_mm - place).max() < 1e-6
    assert np.hypot(*measured.residuals_px[names[0]][0]) == pytest.approx(40 * np.sqrt(2), rel=1e-3)
    two = spherecal.triangulate_points(rig, {name: seen[name] for name in names[:2]})
    assert two.contradicting[0]
    assert np.isnan(two.points_mm).all()
    assert np.isnan(two.covariance_mm2).all(), "no place, no covariance"
    assert two.views[0] == 0


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ({"C99": [[1, 2]]}, 'has no camera "C99"'),
        ({"C01": [[1, 2]], "C02": [[1, 2], [3, 4]]}, "different numbers"),
        ({"C01": [1, 2, 3]}, r"must have the shape \(\.\.\., 2\), but has \(3,\)"),
        ({"C01": [[1, 2]], "C02": [1, 2]}, "different shapes"),
        ({"C01": "nonsense"}, "array of numbers"),
        (np.zeros((3, 2)), r"\(6, \.\.\., 2\)"),
    ],
)
def test_wrong_image_points_are_named(rig: spherecal.Rig, points: dict[str, object], message: str) -> None:
    with pytest.raises(spherecal.InputError, match=message):
        spherecal.triangulate_points(rig, points)  # type: ignore[arg-type]


def test_no_points_are_no_error(rig: spherecal.Rig) -> None:
    assert spherecal.triangulate_points(rig, {}).points_mm.shape == (0, 3)
    unseen = spherecal.triangulate_points(rig, {"C01": np.full((3, 2), np.nan)})
    assert np.isnan(unseen.points_mm).all() and unseen.points_mm.shape == (3, 3)


def test_points_keep_the_shape_that_they_came_in(rig: spherecal.Rig) -> None:
    place = centre_of_view(rig)
    bars = place + np.random.default_rng(5).uniform(-30, 30, (7, 2, 3))  # two ends of seven bars
    for points in (place, place[None], bars[:, 0], bars):
        seen = spherecal.project_points(rig, points)
        assert {uv.shape for uv in seen.values()} == {(*points.shape[:-1], 2)}
        for given in (seen, np.stack(list(seen.values()))):
            measured = spherecal.triangulate_points(rig, given)
            assert np.abs(measured.points_mm - points).max() < 1e-6
            assert measured.covariance_mm2.shape == (*points.shape, 3)
            assert measured.views.shape == measured.contradicting.shape == points.shape[:-1]
            assert measured.used["C01"].shape == points.shape[:-1]
            assert measured.residuals_px["C01"].shape == (*points.shape[:-1], 2)
    flat = spherecal.triangulate_points(rig, {name: uv.reshape(-1, 2) for name, uv in seen.items()})
    assert np.array_equal(flat.covariance_mm2.reshape(7, 2, 3, 3), measured.covariance_mm2)


def test_a_point_of_one_view_rests_on_none(rig: spherecal.Rig) -> None:
    seen = spherecal.project_points(rig, centre_of_view(rig))
    measured = spherecal.triangulate_points(rig, {"C01": seen["C01"]})
    assert measured.views == 0 and not measured.used["C01"] and np.isnan(measured.covariance_mm2).all()


def test_what_detectors_give_is_triangulated_by_its_ids(rig: spherecal.Rig) -> None:
    """(ids, uv), {id: (u, v)} and corners of markers, in any order, each camera with others."""
    rng = np.random.default_rng(7)
    points = centre_of_view(rig) + rng.normal(0, 30, (9, 4, 3))
    ids = np.array([40, 3, 17, 8, 21, 5, 60, 11, 2])
    seen = spherecal.project_points(rig, points)
    order = {name: rng.permutation(9)[: 9 - i % 3] for i, name in enumerate(seen)}
    corners = {name: (ids[o][:, None], seen[name][o].astype(np.float32)) for name, o in order.items()}
    measured = spherecal.triangulate_points(rig, corners)
    assert measured.ids is not None and measured.ids.tolist() == sorted(ids)
    assert np.allclose(measured.points_mm, points[np.argsort(ids)], atol=1e-2)
    centres = {name: {int(ids[i]): seen[name][i, 0] for i in o} for name, o in order.items()}
    single = spherecal.triangulate_points(rig, centres)
    assert np.allclose(single.points_mm, points[np.argsort(ids), 0], atol=1e-5) and "<th>id" in single._repr_html_()
    nothing: Any = {name: (None, None) for name in seen}  # as cv2.aruco says it
    assert spherecal.triangulate_points(rig, nothing).points_mm.shape == (0, 3)
    cases: list[tuple[Any, str]] = [
        ({"C01": {"P1": corners["C01"]}}, "of one frame"),
        ({"C01": corners["C01"], "C02": seen["C02"]}, "C02"),
        ({"C01": ([1, 2], np.zeros((3, 2)))}, "2 ids, but 3"),
        ({"C01": ([1, 1], np.zeros((2, 2)))}, "twice"),
        ({"C01": corners["C01"], "C02": (ids, seen["C02"][:, 0])}, "points for an id"),
    ]
    for wrong, said in cases:
        with pytest.raises(spherecal.InputError, match=said):
            spherecal.triangulate_points(rig, wrong)


def centre_of_view(rig: spherecal.Rig) -> np.ndarray:
    """The place nearest to all optical axes."""
    axes = np.array([camera.rotation[2] for camera in rig.cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    centres = np.array([camera.centre_mm for camera in rig.cameras])
    return np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, centres))


# --- the examples ----------------------------------------------------------------------------------------------------


@pytest.fixture
def example() -> Callable[[str], ModuleType]:
    def load(name: str) -> ModuleType:
        spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


def test_example_calibrates_and_verifies(example, session_folder: Path, tmp_path: Path, capsys) -> None:
    assert example("calibrate_and_verify").main(str(session_folder), str(tmp_path / "result")) == 0
    said = capsys.readouterr().out
    assert "6 of 6 cameras" in said and "The bars say: consistent." in said
    assert (tmp_path / "result" / "bars.csv").exists()


def test_example_measures_points(example, rig: spherecal.Rig, result_folder: Path, tmp_path: Path, capsys) -> None:
    ends = centre_of_view(rig) + np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]])
    with (tmp_path / "seen.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(["point", "camera", "u", "v"])
        for name, uv in spherecal.project_points(rig, ends).items():
            table.writerows([point, name, *map(float, one)] for point, one in zip("AB", uv, strict=True))
    example("measure_points").main(str(result_folder / "rig.json"), str(tmp_path / "seen.csv"))
    assert "A - B: 100.0000 mm" in capsys.readouterr().out


def test_example_exports(example, result_folder: Path, tmp_path: Path) -> None:
    assert example("export_for_others").main(str(result_folder / "rig.json"), str(tmp_path / "out")) < 1e-6


def test_examples_are_told_of() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    names = sorted(path.name for path in (ROOT / "examples").glob("*.py"))
    assert len(names) == 10
    assert all(name in page for name in names)
