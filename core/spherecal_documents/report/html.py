"""The report as one HTML file: the same sections, vector graphics inside it, nothing loaded from anywhere."""

import io
import re
from collections.abc import Callable
from html import escape

import matplotlib

from spherecal_documents.report.bars_page import draw_errors, ordered_lengths
from spherecal_documents.report.content import Content
from spherecal_documents.report.language import label, language_now
from spherecal_documents.report.residuals_page import arrow_caption, arrow_scale, draw_histogram, draw_panel
from spherecal_documents.report.rig_page import draw_view
from spherecal_documents.report.rig_view import OBLIQUE, TOP, make_scene
from spherecal_documents.report.scene_picture import ScenePicture, draw_scene
from spherecal_documents.report.sheet import PageBox, Sheet
from spherecal_documents.report.tables import ReportTable, Section, made_by
from spherecal_documents.report.uncertainty_page import draw_layers, layers_of
from spherecal_documents.report.verdict_page import severity_word, signed_by
from spherecal_rigs.result_folder import Result

_STYLE = """
:root{color-scheme:light}
body{font:15px/1.45 system-ui,"DejaVu Sans",sans-serif;color:#1a1a1a;max-width:70rem;margin:0 auto;padding:1.5rem}
h1{margin:.2rem 0 1rem}
h2{border-bottom:2px solid #1a1a1a;margin:2.2rem 0 .6rem}
.verdict{display:flex;background:#f1f3f5;margin:.6rem 0;align-items:stretch}
.verdict b{color:#fff;padding:.8rem 1rem;min-width:11rem;font-size:1.25rem}
.verdict small{display:block;font-weight:400;font-size:.75rem}
.verdict p{margin:auto 1rem}
.figures{display:grid;grid-template-columns:repeat(auto-fill,minmax(13rem,1fr));gap:.6rem}
.figures div{border-top:2px solid#41546b}
.figures b{font-size:1.3rem}
small,.note{color:#5f6368}
table{border-collapse:collapse;font-size:.82rem;margin:.6rem 0 1.2rem;font-variant-numeric:tabular-nums}
th{color:#5f6368;font-weight:400;text-align:right;vertical-align:bottom;
border-bottom:1px solid #5f6368;padding:.15rem .6rem}
td{padding:.15rem .6rem;text-align:right;overflow-wrap:anywhere}
.l{text-align:left}
tr:nth-child(even) td{background:#f1f3f5}
.wide{overflow-x:auto}
.error{border-left:4px solid #a63200}
.warning{border-left:4px solid #8a6100}
.info{border-left:4px solid #41546b}
.finding{padding:.2rem .8rem;margin:.5rem 0}
svg{max-width:100%;height:auto}
.panels{display:grid;grid-template-columns:repeat(auto-fill,minmax(18rem,1fr));gap:1rem}
.sign{display:grid;grid-template-columns:repeat(3,1fr);gap:2rem;margin-top:4rem}
.sign div{border-top:1px solid #5f6368}
@media print{h2{break-after:avoid}
table,svg{break-inside:avoid}}
"""


def html_bytes(content: Content, result: Result, picture: ScenePicture | None = None) -> bytes:
    """The file; the same result gives the same bytes. To be called within `report_style`.

    `picture` None: that view is drawn.
    """
    title = label("report-spherecal-calibration-report")
    body = [f"<h1>{escape(title)}</h1>", *(_verdict(v.title, v.word, v.colour, v.sentence) for v in content.verdicts)]
    body.append('<div class="figures">')
    for value, unit, name, note in content.figures:
        body.append(
            f"<div>{escape(name)}<br><b>{escape(value)}</b> {escape(unit)}<br><small>{escape(note)}</small></div>"
        )
    body.append(f"</div><h2>{escape(label('report-findings'))}</h2>")
    if not content.findings:
        body.append(f"<p>{escape(label('report-none-there-is-nothing-to'))}</p>")
    body += [_finding(finding) for finding in content.findings]
    body += _pictures(result, picture)
    for section in content.sections:
        body += _section(section, result)
    signed = "".join(f"<div><small>{escape(name)}</small></div>" for name in signed_by())
    body.append(f"<h2>{escape(label('report-assessment'))}</h2>" + f'<div class="sign">{signed}</div>')
    body.append(f'<p class="note">{escape(made_by(result))}</p>')
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{escape(title)}</title>'
    start = f'<!DOCTYPE html>\n<html lang="{language_now().replace("_", "-")}">'
    page = f"{start}<head>{head}<style>{_STYLE}</style></head><body>\n"
    return (page + "\n".join(body) + "\n</body></html>\n").encode()


