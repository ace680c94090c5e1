"""The rig in space: a model of what is shown, and its renderer, for the window, the report and the pictures."""
