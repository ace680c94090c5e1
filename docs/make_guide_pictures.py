"""Takes the screenshots of the technician's guide into docs/guide/pictures: `python3 dev.py docs --pictures`."""

import sys
import tempfile
from pathlib import Path

from make_screenshots import make_screenshots
from PIL import Image

PICTURES = Path(__file__).parent / "guide" / "pictures"
# name in the guide -> name of make_screenshots' picture
TAKEN = {
    "start": "start-with-projects", "connect": "connect", "look": "look", "placement": "placement-done",
    "results": "results-findings", "verify": "verify-done",
}  # fmt: skip
COLOURS = 128  # 40 to 90 kB a picture instead of 150 to 400, and nobody sees it


def make_guide_pictures() -> int:
    """Walk through the simulated demo and keep the pictures that the guide shows; 0 when all are there."""
    with tempfile.TemporaryDirectory() as folder:
        if code := make_screenshots(Path(folder)):
            return code
        for name, taken in TAKEN.items():
            found = sorted(Path(folder).glob(f"*-{taken}-light.png"))
            if not found:
                print(f"There is no picture {taken!r} any more; see docs/make_screenshots.py.", file=sys.stderr)
                return 1
            picture = Image.open(found[0]).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
            picture.save(PICTURES / f"{name}.png", optimize=True)
            print(f"docs/guide/pictures/{name}.png")
    return 0


if __name__ == "__main__":
    sys.exit(make_guide_pictures())
