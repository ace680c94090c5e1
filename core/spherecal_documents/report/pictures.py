"""Pictures of a result as PNG files, for documents and web pages."""

import io
from pathlib import Path

from spherecal.files.atomic import write_file_whole
from spherecal_documents.report.bars_page import draw_errors, ordered_lengths
from spherecal_documents.report.detection_page import choose_detections, draw_detection, find_session, read_grey
from spherecal_documents.report.guidance_picture import save_map_picture
from spherecal_documents.report.language import label
from spherecal_documents.report.residuals_page import arrow_scale, draw_key, draw_panel, magnification
from spherecal_documents.report.rig_page import draw_view
from spherecal_documents.report.rig_view import OBLIQUE, TOP, make_scene
from spherecal_documents.report.sheet import PageBox, Sheet
from spherecal_documents.report.style import SMALL_PT, report_style
from spherecal_rigs.result_folder import Result, read_result

_WIDTH_MM = 180.0
_DPI = 200  # 1417 px wide
_MARGIN_MM = 4.0
_MOST_PANELS = 12


def save_pictures(result_folder: Path, folder: Path, session_folder: Path | None = None) -> tuple[Path, ...]:
    """Write rig.png, residuals.png, bars.png, detection.png and lengths.png, as far as the result has what they show.

    Returns the files written. The folder is made where it is missing.

    `session_folder` None: it is looked for beside the result.
    """
    result = read_result(result_folder)
    detections = choose_detections(result, find_session(result, session_folder), most=1)
    sheets: dict[str, Sheet] = {}
    with report_style():
        if result.rig.cameras:
            sheets["rig.png"] = _rig(result)
            if result.residuals.used.any():
                sheets["residuals.png"] = _residuals(result)
        if result.bars is not None and result.bars.measured:
            sheet = Sheet(_WIDTH_MM, 90.0)
            draw_errors(sheet, PageBox(2.0, 3.0, _WIDTH_MM - 4.0, 86.0), result.bars, ordered_lengths(result.bars)[:12])
            sheets["bars.png"] = sheet
        for detection in detections:
            image = read_grey(detection.path)
            height = _WIDTH_MM * image.shape[0] / image.shape[1]
            sheets["detection.png"] = Sheet(_WIDTH_MM, height)
            draw_detection(sheets["detection.png"], PageBox(0, 0, _WIDTH_MM, height), image, detection)
        pictures = {name: _png(sheet) for name, sheet in sheets.items()}
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in pictures.items():
        write_file_whole(folder / name, data)
    written = [folder / name for name in pictures]
    if result.rig.length_map is not None and result.rig.cameras:
        written.append(folder / "lengths.png")
        save_map_picture(result.rig, result.rig.length_map, written[-1])
    return tuple(written)


def _rig(result: Result) -> Sheet:
    sheet = Sheet(_WIDTH_MM, 96.0)
    left, right = PageBox(_MARGIN_MM, 3.0, _WIDTH_MM - 2 * _MARGIN_MM, 91.0).grid(1, 2, 6.0)
    scene = make_scene(result)
    draw_view(sheet, left, scene, OBLIQUE, result)
    draw_view(sheet, right, scene, TOP, result)
    return sheet


def _residuals(result: Result) -> Sheet:
    """The panels of the first cameras, the worst of them first, with their key."""
    cameras = sorted(result.rig.cameras, key=lambda camera: -(camera.rms_px or 0.0))[:_MOST_PANELS]
    columns = min(4, len(cameras))
    rows = -(-len(cameras) // columns)
    width = (_WIDTH_MM - 2 * _MARGIN_MM - 4.0 * (columns - 1)) / columns
    height = width * max(camera.image_size[1] / camera.image_size[0] for camera in cameras) + 5.0
    sheet = Sheet(_WIDTH_MM, rows * (height + 4.0) + 15.0)
    scale = arrow_scale(result)
    box = PageBox(_MARGIN_MM, 2.0, _WIDTH_MM - 2 * _MARGIN_MM, rows * (height + 4.0) - 4.0)
    for place, camera in zip(box.grid(rows, columns), cameras, strict=False):
        draw_panel(sheet, place, camera.id, result, scale)
    foot = box.y + box.height + 5.0
    draw_key(sheet, PageBox(_MARGIN_MM, foot, 160.0, 8.0), scale)
    sheet.text(
        _WIDTH_MM - _MARGIN_MM,
        foot + 7.5,
        label("report-arrows-magnified-times", times=magnification(scale)),
        SMALL_PT,
        align="right",
    )
    return sheet


def _png(sheet: Sheet) -> bytes:
    buffer = io.BytesIO()
    sheet.figure.savefig(buffer, format="png", dpi=_DPI, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()
