"""How well the ghost of the ball meets the ball that is put there, and how soon the advice comes.

A simulated rig is calibrated from its first one or two placements, as the window does it. The true ball is then put
where the live view says that nothing is left to go, and its true outline compared with the ghost's in every camera.

    PYTHONPATH=core:. python -m benchmarks.studies.ghost [PRESET ...]
"""

import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal_files.session_json import session_json
from spherecal_gui.coverage import Dots
from spherecal_gui.tasks.ghost import Ghost, Lenses, Lying, lying_ball, outline, to_go
from spherecal_gui.tasks.placement_advice import plan_coarse, plan_next
from spherecal_sim.observe import look, observe
from spherecal_sim.simulate_session import simulate_session

NOISE_PX = 0.05
_MOST_STEPS, _THERE_MM, _THERE_DEG = 12, 0.05, 0.02
PRESETS = ("demo", "dome4", "dome12", "dome24")


def recorded_dots(session: Any) -> dict[str, dict[str, Dots]]:
    """The dots of a session's placements by placement and camera."""
    o, found = session.observations, {}
    for p, placement in enumerate(session.placements):
        found[placement.id] = {}
        for c, camera in enumerate(session.cameras):
            rows = (o.placement == p) & (o.camera == o.cameras.index(camera.id))
            found[placement.id][camera.id] = Dots(
                o.target[rows], o.point[rows], o.uv[rows], session.cameras[c].image_size
            )
    return found


def seen_dots(truth: Any, rotation: FloatArray, place: FloatArray, rng: np.random.Generator) -> Mapping[str, Dots]:
    """What the cameras see of the true ball in a pose of the true world."""
    ball, view = truth.ball, look(truth.cameras)
    seen = observe(view, ball.dots_mm @ rotation.T + place, ball.normals @ rotation.T)
    uv = seen.uv + NOISE_PX * rng.standard_normal(seen.uv.shape)
    return {
        camera.id: Dots(
            ball.dot_target[seen.point[own]], ball.dot_point[seen.point[own]], uv[own], camera.kind.image_size
        )
        for c, camera in enumerate(truth.cameras)
        for own in [seen.camera == c]
    }


def put_there(ghost: Ghost, truth: Any, last: int, rng: np.random.Generator) -> tuple[FloatArray, Lying, int]:
    """The true place (3,) of the ball where the live view says that it has arrived, and what it says there; steps."""
    first = next(camera for camera in truth.cameras if camera.id == ghost.lenses.names[0])
    to_true = first.rotation.T @ ghost.lenses.rotation[0]
    rotation, place = truth.ball_rotations[last], truth.ball_places_mm[last]
    for step in range(_MOST_STEPS):
        lying = lying_ball(ghost.lenses, ghost.body, seen_dots(truth, rotation, place, rng))
        if lying is None:
            raise RuntimeError("the ball is not seen where it should go")
        left = to_go(ghost, lying)
        if step == _MOST_STEPS - 1 or (left.away_mm < _THERE_MM and (left.turn_deg or 0.0) < _THERE_DEG):
            return place, lying, step
        place = place + to_true @ (ghost.centre - lying.centre)
        if lying.turn is not None:
            rotation = to_true @ ghost.turn @ lying.turn.T @ to_true.T @ rotation
    raise AssertionError


def true_lenses(truth: Any, names: tuple[str, ...]) -> Lenses:
    """The cameras as they truly are, in the order of these names."""
    cameras = [next(one for one in truth.cameras if one.id == name) for name in names]
    return Lenses(
        names,
        np.array([c.intrinsics for c in cameras]),
        np.array([c.rotation for c in cameras]),
        np.array([c.translation_mm for c in cameras]),
        np.array([c.kind.image_size for c in cameras], dtype=float),
    )


def errors(ghost: Ghost, truth: Any, last: int, rng: np.random.Generator) -> tuple[float, float, float, int]:
    """Outline error in px (median and worst camera) and mm, and the steps until the ball had arrived.

    The error of an outline is the mean distance of its points from the true outline; in mm it is that at the ball's
    distance, the worst camera.
    """
    place, _, steps = put_there(ghost, truth, last, rng)
    true = true_lenses(truth, ghost.lenses.names)
    px, mm = [], []
    for c in range(len(true.names)):
        wanted = outline(ghost.lenses, c, ghost.centre, ghost.body.radius_mm)
        there = outline(true, c, place, truth.ball.radius_mm)
        inside = np.array([]) if not len(there) else ((there > 0) & (there < true.size[c])).all(axis=1)
        if not len(wanted) or not inside.any():
            continue
        away = np.linalg.norm(there[inside][:, None] - wanted[None], axis=2).min(axis=1)
        px.append(float(away.mean()))
        far = np.linalg.norm(true.rotation[c] @ place + true.translation[c])
        mm.append(px[-1] * far / true.intrinsics[c, 0])
    return float(np.median(px)), max(px), max(mm), steps


def main(presets: tuple[str, ...]) -> None:
    """Print a row for each rig and number of placements."""
    print("rig      cameras placed  advice  cpu s  wall s  outline px (median worst)  worst mm  steps")
    for preset in presets:
        session, truth = simulate_session(preset, 1)
        dots, document = recorded_dots(session), session_json(session, session.folder)
        names = [one.id for one in session.placements]
        plan_coarse(document, session.target_set, {names[0]: dots[names[0]]}, Context())  # kernels are compiled
        for count in (1, 2):
            some = {name: dots[name] for name in names[:count]}
            for kind, work in (("coarse", plan_coarse), ("full", plan_next)):
                wall, cpu = time.perf_counter(), time.process_time()
                found = work(document, session.target_set, some, Context())
                wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
                if found is None or found.ghost is None:
                    print(f"{preset:8s} {len(session.cameras):7d} {count:6d}  {kind:6s} {cpu:6.2f} {wall:7.2f}  none")
                    continue
                middle, most, mm, steps = errors(found.ghost, truth, count - 1, np.random.default_rng(1))
                print(
                    f"{preset:8s} {len(session.cameras):7d} {count:6d}  {kind:6s} {cpu:6.2f} {wall:7.2f}"
                    f"        {middle:8.2f} {most:8.2f}       {mm:8.2f} {steps:6d}",
                    flush=True,
                )


if __name__ == "__main__":
    main(tuple(sys.argv[1:]) or PRESETS)
