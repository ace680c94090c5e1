"""Is a rig still right, and if cameras moved, where are they now? python after_a_bump.py SESSION RESULT NEW_RESULT."""

import sys

import spherecal

found = spherecal.check_rig(sys.argv[1], sys.argv[2])
print(found.sentence)
if found.to_repair:
    again = spherecal.recalibrate_cameras(sys.argv[1], sys.argv[2], found.to_repair, "pose")
    spherecal.save_calibration(again, sys.argv[3])
    print(spherecal.check_rig(sys.argv[1], sys.argv[3]).sentence)
