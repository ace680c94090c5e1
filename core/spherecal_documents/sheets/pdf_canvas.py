"""A PDF (Reference 1.4, Adobe) of lines, rectangles, circles and text; points of 1/72 inch, y up; the same bytes."""

import zlib
from math import cos, radians, sin

POINTS_PER_MM = 72 / 25.4
_FONTS = ("Helvetica", "Helvetica-Bold")  # of every PDF reader, so that none is embedded
_CIRCLE = 0.5522847498  # of a quarter circle as a Bezier curve: off by 2.7e-4 of the radius at most


class PdfCanvas:
    """Draws page after page, in points with y up; `data` is the whole document."""

    def __init__(self, title: str, width: float, height: float) -> None:
        """All pages have the same size."""
        self._title, self._size = title, (width, height)
        self._pages: list[bytes] = []
        self._drawn: list[str] = []

    def line(self, x0: float, y0: float, x1: float, y1: float, width: float) -> None:
        """A black line."""
        self._add(f"0 G {_n(width)} w {_n(x0)} {_n(y0)} m {_n(x1)} {_n(y1)} l S")

    def rectangle(self, x: float, y: float, width: float, height: float, grey: float) -> None:
        """A filled rectangle."""
        self._add(f"{_n(grey)} g n {_n(x)} {_n(y)} {_n(width)} {_n(height)} re f")

    def disc(self, x: float, y: float, radius: float, grey: float) -> None:
        """A filled circle."""
        k, quarters = _CIRCLE * radius, []
        for px, py in ((0, 1), (-1, 0), (0, -1), (1, 0)):  # the ends of the quarters, counter-clockwise from (1, 0)
            qx, qy = py, -px  # where the quarter begins
            points = (
                (x + qx * radius + px * k, y + qy * radius + py * k),
                (x + px * radius + qx * k, y + py * radius + qy * k),
                (x + px * radius, y + py * radius),
            )
            quarters.append(" ".join(f"{_n(u)} {_n(v)}" for u, v in points) + " c")
        self._add(f"{_n(grey)} g n {_n(x + radius)} {_n(y)} m {' '.join(quarters)} f")

    def text(
        self, x: float, y: float, text: str, size: float, bold: bool = False, grey: float = 0.0, turn_deg: float = 0.0
    ) -> None:
        """A line of text."""
        c, s = cos(radians(turn_deg)), sin(radians(turn_deg))
        matrix = " ".join(_n(value) for value in (c, s, -s, c, x, y))
        self._add(f"{_n(grey)} g BT /F{int(bold)} {_n(size)} Tf {matrix} Tm {_string(text)} Tj ET")

    def end_page(self) -> None:
        """End the page; what is drawn next is on another."""
        self._pages.append("\n".join(self._drawn).encode("ascii"))
        self._drawn = []

    def data(self) -> bytes:
        """The document."""
        first = 4 + len(_FONTS)  # of the objects of the pages, two each
        kids = " ".join(f"{first + 2 * number} 0 R" for number in range(len(self._pages)))
        fonts = " ".join(f"/F{number} {4 + number} 0 R" for number in range(len(_FONTS)))
        objects = [
            b"<< /Type /Catalog /Pages 2 0 R >>",
            f"<< /Type /Pages /Kids [{kids}] /Count {len(self._pages)} >>".encode(),
            f"<< /Title {_string(self._title)} >>".encode(),
            *(
                f"<< /Type /Font /Subtype /Type1 /BaseFont /{name} /Encoding /WinAnsiEncoding >>".encode()
                for name in _FONTS
            ),
        ]
        width, height = self._size
        for number, page in enumerate(self._pages):
            objects.append(
                f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {_n(width)} {_n(height)}] "
                f"/Resources << /Font << {fonts} >> >> /Contents {first + 2 * number + 1} 0 R >>".encode()
            )
            packed = zlib.compress(page, 9)
            objects.append(
                f"<< /Length {len(packed)} /Filter /FlateDecode >>\nstream\n".encode() + packed + b"\nendstream"
            )
        # the objects with their table and trailer
        out, places = b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n", []
        for at, body in enumerate(objects, start=1):
            places.append(len(out))
            out += f"{at} 0 obj\n".encode() + body + b"\nendobj\n"
        table = "".join(f"{place:010d} 00000 n \n" for place in places)
        trailer = f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R /Info 3 0 R >>\nstartxref\n{len(out)}\n%%EOF\n"
        return out + f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}{trailer}".encode()

    def _add(self, drawn: str) -> None:
        self._drawn.append(drawn)


def _n(value: float) -> str:
    """A number to 1e-4 points (35 nm), without a needless end."""
    text = f"{value:.4f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _string(text: str) -> str:
    """A text in the fonts' encoding, everything but plain ASCII as octal numbers; `?` for what they do not have."""
    shown = ""
    for byte in text.encode("cp1252", "replace"):
        plain = 32 <= byte < 127 and chr(byte) not in "()\\"
        shown += chr(byte) if plain else f"\\{byte:03o}"
    return f"({shown})"
