"""The table page of a batch: every session's outcome, and what went wrong where it did."""

from collections.abc import Mapping, Sequence
from typing import Any

from spherecal import __version__
from spherecal_documents.report.document import Cell, Column, Document
from spherecal_documents.report.style import BAD, CAUTION, GOOD, NONE, SMALL_PT, SOFT, significant

_WORDS = {
    "valid": ("valid", GOOD), "use with care": ("with care", CAUTION), "not valid": ("not valid", BAD),
    "failed": ("failed", BAD),
}  # fmt: skip
_VERDICTS = {"consistent": ("consistent", GOOD), "inconsistent": ("inconsistent", BAD)}


def batch_page(rows: Sequence[dict[str, Any]], settings: Mapping[str, Any]) -> Document:
    """The document with one line for each session; the same rows give the same bytes."""
    document = Document("A4", "SphereCal batch", f"Batch by SphereCal {__version__}")
    document.begin_section("Batch of calibrations")
    document.y += 2.0
    counts = {word: sum(row["outcome"] == word for row in rows) for word in _WORDS}
    said = ", ".join(f"{count} {word}" for word, count in counts.items() if count)
    document.paragraph(f"{len(rows)} sessions: {said}.")
    document.caption(
        "Settings: " + ", ".join(f"{name} {_word(value)}" for name, value in settings.items()) + ". Each result lies "
        "in results/ under the session's name, as `spherecal calibrate` writes it; the same table is in batch.csv."
    )
    columns = [
        Column("session", 50.0, "left"),
        Column("outcome", 17.0, "left"),
        Column("cameras", 16.0),
        Column("rms px", 16.0),
        Column("form", 15.0, "left"),
        Column("scale", 22.0, "left"),
        Column("lengths", 15.0),
        Column("mean\nerror mm", 18.0),
        Column("sd mm", 16.0),
        Column("largest\nmm", 16.0),
        Column("bars", 22.0, "left"),
    ]
    document.table(columns, [_row(row) for row in rows])
    record = [row for row in rows if row["message"]]
    if record:
        document.begin_section("What was wrong", 25.0, new_page=False)
        for row in record:
            document.paragraph(f"{row['session']}: {row['message']}", SMALL_PT, SOFT)
    return document


def _row(row: dict[str, Any]) -> list[Cell]:
    cameras = NONE if row["cameras"] is None else f"{row['cameras_placed']} of {row['cameras']}"
    return [
        row["session"],
        _WORDS[row["outcome"]],
        cameras,
        significant(row["rms_px"], 3),
        row["form"] or NONE,
        (row["scale"] or NONE).replace("_", " "),
        str(row["lengths"]) if row["lengths"] else NONE,
        significant(row["mean_error_mm"], 3),
        significant(row["sd_mm"], 3),
        significant(row["max_abs_error_mm"], 3),
        _VERDICTS.get(row["verification"] or "", NONE),
    ]


def _word(value: Any) -> str:
    return {True: "yes", False: "no"}.get(value, str(value)) if isinstance(value, bool) else str(value)
