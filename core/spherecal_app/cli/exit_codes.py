"""Exit codes of the command line."""

DONE, BAD_INPUT, NOT_VALID, CANCELLED = 0, 2, 3, 130
