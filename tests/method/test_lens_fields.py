"""Fields of lenses and motions of images: found, taken only where the data ask for them, kept in files, used after."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.simulators.lens_errors import TrueLens, random_field
from benchmarks.studies.export_readers import python_for, read
from benchmarks.studies.simulated import Bars, make_bars, simulate
from spherecal.adjust import corrections
from spherecal.adjust.camera_effects import MOTION, TURN, Corrections, Design, _step_share
from spherecal.adjust.corrections import _with_considered
from spherecal.adjust.lens_field import field_basis, left_unknown
from spherecal.adjust.variance_components import (
    Effects,
    Estimate,
    effect_cofactors,
    estimated,
    others_eliminated,
    solved,
)
from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration, CameraSigma
from spherecal.data.rig_camera import RigCamera
from spherecal.geometry.camera import estimated_mask, intrinsics_vector, project, project_with_derivatives, undistort
from spherecal.geometry.field_table import FieldTable, table_nodes
from spherecal.geometry.rotation import exp_rotation
from spherecal.result.camera_effects import image_motions, shared_with_fields
from spherecal.steps.settings import CalibrationSettings
from spherecal_documents.export.file_cameras import FileCamera, FileRig, Pose
from spherecal_documents.export.import_rig import import_rig
from spherecal_documents.export.mrcal import MOST_PX, MRCAL_SPLINED
from spherecal_documents.export.write_export import check_points, export_rig
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig
from spherecal_files.write_result import write_result
from spherecal_sim.truth import SimulationOptions, Truth

SIZE = np.array([2064.0, 1544.0])
LENS = intrinsics_vector(np.array([[2319.0, 0, 1032], [0, 2319, 772], [0, 0, 1]]), [-0.1, 0.02, 0, 0, 0])


@pytest.fixture(scope="module")
def misfitting() -> tuple[Calibration, Truth, Bars]:
    """Rig A whose lenses are off their model by 0.1 px."""
    simulated = simulate("rigA", 301, SimulationOptions(misfit_px=0.1))
    with pytest.MonkeyPatch.context() as patch:  # but for what a ball may be strained by, which simulated ones are not
        patch.setattr(corrections, "strain_variance", lambda *_: np.zeros((5, 5)))
        return calibrate(simulated.session), simulated.truth, make_bars(simulated.truth, 5)


def test_a_field_has_nothing_that_the_lens_model_or_a_turn_can_do() -> None:
    basis = field_basis(np.zeros(2), SIZE, LENS, estimated_mask("brown"), 80, 1e-4)
    grid = np.stack(np.meshgrid(*[np.arange(30)] * 2), axis=-1).reshape(-1, 2)
    uv = (grid + 0.5) / 30 * SIZE
    xy, _ = undistort(uv, LENS)
    _, _, by_lens = project_with_derivatives(np.column_stack([xy, np.ones(len(xy))]), LENS)
    own = by_lens[:, :, estimated_mask("brown")].reshape(2 * len(uv), -1)
    values = basis.at(uv).reshape(2 * len(uv), -1)
    cosine = (own / np.linalg.norm(own, axis=0)).T @ (values / np.linalg.norm(values, axis=0))
    assert np.abs(cosine).max() < 0.1
    variance = (basis.at(uv) ** 2).sum(axis=2)
    assert 0.15 < variance.mean() < 0.5  # of 1: three quarters are what the lens model can do


def test_amplitudes_are_found_by_restricted_likelihood_and_vanish_without_effects() -> None:
    rng = np.random.default_rng(3)
    part = np.repeat([0, 1, 2], 40)
    design = rng.normal(size=(900, 120))
    for amplitudes in ((3.0, 1.0, 0.5), (0.0, 0.0, 0.0)):
        b = rng.normal(size=120) * np.array(amplitudes)[part]
        residual = design @ b + rng.normal(size=900)
        effects = Effects(
            design.T @ design, design.T @ residual, float(residual @ residual), 900, part, np.zeros(3, int)
        )
        found = estimated(effects, np.ones(3))
        # the parts' own amplitudes are drawn a little towards the common one
        if any(amplitudes):
            assert np.sqrt(found.variances * found.sigma0_squared) == pytest.approx(amplitudes, rel=0.5)
            assert -found.coefficients == pytest.approx(b, abs=0.2)
        else:
            assert np.abs(found.coefficients).max() < 0.05
        assert found.sigma0_squared == pytest.approx(1.0, rel=0.15)


def test_effects_that_nobody_estimates_are_taken_up_by_the_others() -> None:
    rng, part = np.random.default_rng(4), np.repeat([0, 1], 3)
    design, noise = rng.normal(size=(40, 6)), rng.normal(size=40)
    effects = Effects(design.T @ design, design.T @ noise, float(noise @ noise), 40, part, np.arange(2))
    taken, considered = np.array([0.5, 0.0]), np.array([0.0, 0.2])
    one, other = design[:, :3], design[:, 3:]
    own = np.linalg.inv(one.T @ one + np.eye(3) / 0.5)
    shift = own @ one.T @ other  # of the estimate, by effects that are not estimated
    expected = np.block([[own + 0.2 * shift @ shift.T, -0.2 * shift], [-0.2 * shift.T, 0.2 * np.eye(3)]])
    assert _with_considered(effects, taken, considered) == pytest.approx(expected, abs=1e-12)
    alone = others_eliminated(effects, taken, considered > 0)
    gain = solved(alone, np.array([0.2])).deviance - solved(alone, np.zeros(1)).deviance
    assert gain == pytest.approx(solved(effects, taken + considered).deviance - solved(effects, taken).deviance)


def test_beyond_the_last_points_a_field_is_as_uncertain_as_it_errs() -> None:
    """A lens was 2 px off 160 px beyond its last point, where its field had a standard uncertainty of 0.15 px."""
    noise, by_basis, by_both = 0.05, [], []
    region = SIZE * [0.7, 1.0]
    basis = field_basis(np.zeros(2), region, LENS, estimated_mask("brown"), 80, 1e-4)
    whole = np.array([[-1.0, -1.0], [1.0, 1.0]])
    for seed in range(12):
        rng = np.random.default_rng(seed)
        coefficients = random_field((int(SIZE[0]), int(SIZE[1])), LENS, whole, 0.15, 0.4, rng)
        lens = TrueLens((int(SIZE[0]), int(SIZE[1])), LENS, coefficients, whole)
        seen = rng.uniform([0, 0], region, (600, 2))
        beyond = rng.uniform([0.75, 0.1] * SIZE, [0.85, 0.9] * SIZE, (200, 2))
        design = basis.at(seen).reshape(-1, basis.count) / noise
        residual = lens.field_at(lens.normalised(seen)).ravel() / noise + rng.normal(size=len(design))
        one = np.zeros(basis.count, dtype=int)
        effects = Effects(
            design.T @ design, -design.T @ residual, float(residual @ residual), len(design), one, np.zeros(1, int)
        )
        found = estimated(effects, np.ones(1))
        values = basis.at(beyond)
        own = effect_cofactors(effects, found.variances)
        square = np.einsum("nij,nij->n", values @ own, values) / 2
        amplitude = float(np.sqrt(found.variances[0]))
        further = (amplitude * left_unknown(beyond, region, seen, noise / amplitude)) ** 2
        errors = values @ found.coefficients - lens.field_at(lens.normalised(beyond))
        for into, variance in ((by_basis, square), (by_both, np.maximum(square, further))):
            into.append((errors**2 / variance[:, None] / found.sigma0_squared).mean())
    assert np.sqrt(np.mean(by_basis)) > 2.0  # 2.6, and 0.8 with both: the amplitude is that of the smoother process
    assert 0.3 < np.sqrt(np.mean(by_both)) < 1.2


def test_lenses_off_their_model_get_fields_and_the_rigid_form_and_bars_are_right(
    misfitting: tuple[Calibration, Truth, Bars],
) -> None:
    done, truth, bars = misfitting
    noise = np.random.default_rng(301).normal(size=bars.uv.shape)
    codes = {finding.code for finding in done.rig.quality.findings}
    assert done.rig.quality.verdict == "valid"
    assert done.rig.form is not None
    assert done.rig.form.name == "rigid"
    assert "lens-field" in codes
    assert not codes & {"lens-misfit", "camera-drifts", "camera-moved"}
    assert all(camera.field is not None for camera in done.rig.cameras)
    errors = bars.errors_of_rig(done, noise)
    assert np.sqrt((errors**2).mean()) < 0.025  # 0.054 without fields
    assert np.sqrt(((errors / bars.stated_of_rig(done, truth)) ** 2).mean()) == pytest.approx(1.0, abs=0.35)


def test_clean_lenses_have_no_fields() -> None:
    done = calibrate(simulate("demo", 7, SimulationOptions()).session)
    assert all(camera.field is None for camera in done.rig.cameras)
    assert not done.motions
    assert not {"lens-field", "camera-drifts"} & {finding.code for finding in done.rig.quality.findings}


@pytest.mark.parametrize("applied", [True, False])
def test_motions_that_were_not_applied_are_not_told(applied: bool) -> None:
    """dome15 without the rig's scale said that C01 turns by 0 mdeg, and wrote a table of zeros."""
    session = simulate("demo", 7, SimulationOptions(targets=40)).session
    o = session.observations
    assert o is not None
    camera, placement = np.divmod(np.arange(2 * len(session.placements)), len(session.placements))
    turns = np.random.default_rng(1).normal(0, 1e-4, TURN * len(camera))
    found = Estimate(turns, np.ones(2), 1.0, 0.0, np.ones(2))
    design = Design((), camera, placement, 2)
    estimated_ones = Corrections(**vars(found), design=design, evidence={MOTION: 40.0}, redundancy=100, turning=applied)
    assert bool(image_motions(session, o.placements, estimated_ones)) is applied


