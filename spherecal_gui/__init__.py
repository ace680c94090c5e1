"""The window of SphereCal; it imports the engine (`spherecal`), never the other way."""
