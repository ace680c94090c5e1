"""Rendered images: sub-pixel truth, optics, sensor, faults in the scene, sessions."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.simulators.dot_bound import dot_bounds
from spherecal.base.context import Context
from spherecal.base.errors import Cancelled, InputError
from spherecal.data.session import Session
from spherecal.geometry.camera import fisheye_vector, project
from spherecal.targets.target_set import TargetSet
from spherecal_files.read_session import read_session
from spherecal_sim.dot_truth import DotTruth, Station, TrueDots, ball_dots, bar_dots, outline_dots
from spherecal_sim.optics import Psf, Sensor, expose, gather, pixel_kernel, separable
from spherecal_sim.radiance import CELLS, ideal_place
from spherecal_sim.render_session import RENDERED, Rendered, demo_session, render_image, render_session
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.simulated_ball import wrap
from spherecal_sim.simulated_scene import RenderSettings, ball_scene, bar_scene, lit_for
from spherecal_sim.tracing import flatten
from spherecal_sim.truth import Truth

FLAT = RenderSettings(lighting="flat", vignetting=False, sensor=Sensor(noise=False, bits=16))


# What is seen of a scene as a whole, and not dot by dot, shows in a smaller crop as well.
SMALL = 240


@pytest.fixture(scope="module")
def simulated() -> tuple[Session, Truth]:
    return simulate_session("rigA", 0, RENDERED)


def target_set(session: Session) -> TargetSet:
    assert session.target_set is not None
    return session.target_set


def cropped(station: Station, middle: np.ndarray, size: int) -> Station:
    """The station with only a square around an image point."""
    intrinsics = station.intrinsics.copy()
    intrinsics[2:4] -= np.rint(middle) - size / 2
    return replace(station, intrinsics=intrinsics, size=(size, size))


def station_of(truth: Truth, camera: int) -> Station:
    c = truth.cameras[camera]
    return Station(c.id, c.rotation, c.translation_mm, c.intrinsics, c.kind.image_size)


_dots: dict[tuple[int, float, float], TrueDots] = {}


def dots_of(truth: Truth, radius_mm: float, half_mm: float) -> TrueDots:
    """The ball's dots, computed once."""
    key = (id(truth), radius_mm, half_mm)
    if key not in _dots:
        _dots[key] = ball_dots(truth.ball, radius_mm, half_mm)
    return _dots[key]


def ball_image(
    simulated: tuple[Session, Truth],
    settings: RenderSettings,
    targets: TargetSet | None = None,
    camera: int = 7,
    seed: int = 0,
    size: int = 400,
) -> Rendered:
    """A crop of the middle of the ball's first placement."""
    session, truth = simulated
    targets = targets or target_set(session)
    scene = lit_for(ball_scene(truth, targets, 0, settings), truth, camera, settings)
    dots = dots_of(truth, targets.dot_diameter_mm / 2, targets.size_mm / 2)
    dots = dots.moved(truth.ball_rotations[0], truth.ball_places_mm[0])
    station = station_of(truth, camera)
    middle = project((truth.ball_places_mm[0] @ station.rotation.T + station.translation_mm)[None], station.intrinsics)[
        0
    ]
    rng = np.random.default_rng(seed)
    return render_image(scene, dots, cropped(station, middle, size), settings, rng)


def centroid_errors(rendered: Rendered, paper: float) -> np.ndarray:
    """Intensity-weighted centroids of isolated dots on plain paper minus the outline's centroid, px."""
    d, errors = rendered.dots, []
    for i in np.flatnonzero(d.fully_visible & (d.gap_px > 8.0)):
        half = int(np.ceil(d.axes_px[i, 0] / 2 + 3.5))
        u, v = np.rint(d.uv_cen[i]).astype(int)
        window = rendered.exposure[max(v - half, 0) : v + half + 1, max(u - half, 0) : u + half + 1] - paper
        border = np.concatenate([window[0], window[-1], window[:, 0], window[:, -1]])
        if window.shape != (2 * half + 1,) * 2 or np.abs(border).max() > 1e-3:  # cut off, or not only this dot
            continue
        y, x = np.mgrid[v - half : v + half + 1, u - half : u + half + 1]
        errors.append(np.array([(window * x).sum(), (window * y).sum()]) / window.sum() - d.uv_cen[i])
    return np.array(errors)


@pytest.mark.parametrize("psf", [Psf(), Psf("disc", 1.2), Psf("coma", 0.4)], ids=lambda p: p.kind)
def test_dots_on_the_ball_lie_where_the_truth_says(simulated, psf: Psf) -> None:
    rendered = ball_image(simulated, replace(FLAT, psf=psf), size=800)
    errors = centroid_errors(rendered, paper=0.8 / 0.85 * 0.04)
    assert len(errors) >= 10
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.001
    assert np.abs(errors.mean(axis=0)).max() < 0.0005


