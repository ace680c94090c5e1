"""Calls every kernel of the engine as the program does, so that numba compiles it for the types that really come.

installer/kernels.py learns the types from it, for the kernels compiled ahead; `spherecal compile-kernels` fills numba's
cache by it. What no trial calls is compiled at its first call. In a bundle without numba it runs as plain Python, and
the log says so; `bundle.py` tries the finished bundle with SPHERECAL_KERNELS=strict, where that is an error.
"""

import io
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from spherecal.adjust import dense_elimination
from spherecal.geometry.resection import pose_cost
from spherecal.targets.detection import DetectionSettings, Detector
from spherecal.targets.sticker_view import VIEW_SIZE, place_of
from spherecal.targets.target_set import TargetSet
from spherecal_app.cli.main import main
from spherecal_cameras.simulated.draw import digitise
from spherecal_cameras.simulated.stage import Stage, StageView
from spherecal_files.target_set_file import write_target_set
from spherecal_sim.optics import Sensor
from spherecal_sim.render_session import DEMO as RENDERED
from spherecal_sim.render_session import render_placement, write_png
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.simulated_scene import RenderSettings

Step = Callable[[Path], None]


def _drawn(folder: Path) -> None:
    """Images as the simulated cameras draw them, of 8 and of 16 bits; their dots found."""
    stage = Stage("demo")
    targets = stage.session.target_set
    assert targets is not None
    for pose in (stage.poses[0], stage.poses[-1]):
        stage.show(pose)
        for image in _digitised(stage):
            _find_dots(image, targets)
    squares = np.random.default_rng(1).integers(0, 2, (60, 80), np.uint8)
    _find_dots(200 * np.kron(squares, np.ones((8, 8), np.uint8)), targets)  # texture all over the image


def _traced(folder: Path) -> None:
    """Images as the simulated cameras and the simulator render them."""
    stage = Stage("demo")
    stage.show(stage.poses[-1])
    _digitised(stage, rendered=True)
    for _ in _rendered_images():
        pass


def _digitised(stage: Stage, rendered: bool = False) -> list[np.ndarray]:
    """What the first camera sees of the stage, of 8 and of 16 bits."""
    picture = stage.picture(0, StageView(), rendered)
    return [digitise(picture, bits, 1.0, np.random.default_rng(bits)) for bits in (8, 12)]


def _rendered(folder: Path) -> None:
    """A rendered image of the ball with its dots' truth; the dots found, by a command too."""
    stage = Stage("demo")
    assert stage.session.target_set is not None
    stage.show(stage.poses[-1])
    for image in _digitised(stage, rendered=True):
        _find_dots(image, stage.session.target_set)
    for number, (image, targets) in enumerate(_rendered_images()):
        _find_dots(image, targets)
        write_png(folder / f"{number}.png", image)
        write_target_set(folder / "targets.json", targets)
    pictures = [str(path) for path in sorted(folder.glob("*.png"))]
    _command("detect", *pictures, "--targets", f"{folder}/targets.json", "--csv", f"{folder}/seen.csv")


def _rendered_images() -> Iterator[tuple[np.ndarray, TargetSet]]:
    session, truth = simulate_session("demo", 1, RENDERED)
    targets = session.target_set
    assert targets is not None
    for bits in (8, 12):
        settings = RenderSettings(
            sensor=Sensor(bits=bits), blobs=20, arm=True, specks=0.3, scratches=0.3,
            lighting="rings" if bits == 8 else "flat",
        )  # fmt: skip
        shown = render_placement(replace(session, observations=None), truth, 0, 0, settings)
        yield shown.image, targets


def _find_dots(image: np.ndarray, targets: TargetSet) -> None:
    Detector(targets).detect(image, DetectionSettings(focal_px=1700.0))


def _seldom(_: Path) -> None:
    """What only doubtful targets and cameras need."""
    place_of(np.zeros(VIEW_SIZE), np.float64(1.0), np.float64(2.0))
    pose_cost(np.eye(3), np.ones(3), np.ones((4, 3)), np.ones((4, 2)), 1.0)


def _simulated(folder: Path) -> None:
    _command("simulate", "demo", "--observations-only", "-o", f"{folder}/s")


def _calibrated(*options: str) -> Step:
    """A calibration of the simulated observations, with these options."""
    return lambda folder: _command("calibrate", f"{folder}/s", "-o", f"{folder}/{''.join(options)}", *options)


def _dense(folder: Path) -> None:
    with patch.object(dense_elimination, "LEAST_COLUMNS", 1):  # otherwise only rigs of a hundred cameras go that way
        _calibrated("--method", "rigid")(folder)


def _verified(folder: Path) -> None:
    first = f"{folder}/--methodauto"
    _command("verify", f"{folder}/s", "--rig", f"{first}/rig.json", "-o", first)


def _command(*words: str) -> None:
    """A command in this process."""
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()) as said:
        code = main(list(words))
    if code not in (0, 3):
        raise RuntimeError(f"spherecal {' '.join(words)} failed in the trial of the kernels: {said.getvalue()}")


# What may run at the same time as the other, in processes of their own. The detector's kernels take as long as all
# others together (42 and 41 processor seconds); what is rendered for it is then compiled already.
PARTS: dict[str, tuple[Step, ...]] = {
    "detection": (_drawn, _rendered, _seldom),
    "rendering and adjustment": (
        _traced,
        _simulated,
        _calibrated("--method", "auto"),
        _calibrated("--method", "soft"),
        _calibrated("--method", "tao2021"),
        _calibrated("--intrinsics", "fixed"),
        _dense,
        _verified,
    ),
}
# What a calibration calls, of images and of observations alone, and how many functions numba then compiles (counted
# with 0.68; where the count has changed the bar ends early or jumps at its end).
CALIBRATION: dict[str, tuple[Step, ...]] = {
    "detection": (_drawn,),
    "adjustment": (_simulated, _calibrated("--method", "auto")),
}
CALIBRATION_FUNCTIONS = 380
# What `spherecal demo` calls after its images are rendered; it compiles the renderer's kernels itself.
DEMO: dict[str, tuple[Step, ...]] = {
    "detection": (_drawn,),
    "adjustment": (_simulated, _calibrated("--method", "auto"), _verified),
}
