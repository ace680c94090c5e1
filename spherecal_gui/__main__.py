"""`python -m spherecal_gui`: the window, or one plain line why there is none."""

import os
import sys

from spherecal.base.working_folder import distrust


def main() -> int:
    """Open the window; 2 where Qt or a screen is missing."""
    distrust()
    try:
        from spherecal_gui import app  # not before: PySide6 may be missing
    except ImportError as error:  # PySide6 itself, or a system library that it needs
        print(
            f"The window needs PySide6 and its system libraries: {error}.\n"
            "Everything it shows is there on the command line too: spherecal --help",
            file=sys.stderr,
        )
        return 2
    if sys.platform.startswith("linux") and not any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    ):  # Qt would abort the process
        print("There is no screen here to open a window on. Try: spherecal --help", file=sys.stderr)
        return 2
    return app.main()


if __name__ == "__main__":
    sys.exit(main())