def test_a_flat_dot_seen_face_on(simulated) -> None:
    session, truth = simulated
    scene = lit_for(bar_scene(truth, target_set(session), truth.bar_poses[0], FLAT), truth, 0, FLAT)
    marks = bar_dots(scene, truth.bar(truth.bar_poses[0].bar).targets)
    rotation = np.stack([scene.bar_rotations[0][:, 0], scene.bar_rotations[0][:, 1], scene.bar_rotations[0][:, 2]])
    place = marks.places[:8].mean(axis=0) - 900.0 * rotation[2]
    intrinsics = np.zeros(16)
    intrinsics[:4] = 2319.0, 2319.0, 80.3, 79.6
    station = Station("C01", rotation, -rotation @ place, intrinsics, (160, 160))
    rendered = render_image(scene, marks, station, FLAT, np.random.default_rng(0))
    assert rendered.dots.view_deg.max() < 3.0
    errors = centroid_errors(rendered, paper=0.8 / 0.85 * 0.04)
    assert len(errors) >= 3
    assert np.linalg.norm(errors, axis=1).max() < 0.005
    # on a flat sticker the rim's plane is the surface
    np.testing.assert_allclose(rendered.dots.uv, rendered.dots.uv_rim, atol=1e-9)
    # a white surface has 80 % of full scale
    u, v = np.rint(rendered.dots.uv[0]).astype(int)
    assert rendered.exposure[v, u] == pytest.approx(0.8, abs=1e-3)


def test_the_rim_lies_below_the_surface(simulated) -> None:
    _, truth = simulated
    dots = ball_dots(truth.ball, 1.5, 14.0)
    depth = ((dots.places - dots.rims.mean(axis=1)) * dots.normals).sum(axis=1)
    np.testing.assert_allclose(depth, 1.5**2 / (2 * truth.ball.radius_mm), rtol=0.15)
    np.testing.assert_allclose(np.linalg.norm(dots.rims - dots.places[:, None], axis=2), 1.5, rtol=1e-3)


def test_unwrapping_is_the_inverse_of_wrapping(simulated) -> None:
    session, truth = simulated
    ball = truth.ball
    scene = ball_scene(truth, target_set(session), 0, FLAT)
    flat = np.random.default_rng(0).uniform(-14, 14, (50, 2))
    for s in (0, 57, 199):
        n, _ = wrap(ball.radius_mm, ball.bumps, np.tile(ball.frames[s], (50, 1, 1)), flat)
        back = np.array([flatten(scene, s, *direction) for direction in n])
        np.testing.assert_allclose(back, flat, atol=1e-6)


def test_rays_go_through_the_whole_lens_model() -> None:
    c = np.array([2300, 2310, 1000, 700, -0.1, 0.08, 4e-4, -3e-4, -0.02, 0.01, 0.005, 0.001, 2e-4, 1e-4, -2e-4, 5e-5])
    for u, v in [(0.0, 0.0), (2063.0, 1543.0), (1000.0, 700.0), (50.0, 1500.0)]:
        x, y = ideal_place(c, u, v, 0.0, 0.0)
        np.testing.assert_allclose(project(np.array([[x, y, 1.0]]), c)[0], [u, v], atol=1e-8)


def test_rays_go_through_the_fisheye_model() -> None:
    c = fisheye_vector(np.array([[925.0, 0, 1036.0], [0, 925.5, 765.0], [0, 0, 1]]), [0.03, 0.004, -0.002, 0.0003])
    x = y = 0.0
    for u, v in [(-0.5, -0.5), (1036.0, 765.0), (1036.0, 764.0), (2063.5, 1543.5), (50.0, 1500.0)]:
        x, y = ideal_place(c, u, v, x, y)
        np.testing.assert_allclose(project(np.array([[x, y, 1.0]]), c)[0], [u, v], atol=1e-8)


def test_a_fisheye_lens_shows_dots_where_the_truth_says() -> None:
    rendered = ball_image(simulate_session("wide150", 0, RENDERED), FLAT, camera=0, size=400)
    errors = centroid_errors(rendered, paper=0.8 / 0.85 * 0.04)
    assert len(errors) >= 10
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.001


