"""Prints what the window says in every state, in its three languages, as a table: `python docs/make_states.py`.

The states are those of spherecal_gui/presenters/step_states.py over all their inputs (tests/gui_states.py).
"""

import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(path) for path in (DOCS.parent, DOCS.parent / "core") if str(path) not in sys.path]
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

STEPS = {
    "connect_says": "Connect", "look_says": "Camera check", "placement_says": "Placement", "bar_says": "Scale bar",
    "calibrate_says": "Calibrate", "results_says": "Results", "verify_says": "Verify", "save_says": "Save",
    "check_says": "Check", "measure_says": "Measure",
}  # fmt: skip
COLOURS = {"none": "", "good": "green", "caution": "amber", "bad": "red"}
HEAD = """# What the window says

Every state of every step has one instruction, one colour, and one large button. This table is made from the function
that the window draws, over all its inputs: `python docs/make_states.py`. The level that is worse wins: where another
step or a camera is in trouble, the window shows that trouble's sentence in the place of the one here. Where an
instruction is the same in all languages it is an example of what another part says, such as a verdict.
"""
HEADING = ("| colour | instruction | Anweisung | 指示 | large button (bold: can be pressed) |", "|---|---|---|---|---|")


def rows_of(says: Callable[[Any], Any]) -> list[tuple[str, ...]]:
    """The different states of a step: colour, the instruction in three languages, what the large button says."""
    from spherecal_gui import languages
    from tests.gui_states import all_facts

    texts, buttons, levels = [], [], []
    try:
        for language in ("en", "de", "zh_CN"):
            languages.use(language)
            said = [says(facts) for facts in all_facts()[says]]
            texts.append([one.text for one in said])
            buttons.append([one.button for one in said])
            levels = [COLOURS[one.level] for one in said]
    finally:
        languages.use("en")
    found: dict[tuple[str, ...], dict[str, None]] = {}
    for level, *words in zip(levels, *texts, *buttons, strict=True):
        instruction, button = tuple(words[:3]), words[3:]
        shown = found.setdefault((level, *instruction), {})
        if button[0] is not None and not button[0].done:
            name = " · ".join(dict.fromkeys(one.text for one in button))
            shown[f"**{name}**" if button[0].enabled else name] = None
    return [(*state, "<br>".join(shown)) for state, shown in found.items() if any(state[1:]) or shown]


def made_page() -> str:
    """The page."""
    from PySide6.QtWidgets import QApplication

    from tests.gui_states import all_facts

    application = QApplication.instance() or QApplication(["states"])
    lines = HEAD.splitlines()
    for says in all_facts():
        cells = [[re.sub(r"\s+", " ", cell).replace("|", "/") for cell in row] for row in rows_of(says)]
        lines += ["", f"## {STEPS[says.__name__]}", "", *HEADING, *(f"| {' | '.join(row)} |" for row in cells)]
    del application
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(made_page())
