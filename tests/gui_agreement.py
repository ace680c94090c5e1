"""What a window says at one moment: headline, rail, chip, tiles, counter, banner, default button; do they agree?

Where there is no button to press and no work runs, the headline or the line beside the buttons has to say what to do.
"""

import time

from PySide6.QtCore import QCoreApplication, QEventLoop

from spherecal_gui.pages.live_page import LivePage
from spherecal_gui.pages.placement_page import PlacementPage
from spherecal_gui.standing import Level, worst
from spherecal_gui.wizard.window import WizardWindow
from spherecal_gui.workflow import Status
from tests.gui_walking import pump


def disagreements(window: WizardWindow) -> list[str]:
    """Every contradiction on the screen, in words; empty where all parts say the same."""
    page, state = window.page, window.controller.state
    if page is None or state is None or page.headline is None:
        return []
    found = []
    headline: Level = page.headline.property("level") or "none"
    rail: Level = window.rail.item(state.current).level
    tiles = _tiles(window)
    chip: Level = window.source.level
    action, default = page.action(), window.footer.default
    goes_on = default == "next" or (default == "action" and action is not None and action.accepts)
    parts = {"headline": headline, "rail": rail, "chip": chip, "tiles": tiles}
    if "bad" in parts.values() and goes_on:
        found.append(f"red, but {default} is the default button")
    if window.banner.alarms and goes_on:
        found.append("a red message, but it goes on by default")
    if state.now.status not in (Status.RUNNING, Status.BLOCKED) and (headline == "bad") != (rail == "bad"):
        found.append("headline and rail are not both red")
    if "bad" in (chip, tiles) and headline != "bad":
        found.append("a red chip or tile under a headline that is not red")
    if headline == "good" and worst((rail, tiles)) in ("caution", "bad"):
        found.append("a green headline over something that is not")
    if isinstance(page, PlacementPage) and page.ready.property("level") == "good" and headline in ("bad", "caution"):
        found.append("a green counter beside a headline that is not")
    told = page.headline.text() or window.footer.why.text()
    if not default and window.controller.runner.running is None and not told:
        found.append("no button to press, and nothing says what to do")
    return [f"{state.current}: {one} ({page.headline.text()!r}, {parts}, {window.banner.text!r})" for one in found]


def _tiles(window: WizardWindow) -> Level:
    """The worst tile in sight; a bar need not be seen by every camera."""
    page = window.page
    if not isinstance(page, LivePage) or page.some_are_enough or not page.wall.isVisible():
        return "none"
    return worst(tile.state.level for tile in page.wall.tiles.values())


class Watcher:
    """Lets a window live and writes down what lasts: what disagrees in two looks one after the other.

    Between the camera's news and the next of ten looks a second the window may say what was true before.
    """

    def __init__(self, window: WizardWindow) -> None:
        self.window = window
        self.found: set[str] = set()
        self.looks = 0
        self._before: set[str] = set()

    def look(self) -> None:
        """One look, after a turn of the window's clock."""
        self.window._tick()
        QCoreApplication.processEvents(QEventLoop.ProcessEventsFlag.AllEvents, 20)
        now = set(disagreements(self.window))
        self.found |= now & self._before
        self._before = now
        self.looks += 1

    def until(self, done) -> None:
        """Until something has happened; looking all the while."""

        def looked() -> bool:
            self.look()
            time.sleep(0.03)  # the window's own clock ticks ten times a second
            return bool(done())

        pump(looked)

    def settle(self) -> None:
        """Until no work runs, and three looks more."""
        self.until(lambda: self.window.controller.runner.running is None)
        for _ in range(3):
            self.look()
