"""Takes the screenshots of the technician's guide into docs/guide/pictures, and the whole walk on one sheet into
docs/pictures/walk.png: `python3 dev.py docs --pictures`."""

import sys
import tempfile
from pathlib import Path

from make_screenshots import LOOKS, make_screenshots
from PIL import Image

PICTURES = Path(__file__).parent / "guide" / "pictures"
# name in the guide -> name of make_screenshots' picture
TAKEN = {
    "start": "start-with-projects", "connect": "connect", "look": "look", "placement": "placement-ghost",
    "results": "results-findings", "verify": "verify-done", "measure": "measure",
}  # fmt: skip
WALK = Path(__file__).parent / "pictures" / "walk.png"
COLOURS = 128  # 40 to 90 kB a picture instead of 150 to 400, and nobody sees it
COLUMNS, WIDTH, GAP = 4, 480, 6


def make_guide_pictures() -> int:
    """Walk through the simulated demo and keep the pictures that the guide shows; 0 when all are there."""
    with tempfile.TemporaryDirectory() as folder:
        return make_screenshots(Path(folder), looks=LOOKS[:1]) or keep_pictures(Path(folder))


def keep_pictures(folder: Path) -> int:
    """Keep those of a walk's pictures that the guide shows, and all of them on one sheet."""
    for name, taken in TAKEN.items():
        found = sorted(folder.glob(f"*-{taken}-light.png"))
        if not found:
            print(f"There is no picture {taken!r} any more; see docs/make_screenshots.py.", file=sys.stderr)
            return 1
        save(Image.open(found[0]), PICTURES / f"{name}.png")
    save(sheet(sorted(folder.glob("*-light.png"))), WALK, 256)
    return 0


def sheet(paths: list[Path]) -> Image.Image:
    """Small pictures beside and below each other, in the order of their names."""
    small = []
    for path in paths:
        picture = Image.open(path).convert("RGB")
        small.append(picture.resize((WIDTH, round(WIDTH * picture.height / picture.width)), Image.Resampling.LANCZOS))
    height = max(picture.height for picture in small) + GAP
    rows = -(-len(small) // COLUMNS)
    whole = Image.new("RGB", (COLUMNS * (WIDTH + GAP) - GAP, rows * height - GAP), (120, 120, 120))
    for number, picture in enumerate(small):
        whole.paste(picture, (number % COLUMNS * (WIDTH + GAP), number // COLUMNS * height))
    return whole


def save(picture: Image.Image, path: Path, colours: int = COLOURS) -> None:
    """Write it with few colours; many small pictures on one sheet need octrees, else all that is red turns brown."""
    method = Image.Quantize.MEDIANCUT if colours <= COLOURS else Image.Quantize.FASTOCTREE
    picture.convert("RGB").quantize(colours, method, dither=Image.Dither.NONE).save(path, optimize=True)
    print(path.relative_to(Path(__file__).parents[1]))


if __name__ == "__main__":
    sys.exit(make_guide_pictures())
