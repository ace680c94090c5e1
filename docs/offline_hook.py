"""mkdocs calls this: nothing in the manual is loaded from elsewhere, the search on the disk included."""

import re
from typing import Any

# What the plugin `offline` puts into each page; our own stand-in is docs/assets/worker-on-file.js.
_SHIM = re.compile(r"https://unpkg\.com/iframe-worker[^\"']*")


def on_post_page(output: str, page: Any, config: Any) -> str:
    """The page with our own script in the shim's place."""
    up = "../" * page.url.count("/")
    return _SHIM.sub(f"{up}assets/worker-on-file.js", output)


def on_post_template(output_content: str, template_name: str, config: Any) -> str:
    """The same for the page of errors."""
    return _SHIM.sub("assets/worker-on-file.js", output_content)
