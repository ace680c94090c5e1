"""Verify a rig of Kalibr with the bars of a session: python verify_kalibr_rig.py camchain.yaml SESSION."""

import sys

import spherecal

camchain, session = sys.argv[1:] if len(sys.argv) == 3 else sys.exit(print(__doc__, file=sys.stderr) or 2)
rig = spherecal.import_rig(camchain, "kalibr")  # its cameras are named after their topics, else cam0, cam1, ...
verification = spherecal.verify_rig(session, rig)
for length in verification.lengths:
    print(f"{length.bar} {length.from_mark}-{length.to_mark}: {length.mean_error_mm:+.4f} mm in {length.n} poses")
print(verification.decision.verdict)
