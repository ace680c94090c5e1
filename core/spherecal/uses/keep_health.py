"""The rig's health while measuring, as an entry among the profile's quick checks: it joins their trend."""

from pathlib import Path

from spherecal.base.errors import OutputError
from spherecal.data.rig import Rig
from spherecal.files.json_file import finite
from spherecal.measuring.health import SLOW_SETS
from spherecal.measuring.results import Health
from spherecal.profile.checks import keep_check
from spherecal.profile.store import is_profile, open_profile
from spherecal.uses.check import Verdict, camera_state
from spherecal.uses.check_file import CheckEntry, camera_entry

_ORDER: tuple[Verdict, ...] = ("ok", "watch", "recalibrate")


def keep_health(profile: Path, health: Health, rig: Rig, temperature_c: float | None = None) -> str | None:
    """Keep the health in the profile; what to say of it, None for no profile or too few sets to judge.

    Parameters
    ----------
    profile
        The path that was measured with; it need not be a profile.
    health
        The rig's health over all sets.
    rig
        The rig that was measured with.
    temperature_c
        The rig's temperature in deg C; None where it is not known.
    """
    if not (profile.is_dir() and is_profile(profile)) or health.sets < SLOW_SETS or not health.tests:
        return None
    active = open_profile(profile).active_id
    if active is None:
        return None
    try:
        keep_check(profile, active, health_document(health, rig), temperature_c)
    except OutputError as error:
        return f"The rig's health is not kept in the profile. {error}"
    return f"The rig's health is kept in the profile: spherecal profile trend {profile} --checks"


def health_document(health: Health, rig: Rig) -> CheckEntry:
    """The health in the form of check.json: every camera that was tested, by its newest test.

    Parameters
    ----------
    health
        The rig's health over all sets.
    rig
        The rig that was measured with, for its residuals and the tolerance of moves.
    """
    tolerance = None if rig.length_map is None else rig.length_map.typical_mm
    named = {one.camera: one.moved for one in health.cameras if one.moved is not None}
    states = [
        camera_state(named.get(test.id, test), rig, tolerance)
        for test in health.tests
        if not test.moved or test.id in named
    ]
    worst = _ORDER[max((_ORDER.index(state.verdict) for state in states), default=0)]
    moved = [f"camera {state.test.id} {state.reason}" for state in states if state.verdict == worst != "ok"]
    said = "; ".join(moved) if moved else f"{len(states)} cameras agree with one another"
    return {
        "verdict": worst,
        "sentence": f"While measuring {health.sets} sets: {said}.",
        "tolerance_mm": finite(tolerance),
        "cameras": [camera_entry(state) for state in states],
        "balls": [],
        "lengths": [],
    }
