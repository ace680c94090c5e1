"""Is a rig still right, and if cameras moved, where are they now? python after_a_bump.py SESSION RESULT NEW_RESULT."""

import sys

import spherecal

session, result, new_result = sys.argv[1:] if len(sys.argv) == 4 else sys.exit(print(__doc__, file=sys.stderr) or 2)
found = spherecal.check_rig(session, result)
print(found.sentence)
if found.to_repair:
    again = spherecal.recalibrate_cameras(session, result, found.to_repair, "pose")
    spherecal.save_calibration(again, new_result)
    print(spherecal.check_rig(session, new_result).sentence)
