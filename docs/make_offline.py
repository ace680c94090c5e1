"""Makes the finished manual one for the disk that loads nothing from elsewhere: `python docs/make_offline.py SITE`."""

import re
import sys
from pathlib import Path

# What Zensical puts into each page for the search on the disk; our own stand-in is docs/assets/worker-on-file.js.
_SHIM = re.compile(r"https://unpkg\.com/iframe-worker[^\"']*")

# Never asked for by pages on the disk: for a browser's debugger, for servers, and another theme's styles.
_NOT_TAKEN = ("**/*.map", "404.html", "sitemap.xml*", "search.json", "assets/stylesheets/classic/*")


def make_offline(site: Path) -> None:
    """Put our own script in the shim's place, in each page, and remove what nothing on the disk asks for."""
    for pattern in _NOT_TAKEN:
        for file in site.glob(pattern):
            file.unlink()
    for page in site.rglob("*.html"):
        up = "../" * (len(page.relative_to(site).parts) - 1)
        text = page.read_text(encoding="utf-8")
        page.write_text(_SHIM.sub(f"{up}assets/worker-on-file.js", text), encoding="utf-8")


if __name__ == "__main__":
    make_offline(Path(sys.argv[1]))
