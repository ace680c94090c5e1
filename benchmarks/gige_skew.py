"""How far apart exposures are, by the cameras' common clock: `python -m benchmarks.gige_skew` (Linux, root).

Six simulated GigE cameras, whose clocks are simulated as synchronised by IEEE 1588; sets by software trigger, then by
scheduled action command.
"""

import os
import statistics

from spherecal_cameras.genicam.genicam_source import GenicamSource
from spherecal_cameras.protocol import CameraSettings, CaptureRequest, TriggerMode
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
from spherecal_gentl.producer.build_producer import DISCOVERY_VARIABLE, build_producer

_CAMERAS, _SETTLING, _SETS = 6, 5, 20


def skews_ms(rig: GigeRig, trigger: TriggerMode) -> tuple[int, list[float]]:
    """Whole sets, and the spread of each that was seen by the common clock."""
    whole, found = 0, []
    with GenicamSource() as source:
        source.discover()
        source.open(rig.serials, dict.fromkeys(rig.serials, CameraSettings(1000.0, trigger=trigger)))
        for number in range(_SETTLING + _SETS):
            taken = source.capture_set(CaptureRequest(timeout_s=2.0, retries=0))
            if number < _SETTLING:
                continue
            whole += taken.complete
            if taken.complete and taken.common_clock and taken.spread_s is not None:
                found.append(taken.spread_s * 1e3)
    return whole, found


def main() -> None:
    """Both triggers, a line of each."""
    os.environ[DISCOVERY_VARIABLE] = str(build_producer(aravis=True).parent)
    modes: tuple[TriggerMode, ...] = ("software", "scheduled")
    with GigeRig([GigeCamera(f"GE{i + 1:02d}", 640, 480) for i in range(_CAMERAS)]) as rig, rig.entered():
        for trigger in modes:
            whole, found = skews_ms(rig, trigger)
            print(
                f"{trigger}: {whole} of {_SETS} sets whole; "
                f"exposures apart {statistics.median(found):.4g} ms (median), {max(found):.4g} ms at most"
            )


if __name__ == "__main__":
    main()