def test_dots_in_the_outer_field_of_a_fisheye_lens_have_their_truth() -> None:
    """They are 65 degrees off the axis, where a lens of the other model has no image."""
    lens = fisheye_vector(np.array([[985.0, 0, 1031.5], [0, 985.0, 771.5], [0, 0, 1]]), [])
    way = np.array([0.8 * np.sin(np.deg2rad(65.0)), 0.6 * np.sin(np.deg2rad(65.0)), np.cos(np.deg2rad(65.0))])
    place = 1000.0 * way
    rim = np.tile(place, (1, 32, 1))
    dot = TrueDots(np.array([1]), np.array([0]), place[None], -way[None], rim, np.tile(place, (1, 4, 1)))
    outlines = outline_dots(dot, Station("C01", np.eye(3), np.zeros(3), lens, (2064, 1544)))
    assert list(outlines.dot) == [0]


@pytest.mark.parametrize(
    ("psf", "variance_px2"),
    [(Psf("gaussian", 0.65), 0.65**2), (Psf("gaussian", 2.0), 4.0), (Psf("disc", 1.5), 1.5**2 / 4)],
)
def test_kernels_are_centred_and_as_wide_as_they_should_be(psf: Psf, variance_px2: float) -> None:
    kernel = pixel_kernel(psf)
    place = (np.arange(len(kernel)) + 0.5 - len(kernel) / 2) / CELLS
    for axis in (0, 1):
        profile = kernel.sum(axis=axis)
        assert profile.sum() == pytest.approx(1.0)
        assert profile @ place == pytest.approx(0.0, abs=1e-4)
        # the pixel adds 1/12, the cells take their own 1/192 (cell values are means)
        assert profile @ place**2 == pytest.approx(variance_px2 + 1 / 12, rel=0.02)


def test_coma_is_lopsided_but_centred() -> None:
    kernel = pixel_kernel(Psf("coma", 0.6))
    place = (np.arange(len(kernel)) + 0.5 - len(kernel) / 2) / CELLS
    profile = kernel.sum(axis=0)
    assert profile @ place == pytest.approx(0.0, abs=1e-3)
    assert profile @ place**3 > 0.1
    assert len(separable(kernel)) > 1


