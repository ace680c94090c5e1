"""A simulated session as a folder: session.json, targets.json, observations.csv and truth.json."""

import json
from pathlib import Path

from spherecal.data.session import Session
from spherecal_files.atomic import SESSION, write_folder_whole
from spherecal_files.filesystem import create
from spherecal_files.observations_file import write_observations
from spherecal_files.session_json import session_json
from spherecal_files.target_set_file import write_target_set
from spherecal_sim.truth import Truth, write_truth


def write_session(session: Session, truth: Truth, folder: Path) -> None:
    """Write a session folder, whole or not at all; an older session there is replaced."""
    write_folder_whole(folder, lambda partial: fill_session_folder(session, truth, partial), SESSION)


def fill_session_folder(session: Session, truth: Truth, folder: Path) -> None:
    """Write the files of a session into an existing folder."""
    document = json.dumps(session_json(session, folder), indent=1) + "\n"
    create(folder / "session.json", document.encode())
    if session.target_set is not None:
        write_target_set(folder / "targets.json", session.target_set)
    if session.observations is not None:
        write_observations(folder / "observations.csv", session.observations)
    write_truth(truth, folder / "truth.json")