def _verdict(title: str, word: str, colour: str, sentence: str) -> str:
    block = f'<b style="background:{colour}"><small>{escape(title)}</small>{escape(word)}</b>'
    return f'<div class="verdict">{block}<p>{escape(sentence)}</p></div>'


def _finding(finding: dict) -> str:
    concerns = label("report-concerns", names=", ".join(finding["where"]))
    where = f"<br><small>{escape(concerns)}</small>" if finding["where"] else ""
    return (
        f'<div class="finding {finding["severity"]}"><b>{escape(severity_word(finding["severity"]))}</b> '
        f"{escape(finding['message'])} <span class=note>{escape(finding['hint'])}</span>{where}</div>"
    )


def _section(section: Section, result: Result) -> list[str]:
    body = [f"<h2>{escape(section.title)}</h2>"]
    if section.key == "departures":
        first, *rest = section.paragraphs
        body += [f"<p>{escape(first)}</p><ul>", *(f"<li>{escape(text)}</li>" for text in rest), "</ul>"]
    else:
        body += [f'<p class="note">{escape(text)}</p>' for text in section.paragraphs]
    if section.key == "bar-errors" and result.bars is not None and result.bars.measured:
        bars, keys = result.bars, ordered_lengths(result.bars)
        for start in range(0, len(keys), 10):
            body.append(_svg(175.0, 88.0, lambda s, b, part=keys[start : start + 10]: draw_errors(s, b, bars, part)))
    found = result.rig.length_map
    if section.key == "uncertainty" and found is not None and (layers := layers_of(found)) is not None:
        body.append(_svg(175.0, 46.0, lambda s, b: draw_layers(s, b, layers, found)))
    return body + [_table(table) for table in section.tables]


def _table(table: ReportTable) -> str:
    def cells(tag: str, row: tuple[str, ...]) -> str:
        return "".join(
            f"<{tag}{' class=l' if i < table.left else ''}>{escape(cell).replace(chr(10), '<br>')}</{tag}>"
            for i, cell in enumerate(row)
        )

    title = f"<p>{escape(table.title)}</p>" if table.title else ""
    rows = "".join(f"<tr>{cells('td', row)}</tr>" for row in table.rows)
    head = f"<thead><tr>{cells('th', table.columns)}</tr></thead>"
    return f'{title}<div class="wide"><table>{head}<tbody>{rows}</tbody></table></div>'


def _pictures(result: Result, picture: ScenePicture | None) -> list[str]:
    """The rig from two sides, the residuals of every camera."""
    if not result.rig.cameras:
        return []
    scene = make_scene(result)
    body = [f"<h2>{escape(label('report-rig-and-placements'))}</h2>"]
    views = (OBLIQUE, TOP)
    if picture is not None:
        body.append(_svg(175.0, picture.height_for(175.0), lambda s, b: draw_scene(s, b, picture, result.unit)))
        views = (TOP,)
    body += [_svg(175.0, 105.0, lambda s, b, v=view: draw_view(s, b, scene, v, result)) for view in views]
    body.append(f"<h2>{escape(label('report-residuals'))}</h2>")
    if not result.residuals.used.any():
        return [*body, f"<p>{escape(label('report-no-observation-was-used-so'))}</p>"]
    scale = arrow_scale(result)
    body.append(_svg(175.0, 52.0, lambda s, b: draw_histogram(s, b, result)))
    body.append(f'<p class="note">{escape(arrow_caption(scale, result))}</p><div class="panels">')
    for camera in result.rig.cameras:
        width, height = camera.image_size
        tall = 56.0 * height / width + 5.0
        body.append(_svg(56.0, tall, lambda s, b, name=camera.id: draw_panel(s, b, name, result, scale)))
    return [*body, "</div>"]


def _svg(width: float, height: float, draw: Callable[[Sheet, PageBox], None]) -> str:
    """A drawing as an svg element; text stays text."""
    sheet = Sheet(width, height)
    draw(sheet, PageBox(0.0, 0.0, width, height))
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "spherecal"}):
        sheet.figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
