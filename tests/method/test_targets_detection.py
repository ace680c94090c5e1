"""The detector on drawn stickers and rendered crops: who is found, where, and what is refused."""

import struct
import zlib
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from spherecal.base.errors import InputError
from spherecal.geometry.camera import project
from spherecal.targets.detect_images import detect_images
from spherecal.targets.detection import Detections, DetectionSettings, Detector
from spherecal.targets.family import DOTS, make_target_set
from spherecal.targets.images import read_image
from spherecal.targets.looks import looks_of
from spherecal.targets.target_set import TargetSet
from spherecal_sim.dot_truth import Station, ball_dots
from spherecal_sim.render_session import RENDERED, Rendered, render_image
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.simulated_scene import RenderSettings, ball_scene, lit_for

FINE = 8  # cells a pixel in drawings
GROUND, PAPER, DOT = 60.0, 18.0, 185.0
PITCH_PX = 120
TARGETS = make_target_set(200)
DETECTOR = Detector(TARGETS)
FAR = DetectionSettings(focal_px=50_000.0)  # drawings have no perspective

Image = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class Drawing:
    """Stickers drawn flat: light (h, w) in grey without noise, ids (n,), dots (n, 8, 2) px."""

    light: NDArray[np.float64]
    ids: list[int]
    uv: NDArray[np.float64]

    def image(self, seed: int = 0, gain: float = 1.0) -> NDArray[np.uint8]:
        return np.clip(np.rint(noisy(gain * self.light, seed)), 0, 255).astype(np.uint8)


