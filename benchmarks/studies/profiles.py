"""Rig profiles: killed while written, refused by the disk, and two calibrations compared as a camera moves or not."""

import hashlib
import random
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.studies.full_disk import refusals
from benchmarks.studies.report import Report
from spherecal.base.context import Context
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.steps.settings import CalibrationSettings
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import rig_bytes
from spherecal_rigs.compare_rigs import Comparison, ComparisonVolume, compare
from spherecal_rigs.store import copy_is_right, open_profile
from spherecal_sim.simulate_session import observe_again, simulate_session
from spherecal_sim.truth import CameraMove, SimulationOptions
from tests.export_rigs import make_rig

ROOT = Path(__file__).resolve().parents[2]
_LONGEST_S = 0.4  # several calibrations are written in that time
OPTIONS = {
    "rigA": SimulationOptions(targets=100, bar_poses=0),
    "rigB": SimulationOptions(targets=200, bar_poses=0),
}
MOVES = ((0.1, 0.0), (0.0, 0.01), (0.3, 0.03))  # mm, deg


@dataclass(frozen=True)
class Kills:
    """What was found: calibrations, folders left half written, and what was wrong."""

    kills: int
    added: int
    half_written: int
    problems: tuple[str, ...]


def kill_while_writing(times: int, folder: Path, seed: int = 1) -> Kills:
    """Kill -9 a writer at random moments; after each the profile must open whole, with a calibration in use."""
    chance = random.Random(seed)
    results = list(_results(folder))
    profile = folder / "profile"
    problems: list[str] = []
    before = Seen(0, 0, 0)
    for _ in range(times):
        _kill_a_writer("profile_writer.py", (profile, *results), chance)
        try:
            now = look(profile, results)
        except Exception as error:  # whatever it is, it is what the study looks for
            problems.append(f"{type(error).__name__}: {error}")
            continue
        # one kill may leave one calibration that was saved and not yet put to use
        new, used = now.calibrations - before.calibrations, now.events - before.events
        if new < 0 or used < 0 or not 0 <= new - used <= 1:
            problems.append(f"{before} became {now}")
        before = now
    return Kills(times, before.calibrations, before.left_over, tuple(problems))


