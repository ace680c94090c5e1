"""The wizard: its controller, which knows no widgets, and its window."""
