"""Makes the pictures of the README and the documents in docs/pictures: `python3 dev.py pictures`."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from spherecal.cli.main import main
from spherecal.report.pictures import save_pictures
from spherecal_sim.render_session import demo_session

PICTURES = Path(__file__).parent / "pictures"


def make_pictures() -> int:
    """Run the demo and draw its result and one printed sheet; 0 when all pictures were made."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        code = main(["demo", "-o", str(work / "demo")])
        if code:
            return code
        made = save_pictures(work / "demo" / "result", PICTURES, demo_session())
        main(["targets", "sheet", "-o", str(work / "sheet.pdf"), "--count", "40"])
        if shutil.which("pdftoppm") is None:
            print("sheet.png is left as it was: pdftoppm is missing (apt install poppler-utils).", file=sys.stderr)
        else:
            page = ["-f", "2", "-l", "2", "-r", "80", "-gray", "-png", "-singlefile"]
            subprocess.run(["pdftoppm", *page, work / "sheet.pdf", PICTURES / "sheet"], check=True)
            made += (PICTURES / "sheet.png",)
        for path in made:
            print(path.relative_to(PICTURES.parent.parent))
    return 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--wizard"]:  # of the wizard's pages instead, into the folder named
        from make_screenshots import LANGUAGES, SIZES, make_screenshots

        sys.exit(make_screenshots(Path(sys.argv[2]) if len(sys.argv) > 2 else PICTURES / "wizard", LANGUAGES, SIZES))
    sys.exit(make_pictures())
