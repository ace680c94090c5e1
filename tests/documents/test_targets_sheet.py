"""The printable sheet: places of the dots in the page, rulers, ids, and the printed scale."""

import re
import shutil
import subprocess
import zlib
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from PIL import Image

from spherecal.base.errors import InputError, OutputError
from spherecal.targets.family import DOTS, make_target_set
from spherecal.targets.target_set import Polarity
from spherecal_documents.sheets.pdf_canvas import PdfCanvas
from spherecal_documents.sheets.sticker_sheet import PAGE_SIZES_MM, Page, rings, scaled, sticker_places, write_sheet

MM_PER_POINT = 25.4 / 72
NUMBER = r"(-?[\d.]+)"


def pages(path) -> list[str]:
    """The drawing commands of each page."""
    streams = re.findall(rb"stream\r?\n(.*?)\nendstream", path.read_bytes(), re.DOTALL)
    return [zlib.decompress(stream).decode("latin-1") for stream in streams]


def circles(page: str, height_mm: float) -> np.ndarray:
    """Centre x, y (from the top left) and diameter of every circle on a page, (n, 3) mm."""
    curve = rf"\s+{NUMBER} {NUMBER} {NUMBER} {NUMBER} {NUMBER} {NUMBER} c"
    found = re.findall(rf"{NUMBER} {NUMBER} m{curve * 4}", page)
    values = np.array(found, dtype=float) * MM_PER_POINT
    on_curve = values.reshape(len(values), -1, 2)[:, [0, 3, 6, 9]]
    middle = on_curve.mean(axis=1)
    diameter = 2 * np.linalg.norm(on_curve - middle[:, None], axis=2).mean(axis=1)
    return np.column_stack([middle[:, 0], height_mm - middle[:, 1], diameter])


@pytest.mark.parametrize(("page", "size_mm"), [("A4", 28.0), ("Letter", 28.0), ("A4", 14.0)])
def test_dots_are_printed_where_the_layout_says(tmp_path, page, size_mm):
    targets = make_target_set(100, size_mm=size_mm, start_id=9)
    write_sheet(tmp_path / "sheet.pdf", targets, page)
    places = sticker_places(page, size_mm)
    ids = iter(range(9, 109))
    for drawing in pages(tmp_path / "sheet.pdf")[1:]:
        printed = circles(drawing, PAGE_SIZES_MM[page][1]).reshape(-1, 8, 3)
        for dots, corner in zip(printed, places, strict=False):
            expected = targets.places(next(ids), DOTS) + corner + np.array([size_mm / 2, size_mm / 2])
            np.testing.assert_allclose(dots[:, :2], expected, atol=0.005)
            np.testing.assert_allclose(dots[:, 2], targets.dot_diameter_mm, atol=0.005)
    assert next(ids, None) is None


def test_rulers_are_100_mm_long(tmp_path):
    write_sheet(tmp_path / "sheet.pdf", make_target_set(5))
    ends = np.array(re.findall(rf"{NUMBER} {NUMBER} m {NUMBER} {NUMBER} l", pages(tmp_path / "sheet.pdf")[1]), float)
    reach = np.abs(ends[:, 2:] - ends[:, :2]) * MM_PER_POINT
    for axis in (0, 1):
        assert np.isclose(reach[:, axis], 100.0, atol=0.005).sum() == 1


def test_stickers_do_not_overlap_and_stay_on_the_page():
    for page, (width, height) in PAGE_SIZES_MM.items():
        places = np.array(sticker_places(cast(Page, page), 28.0))
        assert len(places) == 48
        assert places.min() >= 6.0
        assert (places + 28.0 <= [width - 6.0, height - 6.0]).all()
        apart = np.abs(places[:, None] - places).max(axis=2)
        assert apart[apart > 0].min() > 28.0


