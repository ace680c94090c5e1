"""Texts in tables for spreadsheets, which take some of them for formulas."""

import re

# A German spreadsheet begins a new cell at `;`, others at a tab or what else their user chose. Quotes before a formula
# belong to it, so that every text comes back as it was.
_BEGINS = r"(^|[,;|\t\r\n])"
_FORMULA = re.compile(rf"{_BEGINS}(?='*[=+\-@\t\r])")
_MARKED = re.compile(rf"{_BEGINS}'(?='*[=+\-@\t\r])")


def cell(text: str) -> str:
    """A text for a spreadsheet: what would begin a formula there is marked as text, as spreadsheets do it (')."""
    return _FORMULA.sub(r"\1'", text)


def from_cell(text: str) -> str:
    """The text of a cell as `cell` writes it."""
    return _MARKED.sub(r"\1", text)
