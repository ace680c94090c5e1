"""Calibrate a session, verify the rig with its check bars, and stop the line where either says no.

python calibrate_and_verify.py SESSION RESULT
"""

import sys

import spherecal


def main(session_folder: str, result_folder: str) -> int:
    """0 where the rig may be used, 3 where it may not."""
    session = spherecal.load_session(session_folder)
    calibration = spherecal.calibrate_session(session)
    spherecal.save_calibration(calibration, result_folder)
    quality = calibration.rig.quality
    print(f"{len(calibration.rig.cameras)} of {len(session.cameras)} cameras, rms {quality.rms_px} px")
    for finding in quality.findings:
        print(f"  {finding.severity}: {finding.message} {finding.hint}")
    if not quality.valid:
        return 3

    verification = spherecal.verify_rig(session, calibration.rig)
    spherecal.save_verification(verification, result_folder, f"{result_folder}/rig.json")
    for length in verification.lengths:
        print(
            f"  bar {length.bar} {length.from_mark}-{length.to_mark}: error {length.mean_error_mm:+.4f} mm, "
            f"U {length.expanded_uncertainty_mm:.4f} mm (k = {length.coverage_factor:.2f})"
        )
    print(f"The bars say: {verification.decision.verdict}.")
    return 0 if verification.decision.verdict == "consistent" else 3


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(print(__doc__, file=sys.stderr) or 2)
    try:
        sys.exit(main(*sys.argv[1:]))
    except spherecal.SpherecalError as error:
        sys.exit(f"{error}")
