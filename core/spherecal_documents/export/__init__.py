"""A calibrated rig in the formats that other programs read, and lenses out of theirs."""
