"""The stress table: cases of poor images, and what the prototype of November 2026 reached in each (its own images)."""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from benchmarks.simulators.dot_bound import dot_bounds
from spherecal.geometry.rotation import exp_rotation
from spherecal_sim.dot_truth import ball_dots
from spherecal_sim.optics import Image, Psf, Sensor, expose
from spherecal_sim.render_session import CLUTTERED, RENDERED, Rendered, render_image
from spherecal_sim.rigs import CameraKind
from spherecal_sim.simulated_scene import RenderSettings
from spherecal_sim.tracing import PAPER
from spherecal_sim.truth import SimulationOptions

from .detection_scenes import THREE_MP, THREE_MP_DISTANCE_MM, View, aimed_view

BANDS = ((0, 30), (30, 45), (45, 55), (55, 60), (60, 65), (65, 70), (70, 75))


@dataclass(frozen=True)
class Case:
    """A way to make images, and the prototype's recall in the bands and its errors at 0-55 and 55-70 degrees, px."""

    name: str
    settings: RenderSettings = CLUTTERED
    prototype: str = ""
    prototype_px: str = ""
    focal_mm: float = THREE_MP.focal_length_mm
    distance_mm: float = THREE_MP_DISTANCE_MM
    options: SimulationOptions = RENDERED
    streak_px: float = 0.0
    paper: float | None = None
    jpeg: int = 0
    upsampled: bool = False
    centred: bool = False  # the mean shift of each image is taken out: that of the lens, not of the detector

    @property
    def kind(self) -> CameraKind:
        """The camera."""
        return replace(THREE_MP, focal_length_mm=self.focal_mm)

    def view(self, image: int) -> View:
        """The view of one of the case's images: a ball and a lens of its own, seen by one of rig A's cameras."""
        return aimed_view(
            100 + image, self.kind, self.distance_mm, image % 4, (3 * image + 2) % 10, self.options, _aside(image)
        )

    def render(self, image: int, with_bounds: bool = False) -> Rendered:
        """One of the case's images with its truth, in pixels of the image given."""
        view, settings = self.view(image), replace(self.settings, bounds=dot_bounds if with_bounds else None)
        if self.streak_px:
            rendered = _shaken(view, self.settings, self.streak_px, image)
        elif self.paper is not None:
            rendered = _on_paper(view, settings, self.paper, image)
        else:
            rendered = view.render(settings, image)
        return replace(rendered, image=_compressed(rendered.image, self.jpeg)) if self.jpeg else rendered


def _aside(image: int) -> tuple[float, float]:
    """Where in the image the ball lies."""
    turns = np.array([0.7549, 0.5698]) * image  # spreads any number of places evenly
    u, v = 0.5 * (2 * (turns % 1) - 1)
    return float(u), 0.4 * float(v)


