"""A calibration that is asked to end with what there is so far: its result is the last whole step's, and not valid."""

from pathlib import Path

import numpy as np
import pytest

from spherecal.base.context import Context, Progress
from spherecal.base.errors import Cancelled, PartialResultAccepted
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration
from spherecal.steps.settings import CalibrationSettings
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig
from spherecal_files.write_result import write_result
from spherecal_sim.render_session import demo_session
from tests.networks import simulated


class AskedAt:
    """Asks for what there is from the first event of a stage (and, if given, of a message) on."""

    def __init__(self, stage: str, message: str = "") -> None:
        self.stage, self.message, self.asked = stage, message, False

    def note(self, progress: Progress) -> None:
        self.asked |= progress.stage == self.stage and self.message in progress.message

    def context(self) -> Context:
        return Context(self.note, accepts_partial=lambda: self.asked)


def codes(calibration: Calibration) -> list[str]:
    return [finding.code for finding in calibration.rig.quality.findings]


def assert_same_cameras(one: Calibration, other: Calibration) -> None:
    assert [camera.id for camera in one.rig.cameras] == [camera.id for camera in other.rig.cameras]
    for mine, yours in zip(one.rig.cameras, other.rig.cameras, strict=True):
        np.testing.assert_array_equal(mine.rotation, yours.rotation)
        np.testing.assert_array_equal(mine.translation_mm, yours.translation_mm)
        np.testing.assert_array_equal(mine.intrinsics, yours.intrinsics)


@pytest.mark.parametrize("stage", ["triples", "bundle adjustment", "rigid ball"])
def test_the_free_form_is_what_there_is_before_a_stiffer_one(stage: str, tmp_path: Path) -> None:
    session, _ = simulated("demo", 1)
    stopped = calibrate(session, context=AskedAt(stage).context())
    assert_same_cameras(stopped, calibrate(session, CalibrationSettings(method="free")))
    assert codes(stopped)[0] == "stopped-early" and codes(stopped).count("stopped-early") == 1
    assert not stopped.rig.quality.valid and stopped.rig.form is not None and stopped.rig.form.name == "free"
    write_result(stopped, tmp_path / "result")
    assert not read_rig(tmp_path / "result" / "rig.json").quality.valid


def test_nobody_asks_nothing_changes() -> None:
    session, _ = simulated("demo", 1)
    told: list[Progress] = []
    alone = calibrate(session)
    assert_same_cameras(alone, calibrate(session, context=Context(told.append)))
    assert "stopped-early" not in codes(alone)


def test_cancelling_goes_before() -> None:
    session, _ = simulated("demo", 1)
    asked = AskedAt("rigid ball")
    with pytest.raises(Cancelled):
        calibrate(session, context=Context(asked.note, lambda: asked.asked, lambda: asked.asked))


def test_only_who_holds_a_result_is_stopped() -> None:
    context = Context(accepts_partial=lambda: True)
    context.check()
    with pytest.raises(PartialResultAccepted):
        context.accepting_partial().check()


def test_from_images_the_first_run_is_kept(demo_tried: Path) -> None:
    """Asked while missed targets are sought, or in the second run: the first run's whole result."""
    session = read_session(demo_session())
    second = AskedAt("detect", "again")
    stopped = calibrate(session, context=second.context())
    assert codes(stopped)[0] == "stopped-early" and codes(stopped).count("stopped-early") == 1
    assert stopped.rig.form is not None and stopped.rig.form.name == "rigid"
    whole = demo_tried / "try" / "result"
    observations = len((whole / "residuals.csv").read_text(encoding="utf-8").splitlines()) - 1
    assert read_rig(whole / "rig.json").quality.valid and observations > len(stopped.observations)
