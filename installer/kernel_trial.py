"""Calls every kernel of the engine as the program does, so that installer/kernels.py learns the types of the arguments.

What no trial calls is compiled for no types and runs as plain Python in the bundle, which says so in its log;
`bundle.py` tries the finished bundle with SPHERECAL_KERNELS=strict, where that is an error.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from spherecal.adjust import dense_elimination
from spherecal.cameras.simulated.draw import digitise
from spherecal.cameras.simulated.stage import Stage, StageView
from spherecal.cli.main import main
from spherecal.files.target_set_file import write_target_set
from spherecal.targets.code_book import admissible_triples, clean_margins, lattice
from spherecal.targets.detection import DetectionSettings, Detector
from spherecal.targets.sticker_view import VIEW_SIZE, place_of
from spherecal.targets.target_set import TargetSet
from spherecal_sim.optics import Sensor
from spherecal_sim.render_session import DEMO, render_placement, write_png
from spherecal_sim.scene import RenderSettings
from spherecal_sim.session import simulate_session


def run_all(folder: Path) -> None:
    """All trials, with files in an empty folder; RuntimeError where a command fails."""
    for number, (image, targets) in enumerate(images()):
        detector = Detector(targets)
        detector.detect(image, DetectionSettings(focal_px=1700.0))
        write_png(folder / f"{number}.png", image)
        write_target_set(folder / "targets.json", targets)
    pictures = [str(path) for path in sorted(folder.glob("*.png"))]
    command("detect", *pictures, "--targets", f"{folder}/targets.json", "--csv", f"{folder}/seen.csv")
    command("simulate", "demo", "--observations-only", "-o", f"{folder}/s")
    for method in ("auto", "free", "soft", "tao2021"):
        command("calibrate", f"{folder}/s", "-o", f"{folder}/{method}", "--method", method)
    command("calibrate", f"{folder}/s", "-o", f"{folder}/fixed", "--intrinsics", "fixed")
    with patch.object(dense_elimination, "LEAST_COLUMNS", 1):  # otherwise only rigs of a hundred cameras go that way
        command("calibrate", f"{folder}/s", "-o", f"{folder}/dense", "--method", "rigid")
    places = lattice()
    clean_margins(admissible_triples(places)[:5], places)  # what the code book was made by
    place_of(np.zeros(VIEW_SIZE), np.float64(1.0), np.float64(2.0))  # of doubtful targets only
    command("verify", f"{folder}/s", "--rig", f"{folder}/auto/rig.json", "-o", f"{folder}/auto")


def command(*words: str) -> None:
    """A command in this process."""
    if main(list(words)) not in (0, 3):
        raise RuntimeError(f"spherecal {' '.join(words)} failed in the trial of the kernels")


def images() -> Iterator[tuple[np.ndarray, TargetSet]]:
    """Drawn and rendered images of ball and bar, of 8 and of 16 bits, with their target sets."""
    stage = Stage("demo")
    targets = stage.session.target_set
    assert targets is not None
    for pose in (stage.poses[0], stage.poses[-1]):
        stage.show(pose)
        for rendered in (False, True):
            picture = stage.picture(0, StageView(), rendered)
            for bits in (8, 12):
                yield digitise(picture, bits, 1.0, np.random.default_rng(bits)), targets
    session, truth = simulate_session("demo", 1, DEMO)
    for bits in (8, 12):
        settings = RenderSettings(
            sensor=Sensor(bits=bits), blobs=20, arm=True, specks=0.3, scratches=0.3,
            lighting="rings" if bits == 8 else "flat",
        )  # fmt: skip
        shown = render_placement(replace(session, observations=None), truth, 0, 0, settings, with_bounds=True)
        yield shown.image, targets
