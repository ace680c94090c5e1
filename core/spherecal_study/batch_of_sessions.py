"""A folder of sessions calibrated, and the page of all."""

import csv
import hashlib
import io
import json
import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spherecal.base.context import Context
from spherecal.base.errors import InputError, OutputError, SpherecalError
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.detect.session_images import observed
from spherecal.steps.settings import CalibrationSettings
from spherecal_documents.report.model import Cell, Strong
from spherecal_documents.report.style import BAD, CAUTION, GOOD, NONE, report_style, significant
from spherecal_files.atomic import RESULT, SESSION
from spherecal_files.cells import cell
from spherecal_files.filesystem import read_below, remove_below, shown_name, write_together
from spherecal_files.json_file import json_bytes, plain_fields
from spherecal_files.read_session import read_session
from spherecal_files.rig_file import read_rig
from spherecal_files.write_result import write_result
from spherecal_files.write_verification import write_verification
from spherecal_study.executor import Result, Trial, Workers, run_trials, trial_file
from spherecal_study.study_page import Document
from spherecal_verify.verification import Verification
from spherecal_verify.verify_bars import verify

_WORDS = {
    "valid": Strong("valid", GOOD), "use with care": Strong("with care", CAUTION),
    "not valid": Strong("not valid", BAD), "failed": Strong("failed", BAD),
}  # fmt: skip
_VERDICTS = {"consistent": Strong("consistent", GOOD), "inconsistent": Strong("inconsistent", BAD)}


def batch_page(rows: Sequence[dict[str, Any]], settings: Mapping[str, Any]) -> Document:
    """The document with one line for each session; the same rows give the same bytes."""
    document = Document("Batch of calibrations", kind="Batch", title="SphereCal batch")
    counts = {word: sum(row["outcome"] == word for row in rows) for word in _WORDS}
    said = ", ".join(f"{count} {word}" for word, count in counts.items() if count)
    document.paragraph(f"{len(rows)} sessions: {said}.")
    document.caption(
        "Settings: " + ", ".join(f"{name} {_word(value)}" for name, value in settings.items()) + ". Each result lies "
        "in results/ under the session's name, as `spherecal calibrate` writes it; the same table is in batch.csv."
    )
    heads = (
        "session", "outcome", "form", "scale", "bars", "cameras", "rms px", "lengths", "mean\nerror mm", "sd mm",
        "largest\nmm",
    )  # fmt: skip
    document.table(heads, [_row(row) for row in rows], 5)
    record = [row for row in rows if row["message"]]
    if record:
        document.begin_section("What was wrong")
        for row in record:
            document.caption(f"{row['session']}: {row['message']}")
    return document


def _row(row: dict[str, Any]) -> list[Cell]:
    cameras = NONE if row["cameras"] is None else f"{row['cameras_placed']} of {row['cameras']}"
    return [
        row["session"], _WORDS[row["outcome"]], row["form"] or NONE, (row["scale"] or NONE).replace("_", " "),
        _VERDICTS.get(row["verification"] or "", NONE), cameras, significant(row["rms_px"], 3),
        str(row["lengths"]) if row["lengths"] else NONE, significant(row["mean_error_mm"], 3),
        significant(row["sd_mm"], 3), significant(row["max_abs_error_mm"], 3),
    ]  # fmt: skip


def _word(value: Any) -> str:
    return {True: "yes", False: "no"}.get(value, str(value)) if isinstance(value, bool) else str(value)


RESULTS, TRIALS = "results", "trials"
_OURS = {RESULTS, TRIALS, "batch.csv", "batch.json", "batch.pdf"}
_MOST_BYTES = 64 << 20
COLUMNS = (
    "session", "outcome", "cameras_placed", "cameras", "rms_px", "sigma0", "form", "scale", "lengths", "mean_error_mm",
    "sd_mm", "max_abs_error_mm", "verification", "message",
)  # fmt: skip


@dataclass(frozen=True)
class Batch:
    """What became of a folder of sessions: one row each (see COLUMNS), by name, and the page that lists them."""

    rows: list[Result]
    page: Path

    @property
    def valid(self) -> bool:
        """Whether every session has a valid result, be some of them to be used with care."""
        return all(row["outcome"] in ("valid", "use with care") for row in self.rows)


def find_sessions(folder: Path, output: Path) -> list[Path]:
    """The session folders below a folder, by name."""
    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder.", "Name the folder that holds the sessions.")
    ours = output.resolve()
    found: list[Path] = []
    for parent, inner, files in os.walk(folder, followlinks=False):
        inner[:] = sorted(name for name in inner if Path(parent, name).resolve() != ours and not name.startswith("."))
        if SESSION.file in files:
            found.append(Path(parent))
            inner.clear()  # what lies in a session belongs to it
    if not found:
        raise InputError(f"{folder}: no folder in it holds a session.json.", "Name the folder that holds the sessions.")
    return sorted(found, key=lambda path: path.relative_to(folder).as_posix())


