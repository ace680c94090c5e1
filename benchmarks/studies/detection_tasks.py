"""The study's images, made and looked at in two processes; each task gives the scores or tallies of a few images."""

import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.simulators.dot_bound import dot_bounds
from spherecal.targets.detection import Detections, DetectionSettings, Detector
from spherecal_sim.optics import Image, Sensor
from spherecal_sim.render_session import CLUTTERED, RENDERED
from spherecal_sim.simulate_session import simulate_session

from . import detection_false as false
from .detection_clusters import Kind
from .detection_false import Tally
from .detection_scenes import Picture, View, kept
from .detection_scores import Score, score
from .detection_stress import NOMINAL, Case

PROCESSES = 2
SEED = 1
_EVERY_S = 10.0  # a line of progress


@dataclass(frozen=True)
class Task:
    """A function of this module with its arguments; results with one `name` belong together."""

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]


FAILED = "failed"


def run(tasks: Sequence[Task]) -> dict[str, list[Any]]:
    """All tasks' results by name, in the tasks' order; progress goes to stderr.

    What fails is named under FAILED instead: a detector must not fail, and a study of an hour must not be lost by it.
    """
    begin = last = time.monotonic()
    done: dict[int, Any] = {}
    with ProcessPoolExecutor(PROCESSES, get_context("spawn"), _on_one_thread) as pool:
        waiting = {pool.submit(task.function, *task.arguments): i for i, task in enumerate(tasks)}
        try:
            for future in as_completed(waiting):
                done[waiting[future]] = _result(tasks[waiting[future]], future)
                if time.monotonic() - last > _EVERY_S or len(done) == len(tasks):
                    last = time.monotonic()
                    print(f"{len(done)} of {len(tasks)} tasks, {last - begin:.0f} s", file=sys.stderr, flush=True)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    results: dict[str, list[Any]] = {}
    for i, task in enumerate(tasks):
        name, result = done[i]
        results.setdefault(task.name, [])
        results.setdefault(name, []).append(result)
    return results


def _result(task: Task, future: Future[Any]) -> tuple[str, Any]:
    try:
        return task.name, future.result()
    except BrokenExecutor:
        raise
    except Exception as error:
        return FAILED, f"{task.name} {task.arguments}: {type(error).__name__}: {error}"


def _on_one_thread() -> None:
    cv2.setNumThreads(1)
    threadpool_limits(1)


def _look(view: View, rendered: Picture, upsampled: bool = False) -> Score:
    """Detect with what a data sheet says of the camera, and score."""
    kind = view.truth.cameras[view.camera].kind
    width, height = kind.image_size
    image, times = rendered.image, 1
    if upsampled:
        times = 2
        image = cast(Image, cv2.resize(image, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC))
    middle = (times * width - 1) / 2, (times * height - 1) / 2
    settings = DetectionSettings(times * kind.focal_length_px, middle)
    found: Detections = Detector(view.targets).detect(image, settings)
    if upsampled:  # pixel centres: u' = 2 u + 1/2
        found = replace(found, uv=(found.uv - 0.5) / times, sigma_uv=found.sigma_uv / times)
    return score(found, rendered.dots, view.truth.ball.points)


def nominal(image: int) -> Score:
    """An image of the ball before a camera aimed at it, with bounds."""
    return _look(NOMINAL.view(image), kept(f"aimed-{image}", lambda: NOMINAL.render(image, with_bounds=True)))


def noise_free(image: int) -> Score:
    """The same without noise, in 16 bits."""
    case = replace(NOMINAL, settings=replace(CLUTTERED, sensor=Sensor(noise=False, bits=16)))
    return _look(case.view(image), kept(f"noise-free-{image}", lambda: case.render(image)))


def of_session(rig: str, placement: int, camera: int) -> Score:
    """An image of a rig's session, with bounds."""
    session, truth = simulate_session(rig, SEED, replace(RENDERED, bar_poses=0))
    view = View(session, truth, placement, camera)
    seed = 100 * placement + camera
    return _look(
        view, kept(f"{rig}-{placement}-{camera}", lambda: view.render(replace(CLUTTERED, bounds=dot_bounds), seed))
    )


def stress(case: Case, image: int) -> Score:
    """An image of a row of the stress table."""
    picture = kept(f"{_file_name(case)}-{image}", lambda: case.render(image))
    found = _look(case.view(image), picture, case.upsampled)
    if not case.centred or not len(found.error):
        return found
    return replace(found, error=found.error - np.median(found.error, axis=0))


def _file_name(case: Case) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in case.name)


def empty_room(seed: int) -> Tally:
    """See detection_false."""
    return false.empty_room(seed)


def tags(seed: int) -> Tally:
    """See detection_false."""
    return false.tags(seed)


def foreign_targets(seed: int) -> Tally:
    """See detection_false."""
    return false.foreign_targets(seed)


def drawn(kind: Kind, first: int, count: int) -> Tally:
    """Several images of dots."""
    return sum((false.drawn(kind, seed) for seed in range(first, first + count)), Tally())


def speckled(first: int, count: int) -> Tally:
    """Several speckled backgrounds."""
    return sum((false.speckled(seed) for seed in range(first, first + count)), Tally())


def photographed(source: str, path: Path) -> tuple[str, Tally]:
    """A photograph and where it comes from."""
    return source, false.photographed(path)