def _shaken(view: View, settings: RenderSettings, streak_px: float, seed: int) -> Rendered:
    """An image with a straight streak; the truth is that of the middle of the exposure."""
    steps = int(np.ceil(streak_px / 0.4)) | 1
    station = view.station
    scene = view.scene(settings)
    dots = ball_dots(view.truth.ball, view.targets.dot_diameter_mm / 2, view.targets.size_mm / 2)
    dots = dots.moved(view.truth.ball_rotations[view.placement], view.truth.ball_places_mm[view.placement])
    rng = np.random.default_rng(seed)
    parts = []
    for step in (np.arange(steps) - (steps - 1) / 2) / steps:
        angle = step * streak_px / station.intrinsics[0]
        turn = exp_rotation(np.array([[0.6 * angle, 0.8 * angle, 0.0]]))[0]
        turned = replace(station, rotation=turn @ station.rotation, translation_mm=turn @ station.translation_mm)
        parts.append(render_image(scene, dots, turned, settings, rng))
    exposure = np.asarray(np.mean([part.exposure for part in parts], axis=0), dtype=np.float32)
    return Rendered(expose(exposure, settings.sensor, rng), exposure, parts[steps // 2].dots)


def _on_paper(view: View, settings: RenderSettings, albedo: float, seed: int) -> Rendered:
    """An image of stickers whose black is grey."""
    scene = view.scene(settings)
    albedos = scene.albedos.copy()
    albedos[PAPER] = albedo
    dots = ball_dots(view.truth.ball, view.targets.dot_diameter_mm / 2, view.targets.size_mm / 2)
    dots = dots.moved(view.truth.ball_rotations[view.placement], view.truth.ball_places_mm[view.placement])
    rng = np.random.default_rng(seed)
    return render_image(scene._replace(albedos=albedos), dots, view.station, settings, rng)


def _compressed(image: Image, quality: int) -> Image:
    """The image after JPEG compression."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def _with(**changes: object) -> RenderSettings:
    return replace(CLUTTERED, **changes)


def _blurred(sigma: float) -> RenderSettings:
    return _with(psf=Psf("gaussian", sigma))


_SMALL_MM = 1240.0  # dots of 4.4 and 2.8 px with 5 and 3.2 mm
NOMINAL = Case("nominal", CLUTTERED, "13/13 19/19 20/20 6/8 12/12 4/10 11/23", "0.010 0.017")

# The prototype's last band of the first block is that of its best single threshold, in the table of recall.
AS_BEFORE = (
    NOMINAL,
    Case("defocus sigma 1.0 px", _blurred(1.0), "13/13 19/19 20/20 6/8 11/12 5/10 -", "0.015 0.041"),
    Case("defocus sigma 1.5 px", _blurred(1.5), "13/13 19/19 19/20 5/8 7/12 4/10 -", "0.021 0.107"),
    Case("defocus sigma 2.0 px", _blurred(2.0), "13/13 19/19 16/20 5/8 6/12 3/10 -", "0.038 0.275"),
    Case("defocus sigma 2.5 px", _blurred(2.5), "13/13 19/19 11/20 4/8 3/12 1/10 -", "0.10 0.33"),
    Case("defocus sigma 3.0 px", _blurred(3.0), "13/13 15/19 6/20 2/8 0/12 0/10 -", "0.19 -"),
    Case("exposure x0.30", _with(exposure=0.30), "13/13 19/19 20/20 8/8 12/12 8/10 -", "0.014 0.025"),
    Case("exposure x0.10", _with(exposure=0.10), "13/13 19/19 20/20 8/8 12/12 8/10 -", "0.021 0.047"),
    Case("exposure x0.05, 8 bit", _with(exposure=0.05), "13/13 19/19 19/20 4/8 1/12 0/10 -", "0.034 0.040"),
    Case(
        "exposure x0.05, 12 bit",
        _with(exposure=0.05, sensor=Sensor(bits=12)),
        "13/13 19/19 20/20 4/8 1/12 0/10 -",
        "0.026 0.027",
    ),
    Case(
        "exposure x0.03, gain 33 (300 e- dots)",
        _with(exposure=0.03, sensor=Sensor(gain=33.0)),
        "13/13 19/19 18/20 7/8 12/12 5/10 -",
        "0.033 0.064",
    ),
    Case("exposure x0.015, no gain", _with(exposure=0.015), "0/13 0/19 0/20 0/8 0/12 0/10 -", "- -"),
    Case("over-exposed x2", _with(exposure=2.0), "13/13 19/19 20/20 8/8 12/12 6/10 -", "0.009 0.016"),
    Case("over-exposed x4", _with(exposure=4.0), "12/13 19/19 20/20 7/8 12/12 6/10 -", "0.011 0.028"),
    Case("over-exposed x8", _with(exposure=8.0), "9/13 19/19 17/20 6/8 5/12 2/10 -", "0.015 0.070"),
    Case("gloss x5", _with(gloss=0.25), "6/7 10/10 8/8 5/5 9/9 4/4 4/6", "0.011 -"),
    Case("dust 1 + scratches 1 a sticker", _with(specks=1.0, scratches=1.0), "4/7 7/10 6/8 4/5 9/9 3/4 2/6", "0.081 -"),
    Case("same, prototype with 6 levels", _with(specks=1.0, scratches=1.0), "7/7 10/10 8/8 5/5 9/9 4/4 4/6", "- -"),
    Case("operator's arm", _with(arm=True), "2/2 7/7 7/7 5/5 8/8 4/4 3/5", "0.012 -"),
    Case("white blobs, ambient 0.35", _with(blobs=3000, ambient=0.35), "7/7 10/10 8/8 5/5 9/9 4/4 2/6", "0.009 -"),
    Case("f 5 mm, dots 4.4 px", CLUTTERED, "13/13 19/19 20/20 7/8 10/12 5/12 3/14", "0.013 -", 5.0, _SMALL_MM),
    Case("f 3.2 mm, dots 2.8 px", CLUTTERED, "11/13 17/19 14/20 4/8 0/12 0/12 0/14", "0.031 -", 3.2, _SMALL_MM),
    Case(
        "same, up-sampled twice before",
        CLUTTERED,
        "13/13 19/19 12/20 4/8 5/12 2/12 0/14",
        "- -",
        3.2,
        _SMALL_MM,
        upsampled=True,
    ),
)

FURTHER = (
    Case("disc of confusion, radius 1.2 px", _with(psf=Psf("disc", 1.2))),
    Case("disc of confusion, radius 3 px", _with(psf=Psf("disc", 3.0))),
    Case("coma 0.4 px, its mean shift taken out", _with(psf=Psf("coma", 0.4)), centred=True),
    Case("streak 1.2 px", streak_px=1.2),
    Case("streak 3.4 px", streak_px=3.4),
    Case("little contrast: paper 0.4, dots 0.85", paper=0.4),
    Case("noisy sensor: 2000 e-, 15 e- read", _with(sensor=Sensor(full_well_e=2000.0, read_noise_e=15.0))),
    Case("dots printed 0.1 mm off", options=replace(RENDERED, print_sd_mm=0.1)),
    Case("dots printed 0.2 mm off", options=replace(RENDERED, print_sd_mm=0.2)),
    Case("JPEG quality 90", jpeg=90),
    Case("flat light", _with(lighting="flat", ambient=1.0)),
)


@dataclass(frozen=True)
class Prototype:
    """The prototype's figures of a row: found and count in each band, None where it was not measured."""

    bands: list[tuple[int, int] | None] = field(default_factory=list)
    px: list[str] = field(default_factory=list)


def prototype_of(case: Case) -> Prototype:
    """The figures, taken apart."""
    bands: list[tuple[int, int] | None] = []
    for word in case.prototype.split():
        found, _, count = word.partition("/")
        bands.append((int(found), int(count)) if count else None)
    bands += [None] * (len(BANDS) - len(bands))
    return Prototype(bands, case.prototype_px.split() or ["-", "-"])
