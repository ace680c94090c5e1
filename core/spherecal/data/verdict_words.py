"""A calibration's verdict, and what care concerns, in words."""

from collections.abc import Collection

from spherecal.base.messages.catalogue import phrase
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Affected, Verdict

# As the command line, the report and the window have them.
WORDS: dict[Verdict, str] = {"valid": "VALID", "use-with-care": "USE WITH CARE", "not-valid": "NOT VALID"}


def named(some: Collection[Affected]) -> str:
    """What care concerns, in words: `cameras C01, C04; the scale`."""
    return "; ".join(phrase(part) for part in care_phrases(some))


def care_phrases(some: Collection[Affected]) -> tuple[Phrase, ...]:
    """What care concerns: cameras, the scale, parts of the volume."""
    cameras = [one.camera for one in some if one.camera is not None]
    parts = [Phrase("care-cameras", {"cameras": cameras})] if cameras else []
    parts += [Phrase("care-scale")] if any(one.scale for one in some) else []
    for one in some:
        if one.region_mm is not None:
            low, high = one.region_mm
            parts.append(Phrase("care-volume", {"low": low, "high": high}))
    return tuple(parts)
