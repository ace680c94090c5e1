"""What worker processes of test_baselines_study.py and test_batch.py do.

It is apart, since each worker imports the module first.
"""

import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path

from spherecal_study.executor import Result, Trial


def kill_once(trial: Trial) -> Result:
    """Takes its process down the first time that the marker file is not there."""
    marker = Path(trial.settings["marker"])
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return {"value": trial.settings["seed"]}


def kill_always(_: Trial) -> Result:
    """Takes its process down."""
    os.kill(os.getpid(), signal.SIGKILL)
    return {}


def kill_on_monday(trial: Trial, columns: Sequence[str]) -> Result:
    """The row of a session of a batch; that of monday takes its process down."""
    if trial.settings["session"].endswith("monday"):
        os.kill(os.getpid(), signal.SIGKILL)
    return {"outcome": "valid", **dict.fromkeys(columns), "message": ""}


def slow(trial: Trial) -> Result:
    """Says which process it is in, then takes two minutes."""
    marker = Path(trial.settings["marker"])
    marker.with_suffix(".new").write_text(str(os.getpid()))
    marker.with_suffix(".new").rename(marker)  # whole as soon as it is there
    time.sleep(120)
    return {}
