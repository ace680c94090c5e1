"""Rig profiles: a rig's calibrations over time, which of them is in use, and what has changed between them."""
