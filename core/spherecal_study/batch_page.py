"""The table page of a batch: every session's outcome, and what went wrong where it did."""

from collections.abc import Mapping, Sequence
from typing import Any

from spherecal import __version__
from spherecal_documents.report.model import Cell, Strong
from spherecal_documents.report.style import BAD, CAUTION, GOOD, NONE, significant
from spherecal_study.document import Document

_WORDS = {
    "valid": Strong("valid", GOOD), "use with care": Strong("with care", CAUTION),
    "not valid": Strong("not valid", BAD), "failed": Strong("failed", BAD),
}  # fmt: skip
_VERDICTS = {"consistent": Strong("consistent", GOOD), "inconsistent": Strong("inconsistent", BAD)}


def batch_page(rows: Sequence[dict[str, Any]], settings: Mapping[str, Any]) -> Document:
    """The document with one line for each session; the same rows give the same bytes."""
    document = Document("SphereCal batch", "Batch of calibrations", f"Batch by SphereCal {__version__}")
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
        row["session"],
        _WORDS[row["outcome"]],
        row["form"] or NONE,
        (row["scale"] or NONE).replace("_", " "),
        _VERDICTS.get(row["verification"] or "", NONE),
        cameras,
        significant(row["rms_px"], 3),
        str(row["lengths"]) if row["lengths"] else NONE,
        significant(row["mean_error_mm"], 3),
        significant(row["sd_mm"], 3),
        significant(row["max_abs_error_mm"], 3),
    ]


def _word(value: Any) -> str:
    return {True: "yes", False: "no"}.get(value, str(value)) if isinstance(value, bool) else str(value)
