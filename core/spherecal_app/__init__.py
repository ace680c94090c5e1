"""What people use: the Python interface (`api.py`) and the command line (`cli`)."""

import spherecal as spherecal  # first of all: from here on Ctrl-C ends the program without a traceback
