"""`python -m spherecal`: the command line."""

import sys

from spherecal_app.cli.main import entry

if __name__ == "__main__":
    sys.exit(entry())
