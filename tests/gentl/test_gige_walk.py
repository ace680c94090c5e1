"""From GigE Vision packets to a rig: a simulated rig captured over the wire, calibrated, compared with the truth."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from spherecal.targets.images import read_image
from spherecal_app.cli.main import main
from spherecal_app.cli.producer_command import show_gige
from spherecal_cameras.simulated.stage import Stage
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
from spherecal_gentl.producer.producer_control import SessionScenes
from tests.gige_rig import aravis_producer, wired_as

# The drawn images have camera noise of their own in each run: an error in mm would test the draw. Measured over eight
# draws of three placements: 1.9 to 2.1 stated standard uncertainties at the worst camera (0.046 to 0.054 mm).
MOST_SIGMAS = 3.0


@contextmanager
def stage_hand(rig: GigeRig, scenes: SessionScenes, folder: Path) -> Iterator[str]:
    """The command that puts the set of its environment in front of the cameras, and returns when they see it."""
    ask, answer = folder / "ask", folder / "answer"
    for pipe in (ask, answer):
        os.mkfifo(pipe)

    def obey() -> None:
        while (name := ask.read_text().strip()) != "quit":
            try:
                show_gige(rig, scenes, name)
            finally:
                answer.write_text("done")

    hand = threading.Thread(target=obey)
    hand.start()
    try:
        yield f'echo "$SPHERECAL_SET" > {ask}; cat {answer} > {os.devnull}'
    finally:
        ask.write_text("quit")
        hand.join()


def centre_errors_in_sigmas(rig_file: Path, stage: Stage) -> np.ndarray:
    """Distances of the cameras from the truth after a rotation and a shift, no scale, over their uncertainties."""
    cameras = {camera.id: camera for camera in read_rig(rig_file).cameras}
    points = np.array([cameras[camera.id].centre_mm for camera in stage.truth.cameras])
    truth = np.array([-camera.rotation.T @ camera.translation_mm for camera in stage.truth.cameras])
    sigmas_mm = [np.linalg.norm(cameras[camera.id].sigma.centre_mm) for camera in stage.truth.cameras]
    a, b = points - points.mean(axis=0), truth - truth.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return np.linalg.norm(a @ rotation - b, axis=1) / sigmas_mm


def test_placements_over_the_wire_become_the_true_rig(
    drawn_session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    session, result = tmp_path / "session", tmp_path / "result"
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(aravis_producer().parent))
    profile, plan = ["--profile", str(tmp_path / "profile.json")], drawn_session / "session.json"

    scenes = SessionScenes(drawn_session)
    cameras = [GigeCamera(serial, *camera.image_size) for serial, camera in scenes.cameras.items()]
    with wired_as(cameras) as rig, stage_hand(rig, scenes, tmp_path) as before_each:
        line = ["cameras", "capture", "-o", str(session), "--plan", str(plan), "--before-each", before_each, *profile]
        # cameras and calibration share this machine's processors, which may be busy
        code = main([*line, "--timeout", "15"])
        assert code == 0, capsys.readouterr().out

    taken = read_session(session)
    assert [placement.id for placement in taken.placements] == ["P1", "P2", "P3"]
    for group in (*taken.placements, *taken.bar_poses):
        seen = scenes.images(group.id)
        for camera in taken.cameras:
            assert np.array_equal(read_image(group.images[camera.id]), seen[camera.serial or ""]), (group.id, camera.id)

    drawn = tmp_path / "drawn"
    for folder, out in ((session, result), (drawn_session, drawn)):
        assert main(["calibrate", str(folder), "-o", str(out)]) == 0, capsys.readouterr()
    assert (result / "points.csv").read_bytes() == (drawn / "points.csv").read_bytes()
    assert centre_errors_in_sigmas(result / "rig.json", Stage("demo")).max() < MOST_SIGMAS