def test_gathering_is_a_convolution_at_the_pixels() -> None:
    rng = np.random.default_rng(0)
    kernel = pixel_kernel(Psf("coma", 0.3))
    cells = rng.random((24 * CELLS, 32 * CELLS)).astype(np.float32)
    image = np.zeros((8, 16), np.float32)
    for column, row in separable(kernel):
        gather(cells, column, row, 8, image)
    for i, j in [(0, 0), (7, 15), (3, 8)]:
        top, left = ((8 + k) * CELLS + CELLS // 2 - len(kernel) // 2 for k in (i, j))
        direct = (kernel * cells[top : top + len(kernel), left : left + len(kernel)]).sum()
        assert image[i, j] == pytest.approx(direct, abs=1e-5)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_bit_depths(bits: int) -> None:
    exposure = np.tile(np.linspace(0, 1.2, 500, dtype=np.float32), (4, 1))
    image = expose(exposure, Sensor(bits=bits, noise=False), np.random.default_rng(0))
    assert image.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert image.max() == 2**bits - 1
    assert (np.diff(image[0].astype(int)) >= 0).all()
    high = expose(exposure, Sensor(bits=bits, noise=False, high_bits=True), np.random.default_rng(0))
    if 8 < bits < 16:
        assert np.array_equal(high >> (16 - bits), image)


def test_noise_is_shot_and_read_noise() -> None:
    rng = np.random.default_rng(0)
    for level in (0.0, 0.1, 0.7):
        image = expose(np.full((300, 300), level, np.float32), Sensor(bits=16), rng).astype(float)
        electrons = (image / 65535 - 0.01) * 10_500
        assert electrons.mean() == pytest.approx(level * 10_500, abs=1.0)
        assert electrons.var() == pytest.approx(level * 10_500 + 2.5**2, rel=0.03)


def test_the_same_seed_gives_the_same_image(simulated) -> None:
    settings = RenderSettings(blobs=100, specks=1.0, scratches=0.5, arm=True)
    first, again = (ball_image(simulated, settings, seed=3, size=SMALL).image for _ in range(2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, ball_image(simulated, settings, seed=4, size=SMALL).image)


def test_polarity_defocus_exposure_and_gloss(simulated) -> None:
    session, _ = simulated

    def image(settings: RenderSettings, targets: TargetSet | None = None) -> Rendered:
        return ball_image(simulated, settings, targets, size=SMALL)

    plain = image(FLAT)
    dark = image(FLAT, replace(target_set(session), polarity="dark-on-light"))
    u, v = np.rint(plain.dots.uv[plain.dots.fully_visible][0]).astype(int)
    assert plain.exposure[v, u] > 0.7 and dark.exposure[v, u] < 0.1
    soft = image(replace(FLAT, psf=Psf("disc", 3.5)))
    assert (soft.exposure > 0.7).sum() < 0.5 * (plain.exposure > 0.7).sum()
    assert image(replace(FLAT, exposure=4.0)).image.max() == 65535
    lit = RenderSettings(sensor=Sensor(noise=False), gloss=0.0)
    glossy = image(replace(lit, gloss=0.3)).exposure - image(lit).exposure
    assert glossy.min() >= -1e-6 and glossy.max() > 0.05
    of_one = replace(FLAT, psf_of={"C08": Psf("disc", 3.5)})
    assert np.array_equal(image(of_one).image, soft.image)


def test_an_arm_and_dirt_hide_dots(simulated) -> None:
    clean = ball_image(simulated, FLAT)
    arm = ball_image(simulated, replace(FLAT, arm=True))
    assert len(arm.dots) == len(clean.dots)
    assert 0 < arm.dots.fully_visible.sum() < clean.dots.fully_visible.sum()
    shown = arm.dots.fully_visible
    for u, v in np.rint(arm.dots.uv[shown]).astype(int):
        assert arm.exposure[v, u] > 0.5
    dirty = ball_image(simulated, replace(FLAT, specks=6.0, scratches=1.0))
    change = np.abs(dirty.exposure - clean.exposure)
    assert 0.001 < (change > 0.02).mean() < 0.2


def isolated(dots: DotTruth) -> np.ndarray:
    return dots.fully_visible & (dots.gap_px > 6.0) & np.isfinite(dots.bound_px) & (dots.view_deg < 45.0)


def test_bounds_follow_the_rule_of_thumb_and_the_light(simulated) -> None:
    sensor = Sensor(bits=16, read_noise_e=0.0, noise=False)
    little = ball_image(simulated, replace(FLAT, sensor=sensor, bounds=dot_bounds)).dots
    much = ball_image(simulated, replace(FLAT, sensor=replace(sensor, full_well_e=42_000.0), bounds=dot_bounds)).dots
    some = isolated(little)
    assert some.sum() > 20
    np.testing.assert_allclose(little.bound_px[some] / much.bound_px[some], 2.0, rtol=0.02)
    # sigma = noise / contrast * 2 sqrt(blur / (sqrt(pi) r)), noise at the middle of the rim
    noise = np.sqrt(0.42 / 10_500)
    radius = little.axes_px[some].mean(axis=1) / 2
    thumb = noise / 0.76 * 2 * np.sqrt(np.hypot(0.65, 1 / np.sqrt(12)) / (np.sqrt(np.pi) * radius))
    np.testing.assert_allclose(little.bound_px[some] / thumb, 1.0, atol=0.3)


@pytest.fixture(scope="module")
def rendered_folder(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("render") / "session"
    truth = render_session("demo", 2, folder, options=replace(RENDERED, placements=1, bar_poses=1))
    return folder, truth


def test_a_rendered_session_can_be_read(rendered_folder) -> None:
    folder, truth = rendered_folder
    session = read_session(folder)
    assert session.observations is None
    assert len(session.placements[0].images) == 6 and len(session.bar_poses) == 2
    with (folder / "truth_dots.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["placement"] for row in rows} == {"P1", "A-01", "B-01"}
    marks = {int(row["target"]) for row in rows if row["placement"] == "A-01"}
    assert marks == set(truth.bars[0].targets)
    import cv2

    for row in rows[::50]:
        if row["fully_visible"] == "1" and float(row["view_deg"]) < 50:
            place = "placements" if row["placement"] == "P1" else "bars"
            image = cv2.imread(str(folder / place / row["placement"] / f"{row['camera']}.png"), cv2.IMREAD_UNCHANGED)
            u, v = round(float(row["u"])), round(float(row["v"]))
            around = image[max(v - 12, 0) : v + 13, max(u - 12, 0) : u + 13]
            assert int(image[v, u]) > np.median(around)


def test_cancelling_leaves_nothing_and_bad_options_are_told(tmp_path) -> None:
    with pytest.raises(Cancelled):
        render_session("demo", 2, tmp_path / "out", Context(is_cancelled=lambda: True))
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError):
        render_session("demo", 2, tmp_path / "out", options=replace(RENDERED, shape_change_mm=0.1))


def test_the_demo_is_rendered_once(tmp_path, monkeypatch) -> None:
    calls = []

    def render(_preset, _seed, folder, *_) -> None:
        calls.append(folder)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "session.json").write_text("{}")

    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path)
    monkeypatch.setattr("spherecal_sim.render_session.render_session", render)
    first = demo_session()
    assert demo_session() == first and (first / "session.json").exists()
    assert len(calls) == 1 and list(tmp_path.iterdir()) == [first]
