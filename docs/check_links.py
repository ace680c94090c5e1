"""Follows every link of the finished manual: `python docs/check_links.py build/site`; 1 where one leads nowhere.

A manual that is read without a network may load nothing from elsewhere, so that is checked too.
"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlparse

_LOADED = {("script", "src"), ("img", "src"), ("iframe", "src"), ("source", "src")}
_LOADING_LINKS = {"stylesheet", "icon", "preload", "preconnect", "dns-prefetch", "modulepreload"}


class Page(HTMLParser):
    """The links of a page, what it loads, and the places in it that can be linked to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect."""
        given = {name: value or "" for name, value in attrs}
        self.places |= {given[name] for name in ("id", "name") if name in given}
        for name in ("href", "src"):
            if name in given and (tag, name) in _LOADED | {("a", "href"), ("link", "href")}:
                loading = (tag, name) in _LOADED or given.get("rel", "").split(" ")[0] in _LOADING_LINKS
                (self.loads if loading else self.links).append(given[name])


def broken_links(site: Path) -> list[str]:
    """One line for each link that leads nowhere and for each thing that is loaded from elsewhere."""
    pages = {file: Page(file.read_text(encoding="utf-8")) for file in sorted(site.rglob("*.html"))}
    found = []
    for file, page in pages.items():
        where = file.relative_to(site)
        found += [f"{where}: loads {url} from elsewhere" for url in page.loads if urlparse(url).netloc]
        for url in page.links + page.loads:
            parts = urlparse(url)
            if parts.scheme or parts.netloc:
                continue
            path, place = urldefrag(url)
            goal = (file.parent / unquote(urlparse(path).path)).resolve() if path else file
            if goal.is_dir():
                goal = goal / "index.html"
            if not goal.is_file():
                found.append(f"{where}: {url} leads nowhere")
            elif place and goal in pages and unquote(place) not in pages[goal].places:
                found.append(f"{where}: {url} names a place that is not there")
    return found


if __name__ == "__main__":
    root = Path(sys.argv[1]).resolve()
    problems = broken_links(root)
    print("\n".join(problems) or f"{len(list(root.rglob('*.html')))} pages, all links lead somewhere.")
    sys.exit(1 if problems else 0)
