"""Every export format, read back by an independent program where there is one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.studies.export_readers import READERS, python_for
from benchmarks.studies.exports import GOAL_PX, round_trip
from spherecal.base.errors import InputError, OutputError
from spherecal.data.rig import Rig
from spherecal.geometry.camera import project, undistort
from spherecal_documents.export.refit import pixel_grid, refit
from spherecal_documents.export.write_export import FORMATS, export_rig
from tests.export_rigs import make_rig, renamed

RIGS = {count: make_rig(count) for count in (5, 12)}

PLAIN = [name for name, form in FORMATS.items() if not form.fields]  # maps: tests/method/test_lens_fields.py


def test_every_format_has_a_reader():
    assert {form for form, _, _ in READERS.values()} == set(PLAIN)


@pytest.mark.parametrize("count", RIGS)
@pytest.mark.parametrize("reader", READERS)
def test_an_independent_reader_projects_the_same(tmp_path: Path, reader: str, count: int) -> None:
    if python_for(reader) is None:
        pytest.skip(f"{READERS[reader][1]} is not installed (name a Python that has it in SPHERECAL_READERS)")
    trip = round_trip(RIGS[count], reader, tmp_path)
    assert trip.to_ours_px <= GOAL_PX
    assert trip.exact == (FORMATS[READERS[reader][0]].coefficients >= count)
    if trip.exact:
        assert trip.to_rig_px <= GOAL_PX
    else:
        assert 1e-3 < trip.to_rig_px <= max(loss.max_px for loss in trip.exported.losses.values())


@pytest.mark.parametrize("name", PLAIN)
def test_the_printed_difference_is_measured_on_the_written_file(tmp_path: Path, name: str, monkeypatch) -> None:
    assert export_rig(RIGS[5], name, tmp_path / "x", max_loss_px=1).largest_difference_px < 0.1
    # a format that wrote one focal length 1e-3 px off would be found by exactly this figure
    form = FORMATS[name]

    def wrong(rig):
        first = rig.cameras[3]
        lens = first.intrinsics + np.eye(16)[0] * 1e-3
        return form.write(replace(rig, cameras=(*rig.cameras[:3], replace(first, intrinsics=lens), *rig.cameras[4:])))

    monkeypatch.setitem(FORMATS, name, replace(form, write=wrong))
    spoilt = export_rig(make_rig(4), name, tmp_path / "y").largest_difference_px
    assert 1e-4 < spoilt < 1e-3


@pytest.mark.parametrize(("name", "old", "new"), [("metashape", "<f>", '<f>1"'), ("csv", "camera,", "cmera,")])
def test_a_damaged_file_is_refused(tmp_path: Path, name: str, old: str, new: str) -> None:
    """Found by fuzzing (benchmarks/studies/fuzz.md)."""
    export_rig(RIGS[5], name, tmp_path / "x")
    (tmp_path / "x").write_text((tmp_path / "x").read_text().replace(old, new))
    with pytest.raises(InputError, match=r"as this program writes it|that can be read"):
        FORMATS[name].read(tmp_path / "x")


@pytest.mark.parametrize("name", [name for name in PLAIN if len(FORMATS[name].units) > 1])
def test_both_units(tmp_path: Path, name: str) -> None:
    for unit in FORMATS[name].units:
        exported = export_rig(RIGS[5], name, tmp_path / unit, unit)
        assert exported.unit == unit
        assert exported.largest_difference_px <= GOAL_PX
    shifts = [
        np.array([camera.placed.translation for camera in FORMATS[name].read(tmp_path / unit)]) for unit in ("mm", "m")
    ]
    np.testing.assert_allclose(shifts[0], shifts[1] * 1000, atol=1e-9)


def test_a_prescribed_unit_is_kept(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="always in m"):
        export_rig(RIGS[5], "ros", tmp_path / "x", "mm")


AWKWARD = ["1", "a b", "ä:*?", "C_to_1", "c to_1", "A" * 100, "名", "x#y", "-", "cam_10", "=1+1", "A'B"]


@pytest.mark.parametrize("name", PLAIN)
def test_awkward_camera_names(tmp_path: Path, name: str) -> None:
    rig = renamed(make_rig(4), AWKWARD)
    exported = export_rig(rig, name, tmp_path / "x")
    assert exported.largest_difference_px <= GOAL_PX
    assert len(set(exported.ids)) == len(AWKWARD)


@pytest.mark.parametrize(
    "reader", [r for r, (_, module, _) in READERS.items() if module in ("cv2", "yaml", "pycolmap")]
)
def test_awkward_names_for_other_readers(tmp_path: Path, reader: str) -> None:
    if python_for(reader) is None:
        pytest.skip(f"{READERS[reader][1]} is not installed")
    names = [n for n in AWKWARD]
    assert round_trip(renamed(make_rig(4), names), reader, tmp_path).to_rig_px <= GOAL_PX


@pytest.mark.parametrize("name", PLAIN)
def test_one_camera_and_no_reference(tmp_path: Path, name: str) -> None:
    assert export_rig(make_rig(4, 1), name, tmp_path / "one").largest_difference_px <= GOAL_PX
    rig = make_rig(4, 3)
    without = Rig(None, rig.cameras, rig.scale, rig.quality, rig.input_sha256)
    assert export_rig(without, name, tmp_path / "two").largest_difference_px <= GOAL_PX


@pytest.mark.parametrize("name", PLAIN)
def test_the_same_rig_gives_the_same_bytes_and_replaces_an_older_export(tmp_path: Path, name: str) -> None:
    def contents() -> dict[str, bytes]:
        path = tmp_path / "x"
        files = sorted(path.rglob("*")) if path.is_dir() else [path]
        return {file.name: file.read_bytes() for file in files}

    export_rig(make_rig(4, 5), name, tmp_path / "x")
    export_rig(make_rig(4, 3), name, tmp_path / "x")
    first = contents()
    export_rig(make_rig(4, 3), name, tmp_path / "x")
    assert contents() == first
    assert not any(path.name.startswith(".") for path in tmp_path.iterdir())


def test_folders_of_others_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("keep")
    with pytest.raises(OutputError, match="so it is not changed"):
        export_rig(RIGS[5], "colmap", tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["notes.txt"]


def test_a_rig_without_cameras_is_refused(tmp_path: Path) -> None:
    rig = RIGS[5]
    with pytest.raises(InputError, match="no cameras"):
        export_rig(Rig(None, (), rig.scale, rig.quality, rig.input_sha256), "csv", tmp_path / "x")
    with pytest.raises(InputError, match="no export format"):
        export_rig(rig, "houdini", tmp_path / "x")


@pytest.mark.parametrize("count", [0, 1, 2, 3, 6, 7, 10])
def test_any_number_of_coefficients_is_fitted_and_its_loss_stated(tmp_path: Path, count: int, monkeypatch) -> None:
    """A package may hold 0 to 12; the loss stated is what the lens read back differs by."""
    form, rig = FORMATS["csv"], make_rig(12)
    monkeypatch.setitem(FORMATS, "csv", replace(form, coefficients=count))
    exported = export_rig(rig, "csv", tmp_path / "x", max_loss_px=1e3)
    for camera in form.read(tmp_path / "x"):
        assert not camera.intrinsics[4 + count :].any()
        loss = exported.losses[camera.id]
        whole = next(one for one in rig.cameras if one.id == camera.id)
        grid = pixel_grid(whole.image_size, (21, 17))
        xy, good = undistort(grid, whole.intrinsics)
        rays = np.column_stack([xy[good], np.ones(good.sum())])
        turned = rays @ (camera.pose.rotation @ whole.rotation.T).T
        off = np.linalg.norm(project(turned, camera.intrinsics) - grid[good], axis=1)
        assert 0.5 * loss.max_px <= off.max() <= loss.max_px * (1 + 1e-6)
    with pytest.raises(InputError, match="--max-loss"):
        export_rig(rig, "csv", tmp_path / "y", max_loss_px=1e-6)


def test_a_lens_put_into_eight_coefficients_has_no_pole_in_the_image():
    """Every 0.1 px from the centre to the corners: a pole is narrow, and tens of px high."""
    for camera in make_rig(12).cameras:
        lens, rotation, loss = refit(camera.intrinsics, camera.image_size, 8)
        corners, _ = undistort(pixel_grid(camera.image_size, (2, 2)), camera.intrinsics)
        for corner in corners:
            rays = np.column_stack([np.linspace(0, 1, 15_000)[:, None] * corner, np.ones(15_000)])
            off = np.linalg.norm(project(rays @ rotation.T, lens) - project(rays, camera.intrinsics), axis=1)
            assert off.max() <= loss.max_px * (1 + 1e-6)
