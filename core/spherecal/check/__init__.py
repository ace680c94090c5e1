"""The quick check: one look at the ball or a bar, and whether the rig still is as it was calibrated."""
