"""The report as one HTML file: vector graphics inside it, nothing loaded from anywhere."""

from collections.abc import Callable
from html import escape
from typing import Any

from spherecal_documents.report import model
from spherecal_documents.report.language import language_now

_STYLE = """
:root{color-scheme:light}
body{font:15px/1.45 Inter,system-ui,"DejaVu Sans",sans-serif;color:#1a1a1a;max-width:70rem;margin:0 auto;padding:1.5rem}
h1{margin:.2rem 0 1rem}
h1 small{float:right;font-size:.9rem;font-weight:400;margin-top:.9rem}
h2{border-bottom:2px solid #1a1a1a;margin:2.2rem 0 .6rem}
.verdict{display:flex;background:#f1f3f5;margin:.6rem 0;align-items:stretch}
.verdict b{color:#fff;padding:.8rem 1rem;flex:0 0 13rem;font-size:1.25rem}
.verdict small{display:block;font-weight:400;font-size:.75rem;color:#fff}
.verdict p{margin:auto 1rem}
.figures{display:grid;grid-template-columns:repeat(auto-fill,minmax(15rem,1fr));gap:.6rem;margin:1rem 0}
.figures div{border-top:2px solid #41546b}
.figures b{font-size:1.3rem}
small,.note,dt{color:#5f6368}
.note{font-size:.85rem}
.alarm,.notice{color:#a63200}
.notice{text-align:center;font-weight:700}
.subtitle{font-weight:700}
.item{margin:.2rem 0 .2rem 1.2rem;display:list-item}
dl{display:grid;grid-template-columns:max-content 1fr;gap:.2rem 1.5rem;font-size:.85rem}
dd{margin:0;overflow-wrap:anywhere}
table{border-collapse:collapse;font-size:.82rem;margin:.6rem 0 1.2rem;font-variant-numeric:tabular-nums}
th{color:#5f6368;font-weight:400;text-align:right;vertical-align:bottom;
border-bottom:1px solid #5f6368;padding:.15rem .6rem}
td{padding:.15rem .6rem;text-align:right;vertical-align:top;overflow-wrap:anywhere}
.l{text-align:left}
tr:nth-child(even) td{background:#f1f3f5}
.wide{overflow-x:auto}
.finding{padding:.2rem .8rem;margin:.5rem 0;border-left:4px solid}
.finding span{color:#1a1a1a}
.finding .note{color:#5f6368;font-size:1em}
svg{width:100%;height:auto;display:block;margin:.6rem 0}
.panels{display:grid;grid-template-columns:repeat(auto-fill,minmax(18rem,1fr));gap:1rem}
.sign{display:grid;grid-template-columns:repeat(3,1fr);gap:2rem;margin-top:4rem}
.sign div{border-top:1px solid #5f6368}
@media print{h2{break-after:avoid}
table,svg{break-inside:avoid}}
"""


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


def _paragraph(block: model.Paragraph) -> str:
    return f'<p class="{block.style}">{escape(block.text)}</p>'


def _verdict(block: model.Verdict) -> str:
    word = f'<b style="background:{block.colour}"><small>{escape(block.title)}</small>{escape(block.word)}</b>'
    return f'<div class="verdict">{word}<p>{escape(block.sentence)}</p></div>'


def _key_figures(block: model.KeyFigures) -> str:
    figures = (
        f"<div>{escape(f.name)}<br><b>{escape(f.value)}</b> {escape(f.unit)}<br><small>{escape(f.note)}</small></div>"
        for f in block.figures
    )
    return f'<div class="figures">{"".join(figures)}</div>'


def _finding(block: model.FindingText) -> str:
    concerns = f"<br><small>{escape(block.concerns)}</small>" if block.concerns else ""
    return (
        f'<div class="finding" style="color:{block.colour}"><b>{escape(block.word)}</b> '
        f'<span>{escape(block.message)} <span class="note">{escape(block.hint)}</span></span>{concerns}</div>'
    )


def _key_values(block: model.KeyValues) -> str:
    return f"<dl>{''.join(f'<dt>{escape(name)}</dt><dd>{escape(said)}</dd>' for name, said in block.rows)}</dl>"


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


def _panels(block: model.Panels) -> str:
    return f'<div class="panels">{"".join(figure.svg() for figure in block.figures)}</div>'


def _signature(block: model.Signature) -> str:
    return f'<div class="sign">{"".join(f"<div><small>{escape(name)}</small></div>" for name in block.names)}</div>'


_BLOCKS: dict[type, Callable[[Any], str]] = {
    model.Paragraph: _paragraph, model.Verdict: _verdict, model.KeyFigures: _key_figures, model.FindingText: _finding,
    model.KeyValues: _key_values, model.Table: _table, model.Figure: model.Figure.svg, model.Panels: _panels,
    model.Signature: _signature,
}  # fmt: skip