def test_polarity_paints_the_dots_white_or_black(tmp_path):
    cases: tuple[tuple[Polarity, str], ...] = (("light-on-dark", "1"), ("dark-on-light", "0"))
    for polarity, grey in cases:
        write_sheet(tmp_path / "sheet.pdf", make_target_set(1, polarity=polarity))
        before_dots = re.findall(rf"{NUMBER} g\s+n\s+{NUMBER} {NUMBER} m\s+{NUMBER}", pages(tmp_path / "sheet.pdf")[1])
        assert {float(match[0]) for match in before_dots} == {float(grey)}


def test_same_targets_same_bytes(tmp_path):
    for name in ("a.pdf", "b.pdf"):
        write_sheet(tmp_path / name, make_target_set(60))
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()


def test_another_program_reads_the_sheet(tmp_path):
    """Poppler's, strictly: it complains about a table or a length that is wrong; every dot lies under its pixel."""
    if shutil.which("pdftoppm") is None:
        pytest.skip("needs pdftoppm (poppler-utils)")
    targets = make_target_set(3)
    write_sheet(tmp_path / "sheet.pdf", targets)
    command = ["pdftoppm", "-r", "254", "-gray", "-f", "2", "-l", "2", str(tmp_path / "sheet.pdf"), str(tmp_path / "p")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    image = np.asarray(Image.open(next(tmp_path.glob("p*.pgm"))))
    assert abs(image.shape[0] - 2970) <= 1 and abs(image.shape[1] - 2100) <= 1
    for number, corner in zip((1, 2, 3), sticker_places("A4", 28.0), strict=False):
        for x, y in (targets.places(number, DOTS) + corner + 14.0) * 10:
            assert image[round(y), round(x)] == 255 and image[round(y), round(x) + 22] == 0


def test_text_that_no_font_has_is_still_a_document():
    canvas = PdfCanvas("Maße (ä) 中", 100, 100)
    canvas.text(10, 10, r"back\slash (brackets) ü 中", 8)
    canvas.end_page()
    data = canvas.data()
    assert rb"(Ma\337e \050\344\051 ?)" in data
    (drawn,) = re.findall(rb"stream\n(.*?)\nendstream", data, re.DOTALL)
    assert rb"(back\134slash \050brackets\051 \374 ?) Tj" in zlib.decompress(drawn)
    start = int(data.rsplit(b"startxref\n", 1)[1].split()[0])
    assert data[start:].startswith(b"xref\n")


def test_what_cannot_be_printed_is_refused(tmp_path):
    targets = make_target_set(10)
    with pytest.raises(InputError, match="is empty"):
        write_sheet(tmp_path / "s.pdf", replace(targets, layouts={}))
    with pytest.raises(InputError, match="A5"):
        write_sheet(tmp_path / "s.pdf", targets, "A5")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="does not fit"):
        write_sheet(tmp_path / "s.pdf", make_target_set(1, size_mm=300.0))
    with pytest.raises(OutputError, match="cannot be written"):
        write_sheet(tmp_path / "no" / "s.pdf", targets)
    assert not list(tmp_path.iterdir())


def test_measured_rulers_go_into_the_target_set():
    printed = scaled(make_target_set(3), 99.8, 100.3)
    a, e = printed.layouts[2]["A"], printed.layouts[2]["E"]
    np.testing.assert_allclose(e - a, [20 * 0.998, -20 * 1.003])
    assert printed.dot_diameter_mm == pytest.approx(3.0 * np.sqrt(0.998 * 1.003))
    with pytest.raises(InputError, match="vertical"):
        scaled(make_target_set(3), 100.0, 94.0)
    with pytest.raises(InputError, match="horizontal"):
        scaled(make_target_set(3), float("nan"), 100.0)


def test_rings_spread_about_200_stickers():
    table = rings()
    assert 185 <= 2 * sum(ring.stickers for ring in table) - table[0].stickers <= 215
    assert all(ring.spacing_mm > 50 for ring in table if ring.stickers > 1)