def _kill_a_writer(script: str, folders: Sequence[Path], chance: random.Random) -> None:
    """Kill -9 a script of the tests at a random moment after its first line, which says that it writes."""
    writer = subprocess.Popen(
        [sys.executable, str(ROOT / "tests" / script), *map(str, folders)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert writer.stdout is not None
        writer.stdout.readline()
        time.sleep(chance.uniform(0.0, _LONGEST_S))
    finally:
        writer.kill()
        writer.wait()


@dataclass(frozen=True)
class SessionKills:
    """A session written again and again: kills, how often the first and the second were found, what was wrong."""

    kills: int
    found: tuple[int, int]
    problems: tuple[str, ...]


def kill_sessions(times: int, folder: Path, seed: int = 2) -> SessionKills:
    """Kill -9 a writer of one session folder; after each kill it must be read, whole, as one of the two it writes."""
    chance = random.Random(seed)
    target = folder / "session"
    found, problems = [0, 0], []
    for _ in range(times):
        _kill_a_writer("session_writer.py", (target,), chance)
        try:
            session = read_session(target)
            assert session.observations is not None
            found[{20: 0, 21: 1}[len(session.target_set.layouts)] if session.target_set else -1] += 1
        except Exception as error:  # whatever it is, it is what the study looks for
            problems.append(f"{type(error).__name__}: {error}")
    return SessionKills(times, (found[0], found[1]), tuple(problems))


@dataclass(frozen=True)
class Seen:
    """What a profile holds: calibrations, events of putting one to use, folders left half written."""

    calibrations: int
    events: int
    left_over: int


def look(profile: Path, results: list[Path]) -> Seen:
    """What is there; any error where something is not whole, or rig.json is not the rig in use."""
    opened = open_profile(profile)
    assert not opened.problems, opened.problems
    left_over = sum(path.name.startswith(".") for path in (profile / "history").iterdir())
    if opened.active_id is not None and (profile / "rig.json").exists():  # killed before its first renaming
        opened.rig()
        assert copy_is_right(opened), "rig.json is not the rig in use"
        assert _sha(profile / "rig.json") in {_sha(result / "rig.json") for result in results}
    return Seen(len(opened.entries), len(opened.applied), left_over)


def _sha(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _results(folder: Path) -> Iterator[Path]:
    for seed in (1, 2):
        result = folder / f"result{seed}"
        result.mkdir()
        (result / "rig.json").write_bytes(rig_bytes(make_rig(5, 40, seed)))
        yield result


def calibrated(session: Session) -> Calibration:
    """A session through the production entry point."""
    return calibrate(session, CalibrationSettings(), Context())


def box_of(calibration: Calibration) -> ComparisonVolume:
    """Where its points are, as `profile save` notes it."""
    points = calibration.points_mm[np.isfinite(calibration.points_mm).all(axis=1)]
    return ComparisonVolume(*np.percentile(points, (1, 99), axis=0))


def ratio(comparison: Comparison) -> float:
    """The worst camera's ray shift over the median of the rig."""
    rays = [camera.ray_rms_mm for camera in comparison.cameras]
    return max(rays) / float(np.median(rays))


@dataclass(frozen=True)
class Trial:
    """One comparison: what was moved (None: nothing), what was named, and the figures of the camera concerned."""

    camera: str | None
    move: tuple[float, float]
    named: tuple[str, ...]
    ratio: float
    centre_mm: float
    rotation_deg: float


def trials(rig: str, seed: int, options: SimulationOptions, moves: tuple[tuple[float, float], ...]) -> list[Trial]:
    """One rig calibrated, then again unchanged, then with one camera moved in each of the given ways."""
    session, _ = simulate_session(rig, seed, options)
    first = calibrated(session)
    volume = box_of(first)
    camera = session.cameras[seed % len(session.cameras)].id
    found = []
    for number, move in enumerate((None, *moves)):
        shift, turn = move or (0.0, 0.0)
        moved = None if move is None else CameraMove(camera, 0, shift, float(np.deg2rad(turn)))
        again = simulate_session(rig, seed, replace(options, moved=moved))
        noisy = observe_again(*again, np.random.default_rng(1000 * seed + number))[0]
        free, _ = compare(first.rig, calibrated(noisy).rig, volume)
        worst = free.cameras[0]
        named = tuple(c.id for c in free.cameras if c.moved)
        size = [float(np.linalg.norm(vector)) for vector in (worst.centre_mm, worst.rotation_deg)]
        found.append(Trial(None if move is None else camera, (shift, turn), named, ratio(free), size[0], size[1]))
    return found


def report(runs: int | None = None) -> Report:
    """Kills (100), and comparisons of 20 rigs A and 10 rigs B."""
    page = Report("Rig profiles", "python3 dev.py studies profiles")
    page.heading("Killed while writing")
    with tempfile.TemporaryDirectory() as folder:
        kills = kill_while_writing(runs or 100, Path(folder))
    page.text(
        "A process adds calibrations of 40 cameras to a profile and puts them to use without end; it is killed "
        "(SIGKILL) within 0.4 s and the profile opened. `rig.json` must be the rig in use."
    )
    page.table(
        ("kills", "calibrations added", "killed in the midst of a folder", "problems"),
        [(kills.kills, kills.added, kills.half_written, len(kills.problems))],
    )
    page.verdict(
        "always the old or the new profile, never neither",
        not kills.problems,
        "; ".join(kills.problems[:3]) or f"{kills.kills} kills",
    )
    page.text("")
    page.heading("A session killed while it is written")
    with tempfile.TemporaryDirectory() as folder:
        written = kill_sessions(runs or 100, Path(folder))
    page.text("A process writes two sessions in turn into one folder without end; killed in the same way, then read.")
    page.table(
        ("kills", "first found", "second found", "problems"), [(written.kills, *written.found, len(written.problems))]
    )
    page.verdict(
        "always one of the two sessions, whole",
        not written.problems,
        "; ".join(written.problems[:3]) or f"{written.kills} kills",
    )
    page.text("")
    _refused(page)
    for rig, count in (("rigA", runs or 20), ("rigB", (runs or 20) // 2)):
        _compared(page, rig, count)
    return page


def _refused(page: Report) -> None:
    page.heading("Full disk, read-only folder")
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        found = refusals(Path(folder))
    page.text(
        "A profile, a session and results on a file system of 2 MB that is then filled to the last byte, and in a "
        "folder that may only be read (by a process without the administrator's rights). After each writing that the "
        "system refuses: every file has its old contents, no other has appeared, the profile opens with the same "
        "calibration in use, the session is read."
    )
    rows = [
        (one.cause, one.action, re.sub(r"/\S*/(disk|closed)/", "", one.said), "yes" if one.intact else "NO")
        for one in found
    ]
    page.table(("cause", "what", "said", "nothing lost"), rows)
    bad = [f"{one.cause}, {one.action}" for one in found if not (one.clear and one.intact)]
    page.verdict(
        "a clear message and nothing lost", bool(found) and not bad, "; ".join(bad) or f"{len(found)} writings"
    )
    page.text("")


def _compared(page: Report, rig: str, count: int) -> None:
    page.heading(f"Two calibrations of {rig} compared")
    found = [one for seed in range(1, count + 1) for one in trials(rig, seed, OPTIONS[rig], MOVES)]
    rows = []
    for move in ((0.0, 0.0), *MOVES):
        own = [one for one in found if one.move == move]
        right = sum(one.named == (() if one.camera is None else (one.camera,)) for one in own)
        ratios = np.array([one.ratio for one in own])
        what = "nothing" if move == (0.0, 0.0) else f"{move[0]:g} mm, {move[1]:g} deg"
        size = (float(np.mean([getattr(one, name) for one in own])) for name in ("centre_mm", "rotation_deg"))
        rows.append((what, len(own), right, float(ratios.min()), float(np.median(ratios)), float(ratios.max()), *size))
    header = (
        "moved",
        "runs",
        "named rightly",
        "ratio min",
        "ratio median",
        "ratio max",
        "shift found mm",
        "turn found deg",
    )
    page.text("Ratio: the worst camera's rays in the volume over the median camera's; named are those above 4.")
    page.table(header, rows)
    page.verdict(f"{rig}: no camera named where none moved", rows[0][1] == rows[0][2], f"{rows[0][2]} of {rows[0][1]}")
    largest = rows[-1]
    page.verdict(
        f"{rig}: 0.3 mm with 0.03 deg named in every run, and no other camera",
        largest[1] == largest[2],
        f"{largest[2]} of {largest[1]}",
    )
    page.text("")
