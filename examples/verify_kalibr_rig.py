"""Verify a rig of Kalibr with the bars of a session: python verify_kalibr_rig.py camchain.yaml SESSION."""

import sys

import spherecal

rig = spherecal.import_rig(sys.argv[1], "kalibr")  # its cameras are named after their topics, else cam0, cam1, ...
verification = spherecal.verify_rig(sys.argv[2], rig)
for length in verification.lengths:
    print(f"{length.bar} {length.from_mark}-{length.to_mark}: {length.mean_error_mm:+.4f} mm in {length.n} poses")
print(verification.decision.verdict)