def run_batch(folder: Path, output: Path, settings: Mapping[str, Any], workers: Workers, context: Context) -> Batch:
    """Calibrate all sessions below a folder into `output/results`, but for those done and unchanged; page and CSV."""
    sessions = find_sessions(folder, output)
    if output.is_dir() and (others := sorted(one.name for one in output.iterdir() if one.name not in _OURS)):
        raise OutputError(
            f"{output}: holds something else than an earlier batch ({shown_name(others[0])}) and is left as it is.",
            "Name a new or empty output folder.",
        )
    names = [path.relative_to(folder).as_posix() for path in sessions]
    names = [folder.resolve().name if name == "." else name for name in names]
    listed = [
        Trial(
            "session",
            {
                "session": str(path.resolve()),
                "output": str((output / RESULTS / name).resolve()),
                "fingerprint": fingerprint_of(path),
                "settings": dict(settings),
            },
        )
        for path, name in zip(sessions, names, strict=True)
    ]
    for trial in listed:
        if not (Path(trial.settings["output"]) / RESULT.file).is_file():
            _forget(output, trial)
    died = _failed("It took its worker process down every time. Is there enough memory? Try --workers 1.")
    results = run_trials(listed, output / TRIALS, workers, context, lambda _: died)
    for trial, result in zip(listed, results, strict=True):
        if result["outcome"] == "failed":
            _forget(output, trial)
    rows = [{"session": name, **result} for name, result in zip(names, results, strict=True)]
    context.report("drawing the page", 0.0)
    with report_style():
        page = batch_page(rows, settings).pdf()
    tables = {"batch.csv": _csv(rows), "batch.json": json_bytes({"sessions": rows, "settings": dict(settings)})}
    write_together(output, {**tables, "batch.pdf": page})
    return Batch(rows, output / "batch.pdf")


def fingerprint_of(folder: Path) -> str:
    """A hash that changes with session.json (or its error) and when a file is replaced; reads no images."""
    try:
        digest = hashlib.sha256(read_below(folder, SESSION.file, _MOST_BYTES))
    except InputError as error:
        digest = hashlib.sha256(str(error).encode(errors="replace"))
    for parent, inner, files in os.walk(folder):
        inner.sort()
        for name in sorted(files):
            path = Path(parent, name)
            status = path.stat() if path.exists() else path.lstat()
            digest.update(
                json.dumps([path.relative_to(folder).as_posix(), status.st_size, status.st_mtime_ns]).encode()
            )
    return digest.hexdigest()


def calibrate_session(session: str, output: str, fingerprint: str, settings: dict[str, Any]) -> Result:
    """Calibrate a session folder, verify it by its check bars, write the result; a row (COLUMNS), also of errors."""
    del fingerprint
    try:
        return _calibrated(Path(session), Path(output), CalibrationSettings(**settings))
    except SpherecalError as error:
        return _failed(str(error))
    except Exception as error:
        logging.getLogger("spherecal").exception("%s", session)
        return _failed(f"The program failed: {type(error).__name__}: {error}. Calibrate it alone with --log FILE.")


def _calibrated(folder: Path, output: Path, settings: CalibrationSettings) -> Result:
    session = read_session(folder)
    calibration = calibrate(session, settings)
    output.parent.mkdir(parents=True, exist_ok=True)
    write_result(calibration, output, {"method": calibration.method, "seed": settings.seed})
    rig, quality = calibration.rig, calibration.rig.quality
    errors = [finding.message for finding in quality.findings if finding.severity == "error"]
    return {
        "outcome": quality.verdict.replace("-", " "),
        "cameras_placed": len(rig.cameras),
        "cameras": len(session.cameras),
        "rms_px": quality.rms_px,
        "sigma0": quality.sigma0,
        "form": calibration.method,
        "scale": rig.scale.source,
        **_verified(session, calibration, output),
        "message": errors[0] if errors else "",
    }


def _verified(session: Session, calibration: Calibration, output: Path) -> Result:
    """Verify with the session's check bars, as `spherecal verify` does, beside the result; None where it has none."""
    check = {bar.id for bar in session.bars if bar.role == "check"}
    if len(calibration.rig.cameras) < 2 or not any(pose.bar in check for pose in session.bar_poses):
        return _figures(None)
    path = output / RESULT.file
    verification = verify(observed(session, Context(), bar_poses_only=True), read_rig(path))
    write_verification(verification, output, path)
    return _figures(verification)


def _figures(verification: Verification | None) -> Result:
    if verification is None:
        return {"lengths": 0, **dict.fromkeys(("mean_error_mm", "sd_mm", "max_abs_error_mm", "verification"))}
    overall = plain_fields(verification.overall, "mean_error_mm sd_mm max_abs_error_mm")
    return {"lengths": verification.overall.n, **overall, "verification": verification.decision.verdict}


def _failed(message: str) -> Result:
    nothing = dict.fromkeys(COLUMNS[2:-1])
    return {"outcome": "failed", **nothing, "message": message}


def _forget(output: Path, trial: Trial) -> None:
    if (output / TRIALS).is_dir():
        remove_below(output / TRIALS, trial_file(output / TRIALS, trial).name)


def _csv(rows: Sequence[Result]) -> bytes:
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, lineterminator="\n", extrasaction="ignore")
    table.writeheader()
    table.writerows({name: cell(one) if isinstance(one := row[name], str) else one for name in COLUMNS} for row in rows)
    return text.getvalue().encode()
