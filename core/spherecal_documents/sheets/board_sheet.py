"""A board to print: a vector PDF at full size, with check rulers and what session.json has to say of it."""

from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal_boards.board_pattern import BoardPattern, figure
from spherecal_documents.sheets.pdf_canvas import POINTS_PER_MM as MM
from spherecal_documents.sheets.pdf_canvas import PdfCanvas
from spherecal_documents.sheets.sticker_sheet import FOOT_MM, HEAD_MM, LEFT_MM, SheetDrawing, draw_rulers
from spherecal_files.filesystem import write_whole

BOARD_PAGES_MM: dict[str, tuple[float, float]] = {
    "A4": (210.0, 297.0), "Letter": (215.9, 279.4), "A3": (297.0, 420.0), "A2": (420.0, 594.0),
    "A1": (594.0, 841.0), "A0": (841.0, 1189.0),
}  # fmt: skip


def write_board_sheet(path: Path, pattern: BoardPattern, page: str = "A4") -> None:
    """Write a board at full size as a PDF, the page turned where it fits better; same board, same bytes."""
    if page not in BOARD_PAGES_MM:
        raise InputError(Phrase("error-page", {"page": repr(page), "pages": list(BOARD_PAGES_MM)}))
    drawn = figure(pattern)
    across, down = drawn.size_mm
    width, height = _turned(BOARD_PAGES_MM[page], across, down, page)
    canvas = PdfCanvas(f"Board: {words(pattern)}", width * MM, height * MM)
    drawing = SheetDrawing(canvas, height)
    for x, y, a, b, grey in drawn.rectangles:
        drawing.rectangle(LEFT_MM + x, HEAD_MM + y, a, b, grey)
    for x, y, diameter, grey in drawn.discs:
        drawing.disc(LEFT_MM + x, HEAD_MM + y, diameter, grey)
    draw_rulers(drawing)
    drawing.text(LEFT_MM, height - HEAD_MM, f"{words(pattern)}; print at 100 %, on something flat and stiff")
    canvas.end_page()
    write_whole(Path(path), canvas.data())


def words(p: BoardPattern) -> str:
    """The board in one line, as `--board` takes it."""
    fields = [f"{p.kind}", f"rows={p.rows}", f"columns={p.columns}", f"pitch_mm={p.pitch_mm:g}"]
    if p.kind in ("charuco", "aprilgrid") and p.marker_mm is not None:
        fields += [f"marker_mm={p.marker_mm:g}", f"dictionary={p.dictionary}"]
    if p.legacy:
        fields.append("legacy=true")
    if p.rows_upward != (p.kind == "aprilgrid"):
        fields.append(f"rows_upward={str(p.rows_upward).lower()}")
    if p.rings:
        fields.append("rings=" + "+".join(f"{row}:{column}" for row, column in p.rings))
    if p.light:
        fields.append("polarity=light-on-dark")
    if p.dot_diameter_mm is not None:
        fields.append(f"dot_diameter_mm={p.dot_diameter_mm:g}")
    return ",".join(fields)


def _turned(size: tuple[float, float], across: float, down: float, page: str) -> tuple[float, float]:
    for width, height in (size, size[::-1]):
        if across <= width - LEFT_MM - HEAD_MM and down <= height - HEAD_MM - FOOT_MM:
            return width, height
    raise InputError(
        Phrase("error-board-page", {"width": across, "height": down, "page": page, "pages": list(BOARD_PAGES_MM)})
    )
