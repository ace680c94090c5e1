"""Writes to a profile without end, until it is killed: `python profile_writer.py PROFILE RESULT_A RESULT_B`."""

import sys
from pathlib import Path

from spherecal_rigs.save_entry import save_result
from spherecal_rigs.store import apply, create_profile, open_profile


def write_without_end(folder: Path, results: list[Path]) -> None:
    profile = create_profile(folder)
    print("ready", flush=True)
    while True:
        for result in results:
            saved = save_result(profile, result)
            profile = apply(open_profile(folder), saved)


if __name__ == "__main__":
    write_without_end(Path(sys.argv[1]), [Path(argument) for argument in sys.argv[2:]])
