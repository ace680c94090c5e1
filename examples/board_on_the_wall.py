"""A rig from a folder of images of a board: python board_on_the_wall.py IMAGES SESSION RESULT BOARD.

IMAGES holds cam1/0001.png, cam2/0001.png, ...; BOARD is such as aprilgrid,rows=6,columns=6,pitch_mm=28.6,marker_mm=22.
"""

import sys

import spherecal

images, folder, result, board = sys.argv[1:] if len(sys.argv) == 5 else sys.exit(print(__doc__, file=sys.stderr) or 2)
session = spherecal.new_session(folder, images, board=board).session
calibration = spherecal.calibrate_session(session, "board")
spherecal.save_calibration(calibration, result)
print(calibration.rig)
