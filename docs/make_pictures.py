"""Makes the pictures of the README and the documents in docs/pictures: `python3 dev.py pictures`."""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from spherecal_app.cli.main import main
from spherecal_sim.render_session import demo_session

PICTURES = Path(__file__).parent / "pictures"
PATIENCE_S = 120.0


def make_pictures() -> int:
    """Run the demo and draw its result and one printed sheet; 0 when all pictures were made."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        code = main(["demo", "-o", str(work / "demo")])
        if code:
            return code
        made = (scene_picture(work / "demo" / "result", demo_session(), PICTURES / "scene.png"),)
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


def scene_picture(result: Path, session: Path, path: Path) -> Path:
    """The 3-D scene of a result, as the window shows it."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    from PySide6.QtWidgets import QApplication

    from spherecal.base.context import Context
    from spherecal_gui import theme
    from spherecal_gui.rig_scenes import outcome_scene
    from spherecal_gui.tasks.outcome import read_outcome
    from spherecal_gui.widgets.scene_view import SceneView, png_of

    application = QApplication.instance() or QApplication(["pictures"])
    assert isinstance(application, QApplication)
    theme.apply(application, dark=True)
    view = SceneView()
    view.resize(1280, 800)
    view.show_scene(outcome_scene(read_outcome(result, session, result, (), Context())))
    view.show()
    until = time.monotonic() + PATIENCE_S
    while not view.settled and time.monotonic() < until:
        application.processEvents()
        time.sleep(0.02)
    path.write_bytes(png_of(view.grab()))
    view.close_view()
    return path


if __name__ == "__main__":
    if sys.argv[1:2] == ["--wizard"]:  # of the wizard's pages instead, into the folder named
        from make_screenshots import make_matrix

        sys.exit(make_matrix(Path(sys.argv[2]) if len(sys.argv) > 2 else PICTURES / "wizard"))
    sys.exit(make_pictures())
