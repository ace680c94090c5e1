"""A calibration from images in two passes: the first predicts where targets were missed, the second uses them too."""

from collections.abc import Callable

from spherecal.base.context import Context, Stopwatch
from spherecal.base.errors import PartialResultAccepted
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.detect.redetection import with_missed_targets
from spherecal.result.build import stopped_early

Calibrate = Callable[[Session, Context, Stopwatch], Calibration]


def calibrate_twice(session: Session, calibrate: Calibrate, context: Context, watch: Stopwatch) -> Calibration:
    """The calibration with the targets that only its predictions find in the images; the first one where stopped."""
    first = calibrate(session, context, Stopwatch())
    try:
        session = with_missed_targets(session, first, context.accepting_partial())
        watch.lap("re-detection")
        return calibrate(session, context.accepting_partial(), watch)
    except PartialResultAccepted:
        return stopped_early(first)
