"""Exit codes of the command line."""

DONE, BAD_INPUT, NOT_VALID, CANCELLED = 0, 2, 3, 130
# Of `verify --limit`: 3 and 4 are the answers to two questions, 5 says both.
LIMIT_EXCEEDED, BOTH, CANNOT_TELL = 4, 5, 6
