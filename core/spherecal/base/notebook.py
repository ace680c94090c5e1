"""What a notebook shows of a result: a sentence and a table."""

from collections.abc import Mapping, Sequence
from html import escape

_MOST = 30  # rows


def html_table(said: str, columns: Mapping[str, Sequence[object]]) -> str:
    """A sentence, and under it the columns as a table; the first rows of many."""
    rows = list(zip(*columns.values(), strict=True))
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    cells = ["".join(f"<td>{escape(_cell(value))}</td>" for value in row) for row in rows[:_MOST]]
    more = f"<p>and {len(rows) - _MOST} more</p>" if len(rows) > _MOST else ""
    return f"<p>{escape(said)}</p><table><tr>{head}</tr>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>{more}"


def _cell(value: object) -> str:
    return "-" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
