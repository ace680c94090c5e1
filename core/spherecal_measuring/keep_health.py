"""The rig's health while measuring, as an entry of the profile's quick checks, so that it is part of their trend."""

from pathlib import Path

from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig
from spherecal.files.json_file import finite
from spherecal_measuring.health import SLOW_SETS
from spherecal_measuring.measured_sets import Health
from spherecal_rigs.check_file import camera_entry, keep
from spherecal_rigs.check_rig import Verdict, camera_cause, camera_state

_ORDER: tuple[Verdict, ...] = ("ok", "watch", "recalibrate")


def keep_health(profile: Path, health: Health, rig: Rig, temperature_c: float | None = None) -> bool:
    """Keep the health in the profile; False for no profile, and for too few sets to judge."""
    if health.sets < SLOW_SETS or not health.tests:
        return False
    return keep(profile, health_document(health, rig), temperature_c)


def health_document(health: Health, rig: Rig) -> dict[str, object]:
    """The health in the form of check.json: every camera that was tested, by its newest test."""
    tolerance = None if rig.length_map is None else rig.length_map.typical_mm
    named = {one.camera: one.moved for one in health.cameras if one.moved is not None}
    states = [
        camera_state(named.get(test.id, test), rig, tolerance)
        for test in health.tests
        if not test.moved or test.id in named
    ]
    worst = _ORDER[max((_ORDER.index(state.verdict) for state in states), default=0)]
    causes = [camera_cause(state) for state in states if state.verdict == worst != "ok"]
    agree = Phrase("health-agree", {"sets": health.sets, "cameras": len(states)})
    said = Phrase("health-causes", {"sets": health.sets, "causes": causes}) if causes else agree
    return {
        "verdict": worst,
        "sentence": phrase(said),
        "tolerance_mm": finite(tolerance),
        "cameras": [camera_entry(state) for state in states],
        "balls": [],
        "lengths": [],
    }