def test_a_rig_with_fields_is_written_and_read_again(
    misfitting: tuple[Calibration, Truth, Bars], tmp_path: Path
) -> None:
    done = misfitting[0]
    write_result(done, tmp_path / "result")
    again = read_rig(tmp_path / "result" / "rig.json")
    for before, after in zip(done.rig.cameras, again.cameras, strict=True):
        assert before.field is not None
        assert after.field is not None
        assert np.abs(before.field.du - after.field.du).max() < 1e-6
        uv = np.array([[100.0, 200.0], [1500.0, 900.0]])
        assert after.field.measured(uv - after.field.at(uv)) == pytest.approx(uv, abs=1e-4)
        ideal = after.undistort(uv)
        assert ideal == pytest.approx(before.undistort(uv), abs=1e-4)
    document = json.loads((tmp_path / "result" / "rig.json").read_text())
    distortion = document["cameras"][0]["distortion"]
    assert distortion["model"] == "opencv+field"
    distortion["model"] = "opencv"
    (tmp_path / "result" / "rig.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="field"):
        read_rig(tmp_path / "result" / "rig.json")


def test_exports_say_what_is_lost_with_fields_and_maps_lose_nothing(
    misfitting: tuple[Calibration, Truth, Bars], tmp_path: Path
) -> None:
    rig = misfitting[0].rig
    plain = export_rig(rig, "opencv", tmp_path / "opencv")
    assert len(plain.fields_lost) == len(rig.cameras)
    assert 0.05 < max(loss.max_px for loss in plain.fields_lost.values()) < 1.0
    maps = export_rig(rig, "maps", tmp_path / "maps")
    assert not maps.fields_lost
    assert maps.largest_difference_px < 0.01


def test_mrcals_splines_hold_lens_and_field(misfitting: tuple[Calibration, Truth, Bars], tmp_path: Path) -> None:
    rig = misfitting[0].rig
    exported = export_rig(rig, "mrcal-splined", tmp_path / "splined")
    assert not exported.fields_lost
    assert exported.largest_difference_px < MOST_PX
    with pytest.raises(InputError, match="mrcal-splined"):
        import_rig(tmp_path / "splined", "mrcal-splined")
    if python_for("mrcal") is None:
        pytest.skip("mrcal is not installed (name a Python that has it in SPHERECAL_READERS)")
    seen = {camera.id: check_points(camera, rig) for camera in rig.cameras}
    found = read("mrcal", tmp_path / "splined", {name: points / 1000 for name, (points, _) in seen.items()})
    for camera in rig.cameras:
        assert camera.field is not None
        off = found[camera.id] - camera.field.measured(seen[camera.id][1])
        assert np.linalg.norm(off, axis=1).max() < MOST_PX


def test_a_lens_that_folds_is_refused_by_mrcals_splines() -> None:
    folding = intrinsics_vector(
        np.array([[880.0, 0, 960], [0, 880, 540], [0, 0, 1]]), [-0.25, 0.09, 5e-4, -3e-4, -0.015]
    )
    camera = FileCamera("C1", (1920, 1080), folding, Pose(np.eye(3), np.zeros(3)))
    with pytest.raises(InputError, match=r"C1: no splined model is nearer"):
        MRCAL_SPLINED.write(FileRig((camera,), "C1", "m", "a test"))


def test_poses_are_as_uncertain_as_what_their_fields_do_like_a_turn_where_points_were_seen() -> None:
    """Seed 1013: cameras turned by 3 mrad, and right but for that, said 0.25 mrad."""
    pitch, nodes, shape = table_nodes((2064, 1544))
    seen = np.random.default_rng(1).uniform([300, 300], [1200, 1200], (400, 2))
    turn = np.array([2e-3, 0.0, 0.0])
    rays = np.column_stack([undistort(nodes, LENS)[0], np.ones(len(nodes))])
    off = nodes - project(rays @ exp_rotation(turn).T, LENS)
    sigma = CameraSigma(np.full(3, 0.01), np.full(3, 0.02), np.where(estimated_mask("brown"), 1e-3, 0.0))
    size = (2064, 1544)
    plain = RigCamera("C1", None, size, LENS, np.eye(3), np.zeros(3), rms_px=0.1, observations=400, sigma=sigma)
    tables = (
        FieldTable(pitch, np.zeros(2), (k * off[:, 0]).reshape(shape), (k * off[:, 1]).reshape(shape)) for k in (1, 0)
    )
    like_a_turn, nothing = (replace(plain, field=table) for table in tables)
    same, wider, equal = shared_with_fields((plain, like_a_turn, nothing), {"C1": seen})
    assert same.sigma is sigma
    assert wider.sigma is not None
    assert wider.sigma.rotation_deg == pytest.approx(np.hypot(0.01, np.rad2deg(turn)), abs=1e-3)
    assert (wider.sigma.centre_mm == sigma.centre_mm).all()
    assert (wider.sigma.intrinsics[~estimated_mask("brown")] == 0).all()
    assert equal.sigma is not None
    assert equal.sigma.rotation_deg == pytest.approx(sigma.rotation_deg)


def test_a_table_is_bilinear_and_ends_at_its_edges() -> None:
    pitch, nodes, shape = table_nodes((640, 480))
    table = FieldTable(pitch, np.zeros(2), nodes[:, 0].reshape(shape), nodes[:, 1].reshape(shape))
    at = np.array([[3.0, 4.0], [639.0, 479.0], [100.5, 33.25]])
    assert table.at(at) == pytest.approx(at)
    assert table.at(np.array([[-50.0, 10.0]])) == pytest.approx(np.array([[0.0, 10.0]]))
    assert np.isnan(table.at(np.array([[np.nan, 1.0]]))).all()


def test_a_knock_is_one_step_and_creep_is_not() -> None:
    knock = np.array([[0.0], [0.0], [1.0], [1.0]])
    creep = np.arange(4.0)[:, None]
    assert _step_share(knock - knock.mean(axis=0)) == pytest.approx(1.0)
    assert _step_share(creep - creep.mean(axis=0)) == pytest.approx(0.8)


def test_the_cameras_of_dome15_drift(shared_data: Path) -> None:
    """Two of its real cameras creep by up to 2 px over the twelve placements; it is not the lenses."""
    done = calibrate(read_session(shared_data / "dome15"))
    codes = {finding.code: finding for finding in done.rig.quality.findings}
    assert done.rig.quality.rms_px is not None
    assert done.rig.quality.rms_px < 0.52  # 0.84 with one pose a camera
    assert {"C01", "C07"} <= set(codes["camera-drifts"].where[:4])
    assert "lens-misfit" not in codes
    assert len(done.motions) > 100


def test_images_that_contradict_drift_are_left_out_and_drift_is_kept(shared_data: Path) -> None:
    """Nine placements of dome15, each camera with a lens of its own: turns had been given up for two images."""
    session = read_session(shared_data / "dome15")
    o = session.observations
    assert o is not None
    kept = replace(session, observations=o.select(np.flatnonzero(o.placement % 4 != 0)))
    done = calibrate(kept, CalibrationSettings(own_intrinsics=True))
    assert [(r.option, r.automatic) for r in done.rig.repairs] == [("--leave-out", True)] * 2
    assert {r.value for r in done.rig.repairs} == {"C12@P04", "C08@P06"}
    assert done.rig.quality.valid and "camera-drifts" in {f.code for f in done.rig.quality.findings}
    plain = calibrate(kept, CalibrationSettings(own_intrinsics=True, repair_by_itself=False))
    assert plain.rig.quality.valid and not plain.rig.repairs
    assert plain.rig.quality.rms_px is not None and done.rig.quality.rms_px is not None
    assert done.rig.quality.rms_px < 0.9 * plain.rig.quality.rms_px


def test_in_large_recordings_consecutive_placements_share_a_turn(
    shared_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("spherecal.adjust.corrections.MOST_TURNS", 270)  # dome15 has 174 images
    done = calibrate(read_session(shared_data / "dome15"))
    turns = {(m.camera, int(m.placement[1:]) - 1): m.rotation_deg for m in done.motions}
    assert len(turns) > 100
    assert all((turn == turns[camera, place - place % 2]).all() for (camera, place), turn in turns.items())
    assert done.rig.quality.rms_px is not None
    assert done.rig.quality.rms_px < 0.65  # 0.84 with one pose a camera, 0.5 with a turn at each placement
