"""The pages of studies in a folder, for whatever shows them: the wizard, an index."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ORDER = ("compare", "layouts", "path", "noise", "cameras", "rigB", "bar")


@dataclass(frozen=True)
class KeptPage:
    """One study's page: PDF, a picture of each of its pages, its table paper / ours, and its options."""

    name: str
    title: str
    pdf: Path
    pictures: tuple[Path, ...]
    compared: tuple[dict[str, Any], ...]  # `what`, `paper`, `ours`, `agrees` (or None), `why`
    options: dict[str, Any]  # `runs`, `sigma_px` (None: images), `seed`, `preset` (None: the paper's), or `session`


def pages(folder: Path) -> tuple[KeptPage, ...]:
    """The complete pages in a folder of `spherecal study -o FOLDER`, the comparison of methods first."""
    found = [page for path in sorted(folder.glob("*.json")) if (page := _read(path)) is not None]
    return tuple(sorted(found, key=lambda page: (_place(page.name), page.name)))


def _place(name: str) -> int:
    return ORDER.index(name) if name in ORDER else len(ORDER)


def _read(path: Path) -> KeptPage | None:
    try:
        d = json.loads(path.read_bytes())
        if d["format"] != "spherecal/study":
            return None
        page = KeptPage(
            d["study"], d["title"], path.parent / d["pdf"], tuple(path.parent / name for name in d["pictures"]),
            tuple(d["compared"]), d["options"],
        )  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return page if all(file.is_file() for file in (page.pdf, *page.pictures)) else None