def noisy(light: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """With the noise of a sensor of 10 ke- at 255 grey."""
    return light + np.random.default_rng(seed).normal(size=light.shape) * np.sqrt(0.05 + light * 255 / 1e4)


def view_of(tilt_deg: float, turn_deg: float, px_per_mm: float = 3.0) -> NDArray[np.float64]:
    """Affine map (2, 2) px/mm of a sticker tilted about its x axis, then turned."""
    c, s = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    return px_per_mm * np.array([[c, -s], [s, c]]) @ np.diag([1.0, np.cos(np.deg2rad(tilt_deg))])


def drawn(
    ids: list[int],
    views: list[NDArray[np.float64]],
    without: tuple[str, ...] = (),
    blur_px: float = 0.65,
    targets: TargetSet = TARGETS,
    columns: int = 3,
    specks_mm: tuple[tuple[float, float], ...] = (),
) -> Drawing:
    """Stickers on a grid, each with its own view; `specks_mm` are dots that no target has, on every sticker."""
    rows = -(-len(ids) // columns)
    size = (rows * PITCH_PX, columns * PITCH_PX)
    canvas = np.full((size[0] * FINE, size[1] * FINE), GROUND, np.float32)
    uv = np.full((len(ids), 8, 2), np.nan)
    dark = targets.polarity == "dark-on-light"
    circle = 1.5 * np.column_stack([f(np.linspace(0, 2 * np.pi, 48, endpoint=False)) for f in (np.cos, np.sin)])
    corners = 14.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for i, (target, view) in enumerate(zip(ids, views, strict=True)):
        middle = PITCH_PX * (np.array([i % columns, i // columns]) + 0.5) + np.array([0.31, -0.17]) * (i + 1)
        fill(canvas, middle + corners @ view.T, DOT if dark else PAPER)
        for k, name in enumerate(DOTS):
            place = targets.layouts[target][name]
            uv[i, k] = middle + view @ place
            if name not in without:
                fill(canvas, uv[i, k] + circle @ view.T, PAPER if dark else DOT)
        for speck in specks_mm:
            fill(canvas, middle + view @ np.array(speck) + circle @ view.T, DOT)
    light = cv2.resize(canvas, size[::-1], interpolation=cv2.INTER_AREA).astype(float)
    return Drawing(np.asarray(cv2.GaussianBlur(light, (0, 0), blur_px), dtype=float), ids, uv)


def fill(canvas: NDArray[np.float32], outline: NDArray[np.float64], grey: float) -> None:
    """A polygon (n, 2) given in px, drawn on the fine canvas to 1/16 of a cell."""
    fine = np.rint(((outline + 0.5) * FINE - 0.5) * 16).astype(np.int32)
    cv2.fillPoly(canvas, [fine], grey, shift=4)


def nine(
    without: tuple[str, ...] = (), targets: TargetSet = TARGETS, specks_mm: tuple[tuple[float, float], ...] = ()
) -> Drawing:
    """Nine stickers, tilted by 0 to 56 degrees."""
    views = [view_of(7.0 * i, 37.0 * i) for i in range(9)]
    return drawn(list(range(11, 20)), views, without, targets=targets, specks_mm=specks_mm)


def dots_of(found: Detections, target: int) -> dict[str, NDArray[np.float64]]:
    return {found.points[found.point[i]]: found.uv[i] for i in np.flatnonzero(found.target == target)}


def largest_error(found: Detections, drawing: Drawing) -> float:
    """The largest distance in px of a dot from where it was drawn; fails for an id that was not."""
    return max(
        float(np.hypot(*(uv - drawing.uv[drawing.ids.index(target), DOTS.index(name)])))
        for target in found.target_ids.tolist()
        for name, uv in dots_of(found, target).items()
    )


# --- centres -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def rendered() -> Rendered:
    """A crop of the ball of rig A, seen up to 70 degrees, as the renderer's own tests take it."""
    session, truth = simulate_session("rigA", 0, RENDERED)
    targets = session.target_set
    assert targets is not None
    settings = RenderSettings()
    camera = truth.cameras[7]
    scene = lit_for(ball_scene(truth, targets, 0, settings), truth, 7, settings)
    dots = ball_dots(truth.ball, targets.dot_diameter_mm / 2, targets.size_mm / 2)
    dots = dots.moved(truth.ball_rotations[0], truth.ball_places_mm[0])
    middle = project((truth.ball_places_mm[0] @ camera.rotation.T + camera.translation_mm)[None], camera.intrinsics)[0]
    intrinsics = camera.intrinsics.copy()
    intrinsics[2:4] -= np.rint(middle) + np.array([60, -300])  # from its middle to its limb
    station = Station(camera.id, camera.rotation, camera.translation_mm, intrinsics, (600, 600))
    return render_image(scene, dots, station, settings, np.random.default_rng(0))


def test_centres_and_uncertainties_against_rendered_truth(rendered: Rendered) -> None:
    found = DETECTOR.detect(rendered.image, DetectionSettings(focal_px=2319.0))  # nominal, as a session gives it
    truth = rendered.dots
    place = {(int(t), int(p)): i for i, (t, p) in enumerate(zip(truth.target, truth.point, strict=True))}
    names = simulate_session("rigA", 0, RENDERED)[1].ball.points
    rows = np.array(
        [place[int(t), names.index(found.points[p])] for t, p in zip(found.target, found.point, strict=True)]
    )
    error = found.uv - truth.uv_rim[rows]
    distance = np.linalg.norm(error, axis=1)
    assert distance.max() < 0.2
    for (low, high), most_px in zip(pairwise((0, 45, 55, 65)), (0.009, 0.012, 0.016), strict=True):
        band = np.sort(distance[(truth.view_deg[rows] >= low) & (truth.view_deg[rows] < high)])
        assert len(band) >= 10
        assert np.sqrt((band[: int(0.98 * len(band))] ** 2).mean()) < most_px
    assert 0.75 < np.std(error / found.sigma_uv) < 1.25
    whole = [
        t
        for t in np.unique(truth.target)
        if (truth.target == t).sum() == 8
        and truth.fully_visible[truth.target == t].all()
        and truth.view_deg[truth.target == t].max() < 65
    ]
    assert set(whole) <= set(found.target_ids)


def test_tilt_and_blur_are_told() -> None:
    found = DETECTOR.detect(nine().image(), FAR)
    assert found.tilt_deg == pytest.approx([7.0 * i for i in range(9)], abs=3.0)
    assert np.median(found.blur_px) == pytest.approx(np.hypot(0.65, np.sqrt(1 / 12)), abs=0.05)
    assert found.misfit.max() < 1.6


# --- what images may be like -------------------------------------------------------------------------------------


def test_dark_dots_on_light_paper() -> None:
    targets = make_target_set(200, polarity="dark-on-light")
    drawing = nine(targets=targets)
    found = Detector(targets).detect(drawing.image(), FAR)
    assert found.target_ids.tolist() == drawing.ids
    assert largest_error(found, drawing) < 0.06
    assert len(DETECTOR.detect(drawing.image(), FAR)) == 0  # not the set's polarity


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
@pytest.mark.parametrize("high", [False, True])
def test_significant_bits_low_or_high(bits: int, high: bool) -> None:
    drawing = nine()
    scale = (2**bits - 1) / 255
    counts = np.clip(np.rint(noisy(drawing.light, 0) * scale), 0, 2**bits - 1).astype(np.uint16)
    found = DETECTOR.detect(counts << (16 - bits) if high else counts, FAR)
    assert found.target_ids.tolist() == drawing.ids
    assert len(found) == 72
    assert largest_error(found, drawing) < 0.06


def test_faint_light_in_eight_bits() -> None:
    drawing = nine()
    found = DETECTOR.detect(drawing.image(gain=0.1), FAR)
    assert found.target_ids.tolist() == drawing.ids
    assert np.linalg.norm(found.sigma_uv, axis=1).max() < 0.2


def test_saturated_dots_keep_their_centres() -> None:
    drawing = nine()
    image = drawing.image(gain=4.0)
    assert (image == 255).sum() > 72 * 20
    found = DETECTOR.detect(image, FAR)
    assert found.target_ids.tolist() == drawing.ids
    assert largest_error(found, drawing) < 0.08


def test_a_shine_that_slopes_over_stickers_shifts_no_dots() -> None:
    """As of a film beside its highlight: the same light on paper and dots. Left out it shifts all by 0.02 px."""
    drawing = nine()
    ramp = 0.2 * np.arange(drawing.light.shape[1])
    without, within = (
        DETECTOR.detect(np.rint(200 * (0.6 * drawing.light + shine)).astype(np.uint16), FAR) for shine in (0.0, ramp)
    )
    assert len(without) == len(within) == 72
    assert np.abs((within.uv - without.uv).mean(axis=0)).max() < 0.002


def test_raw_bayer_pixels(tmp_path: Path) -> None:
    drawing = nine()
    gains = np.tile([[0.55, 1.0], [1.0, 0.7]], (drawing.light.shape[0] // 2, drawing.light.shape[1] // 2))
    cv2.imwrite(str(tmp_path / "raw.png"), np.rint(noisy(drawing.light * gains, 0)).astype(np.uint8))
    found = DETECTOR.detect(read_image(tmp_path / "raw.png"), FAR)
    assert found.target_ids.tolist() == drawing.ids
    assert largest_error(found, drawing) < 0.08


def test_colour_image(tmp_path: Path) -> None:
    drawing = nine()
    cv2.imwrite(str(tmp_path / "colour.png"), cv2.cvtColor(drawing.image(), cv2.COLOR_GRAY2BGR))
    found = DETECTOR.detect(read_image(tmp_path / "colour.png"), FAR)
    assert found.target_ids.tolist() == drawing.ids


# --- dots that are not there, or not alone -----------------------------------------------------------------------


@pytest.mark.parametrize("lost", DOTS)
def test_seven_of_eight_dots_are_enough(lost: str) -> None:
    drawing = nine(without=(lost,))
    found = DETECTOR.detect(drawing.image(), FAR)
    assert found.target_ids.tolist() == drawing.ids
    assert all(set(dots_of(found, target)) == set(DOTS) - {lost} for target in drawing.ids)
    assert largest_error(found, drawing) < 0.06


@pytest.mark.parametrize("lost", [("A", "M1"), ("M1", "M2"), ("B", "C")])
def test_six_dots_are_not(lost: tuple[str, str]) -> None:
    assert len(DETECTOR.detect(nine(without=lost).image(), FAR)) == 0


def test_seven_dots_that_two_codes_have_are_refused() -> None:
    """Two targets that share two code dots, as a set of one's own may have: only all eight dots tell them apart."""
    layouts = {target: dict(TARGETS.layouts[11]) for target in (1, 2)}
    taken = np.array([*layouts[1].values()])
    lattice = 2.5 * np.stack(np.meshgrid(np.arange(-4, 5), np.arange(-4, 5)), axis=-1).reshape(-1, 2)
    free = [place for place in lattice if np.linalg.norm(taken - place, axis=1).min() >= 5.0]
    layouts[2]["M3"] = free[0]
    targets = replace(TARGETS, layouts=layouts)
    detector = Detector(targets)
    views = [view_of(20.0, 30.0), view_of(35.0, 100.0)]
    whole = drawn([1, 2], views, targets=targets)
    assert detector.detect(whole.image(), FAR).target_ids.tolist() == [1, 2]
    for lost, known in (("M3", []), ("M1", [1, 2]), ("B", [1, 2])):
        found = detector.detect(drawn([1, 2], views, without=(lost,), targets=targets).image(), FAR)
        assert found.target_ids.tolist() == known


def test_a_speck_in_place_of_a_lost_dot_makes_no_other_code() -> None:
    rng = np.random.default_rng(3)
    for seed in range(12):
        speck = (float(rng.uniform(-11.5, 11.5)), float(rng.uniform(-11.5, 11.5)))
        lost = tuple(rng.permutation(DOTS[5:])[: 1 + seed % 2].tolist())
        drawing = nine(without=lost, specks_mm=(speck,))
        assert set(DETECTOR.detect(drawing.image(seed), FAR).target_ids.tolist()) <= set(drawing.ids)


def test_covered_targets_are_missing_and_others_untouched() -> None:
    drawing = nine()
    image = drawing.image()
    cv2.line(image, (0, 190), (359, 165), 95, 70)  # an arm over the middle row
    found = DETECTOR.detect(image, FAR)
    assert set(drawing.ids[:3] + drawing.ids[6:]) <= set(found.target_ids.tolist())
    assert not set(drawing.ids[3:6]) & set(found.target_ids.tolist())
    assert largest_error(found, drawing) < 0.1


def test_scratches_neither_hide_nor_shift_a_target() -> None:
    drawing = nine()
    image = drawing.image()
    for i in range(9):  # from each sticker's A to its C, as bright as the dots
        a, c = np.rint(drawing.uv[i, [0, 2]]).astype(int).tolist()
        cv2.line(image, a, c, 150, 1, cv2.LINE_AA)
    found = DETECTOR.detect(image, FAR)
    assert set(found.target_ids.tolist()) == set(drawing.ids)
    untouched = [i for i in range(len(found)) if found.points[found.point[i]] not in "ACD"]
    error = [
        np.hypot(*(found.uv[i] - drawing.uv[drawing.ids.index(found.target[i]), found.point[i]])) for i in untouched
    ]
    assert np.median(error) < 0.03
    assert largest_error(found, drawing) < 1.0


def test_dots_that_blur_joins_at_steep_angles() -> None:
    ids = [21, 22, 23, 24, 25, 26]
    drawing = drawn(ids, [view_of(68.0, 40.0 * i, 2.9) for i in range(6)], blur_px=0.85)
    found = DETECTOR.detect(drawing.image(), FAR)
    assert set(ids) == set(found.target_ids.tolist())
    assert largest_error(found, drawing) < 0.25


# --- no targets --------------------------------------------------------------------------------------------------


def test_clutter_between_the_targets() -> None:
    drawing = nine()
    rng = np.random.default_rng(5)
    middles = drawing.uv.mean(axis=1)
    light = drawing.light.copy()
    for place in rng.uniform(0, 360, (600, 2)):
        if np.linalg.norm(middles - place, axis=1).min() > 68:
            cv2.circle(light, np.rint(place).astype(int).tolist(), int(rng.integers(2, 7)), DOT, -1, cv2.LINE_AA)
    found = DETECTOR.detect(replace(drawing, light=light).image(), FAR)
    assert found.target_ids.tolist() == drawing.ids


def test_random_clusters_of_dots_are_no_targets() -> None:
    """900 clusters of 7 to 14 dots, as large and as dense as stickers."""
    rng = np.random.default_rng(11)
    every = Detector(make_target_set(344))
    circle = 1.5 * np.column_stack([f(np.linspace(0, 2 * np.pi, 24, endpoint=False)) for f in (np.cos, np.sin)])
    for seed in range(9):
        canvas = np.full((1000, 1000), PAPER, np.float32)
        for cell in range(100):
            middle = 100.0 * np.array([cell % 10, cell // 10]) + 50
            view = view_of(rng.uniform(0, 65), rng.uniform(0, 360), 2.7)
            for place in dense_places(rng, int(rng.integers(7, 15))):
                outline = np.rint((middle + (place + circle) @ view.T) * 16).astype(np.int32)
                cv2.fillPoly(canvas, [outline], DOT, cv2.LINE_AA, 4)
        image = Drawing(cv2.GaussianBlur(canvas, (0, 0), 0.7).astype(float), [], np.zeros((0, 8, 2))).image(seed)
        assert every.detect(image, FAR).target_ids.tolist() == []


def dense_places(rng: np.random.Generator, count: int) -> list[NDArray[np.float64]]:
    """Places in mm on a sticker, at least 4 mm apart."""
    places: list[NDArray[np.float64]] = []
    while len(places) < count:
        place = rng.uniform(-11.5, 11.5, 2)
        if all(np.hypot(*(place - other)) > 4.0 for other in places):
            places.append(place)
    return places


@pytest.mark.parametrize("shape", [(1, 1), (3, 200), (7, 9), (72, 72), (73, 401)])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_images_without_targets(shape: tuple[int, int], kind: type) -> None:
    rng = np.random.default_rng(0)
    top = np.iinfo(kind).max
    for image in (np.zeros(shape, kind), np.full(shape, top, kind), rng.integers(0, top, shape).astype(kind)):
        found = DETECTOR.detect(image, FAR)
        assert len(found) == len(found.target_ids) == 0
        assert found.uv.shape == found.sigma_uv.shape == (0, 2)


# --- files, and the same again -----------------------------------------------------------------------------------


def test_absurd_sizes_are_refused_before_decoding(tmp_path: Path) -> None:
    header = struct.pack(">IIBBBBB", 200_000, 100_000, 8, 0, 0, 0, 0)  # 20 gigapixels in a file of 60 bytes
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(b"\0")), (b"IEND", b"")]
    data = b"".join(struct.pack(">I", len(d)) + n + d + struct.pack(">I", zlib.crc32(n + d)) for n, d in chunks)
    (tmp_path / "huge.png").write_bytes(b"\x89PNG\r\n\x1a\n" + data)
    cv2.imwrite(str(tmp_path / "tiny.png"), np.zeros((20, 20), np.uint8))
    for name in ("huge.png", "tiny.png"):
        with pytest.raises(InputError, match=name):
            read_image(tmp_path / name)


def test_same_image_same_bits_with_any_number_of_workers(tmp_path: Path) -> None:
    paths = []
    for i in range(4):
        paths.append(tmp_path / f"{i}.png")
        cv2.imwrite(str(paths[-1]), nine().image(i))
    runs = [detect_images(paths, TARGETS, workers=workers, settings=[FAR] * len(paths)) for workers in (1, 2, 4)]
    runs.append([Detector(TARGETS).detect(read_image(path), FAR) for path in reversed(paths)][::-1])
    for run in runs[1:]:
        for one, other in zip(runs[0], run, strict=True):
            assert len(one) == 72
            for name in ("target", "point", "uv", "sigma_uv", "target_ids", "misfit", "tilt_deg", "blur_px"):
                assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


# --- clutter and looks ---------------------------------------------------------------------------------------------


def test_stickers_among_many_dots_are_found_where_they_are_drawn() -> None:
    rim = [(16.5 * s, 4.1 * k) for s in (-1.0, 1.0) for k in range(-4, 5)]
    specks = tuple(rim + [(y, x) for x, y in rim if abs(y) < 16])
    plain, cluttered = nine(), nine(specks_mm=specks)
    found = DETECTOR.detect(cluttered.image(), FAR)
    assert found.target_ids.tolist() == plain.ids
    assert largest_error(found, cluttered) < 0.1


@pytest.mark.parametrize("bits", [8, 16])
def test_ground_of_a_blob_is_the_median_of_16_pixels_around_it(bits: int) -> None:
    rng = np.random.default_rng(bits)
    dtype = np.uint8 if bits == 8 else np.uint16
    image = rng.integers(0, 4 if bits == 8 else 65536, (64, 64)).astype(dtype)  # many equal pixels, and none
    uv = rng.uniform(20, 44, (40, 2))
    variance = 4.0
    rows = np.column_stack([uv, np.tile([variance, 0.0, variance, 40.0, 70000.0], (40, 1))])
    looks = looks_of(image, rows)
    radius = 3.4 * np.sqrt(variance) + 1.0
    angle = np.pi / 8 * np.arange(16)
    around = uv[:, None] + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    u, v = np.floor(around + 0.5).astype(int).transpose(2, 0, 1)
    assert np.array_equal(looks.ground, np.median(image[v, u], axis=1))
    assert np.array_equal(looks.contrast, 70000.0 - looks.ground)
