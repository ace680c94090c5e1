"""The report as one HTML file: vector graphics inside it, nothing loaded from anywhere."""

from collections.abc import Callable, Iterable
from html import escape
from typing import Any

from spherecal.base.resources import resource_path
from spherecal_documents.report import model
from spherecal_documents.report.language import language_now

_STYLE = "\n" + resource_path("report.css").read_text(encoding="utf-8")


def html_bytes(report: model.Report) -> bytes:
    """The file; the same report gives the same bytes. To be called within `report_style`."""
    title = escape(report.title)
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{title}</title>'
    start = f'<!DOCTYPE html>\n<html lang="{language_now().replace("_", "-")}">'
    body = [f'<p class="notice">{escape(report.notice)}</p>'] if report.notice else []
    body.append(f"<h1>{escape(report.heading)} <small>{escape(report.beside)}</small></h1>")
    body += map(_section, report.sections)
    body.append(f'<p class="note">{escape(report.foot)}</p>')
    page = f"{start}<head>{head}<style>{_STYLE}</style></head><body>\n"
    return (page + "\n".join(body) + "\n</body></html>\n").encode()


def _section(section: model.Section) -> str:
    title = f"<h2>{escape(section.title)}</h2>" if section.title else ""
    return "\n".join((title, *(_BLOCKS[type(block)](block) for block in section.blocks)))


def _verdict(block: model.Verdict) -> str:
    word = f'<b style="background:{block.colour}"><small>{escape(block.title)}</small>{escape(block.word)}</b>'
    return f'<div class="verdict">{word}<p>{escape(block.sentence)}</p></div>'


def _key_figures(block: model.KeyFigures) -> str:
    figures = (
        f"<div>{escape(f.name)}<br><b>{escape(f.value)}</b> {escape(f.unit)}<br><small>{escape(f.note)}</small></div>"
        for f in block.figures
    )
    return _within('div class="figures"', figures)


def _finding(block: model.FindingText) -> str:
    concerns = f"<br><small>{escape(block.concerns)}</small>" if block.concerns else ""
    return (
        f'<div class="finding" style="color:{block.colour}"><b>{escape(block.word)}</b> '
        f'<span>{escape(block.message)} <span class="note">{escape(block.hint)}</span></span>{concerns}</div>'
    )


def _table(table: model.Table) -> str:
    def cell(value: model.Cell) -> str:
        if isinstance(value, model.Strong):
            return f'<b style="color:{value.colour}">{escape(value.text)}</b>'
        return escape(value).replace("\n", "<br>")

    def cells(tag: str, row: tuple[model.Cell, ...]) -> str:
        return "".join(f"<{tag}{' class=l' * (i < table.left)}>{cell(one)}</{tag}>" for i, one in enumerate(row))

    title = f"<p>{escape(table.title)}</p>" if table.title else ""
    rows = "".join(f"<tr>{cells('td', row)}</tr>" for row in table.rows)
    head = f"<thead><tr>{cells('th', table.columns)}</tr></thead>"
    return f'{title}<div class="wide"><table>{head}<tbody>{rows}</tbody></table></div>'


def _within(tag: str, parts: Iterable[str]) -> str:
    return f"<{tag}>{''.join(parts)}</{tag.split(maxsplit=1)[0]}>"


_BLOCKS: dict[type, Callable[[Any], str]] = {
    model.Paragraph: lambda one: f'<p class="{one.style}">{escape(one.text)}</p>',
    model.KeyValues: lambda one: _within("dl", (f"<dt>{escape(a)}</dt><dd>{escape(b)}</dd>" for a, b in one.rows)),
    model.Panels: lambda one: _within('div class="panels"', (figure.svg() for figure in one.figures)),
    model.Signature: lambda one: _within(
        'div class="sign"', (f"<div><small>{escape(name)}</small></div>" for name in one.names)
    ),
    model.Verdict: _verdict, model.KeyFigures: _key_figures, model.FindingText: _finding, model.Table: _table,
    model.Figure: model.Figure.svg,
}  # fmt: skip
