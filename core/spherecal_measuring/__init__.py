"""Measuring with a calibrated rig: points, lengths, angles, bars and bodies, set after set (docs/measuring.md)."""
