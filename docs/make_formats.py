"""Writes docs/schemas/*.schema.json and the list of docs/formats.md: `python docs/make_formats.py`.

The schemas are those of the formats (spherecal_files/codec.py) and of docs/file_formats; tests/method/test_schemas.py
compares them with readers and writers.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(path) for path in (DOCS, DOCS.parent, DOCS.parent / "core") if str(path) not in sys.path]

from file_formats import FORMATS  # noqa: E402
from file_formats.other import MEASURED_SET  # noqa: E402

from spherecal_files.codec import FileFormat, Schema  # noqa: E402

SCHEMAS = DOCS / "schemas"
PAGE = DOCS / "formats.md"
_BLOCK = re.compile(r"(<!-- made by docs/make_formats\.py -->\n).*?(<!-- end -->)", re.DOTALL)


def schema_of(form: FileFormat) -> Schema:
    """A format's schema; that of the stream defines its other lines as well."""
    return form.schema | ({"$defs": {"set": MEASURED_SET}} if form.short == "measurements" else {})


def made_files() -> dict[Path, str]:
    """Everything that is made: contents by path."""
    files = {SCHEMAS / f"{form.short}.schema.json": _json(schema_of(form)) for form in FORMATS}
    page = PAGE.read_text(encoding="utf-8")
    return files | {PAGE: _BLOCK.sub(lambda found: found[1] + _overview() + found[2], page)}


def _json(schema: Schema) -> str:
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def _overview() -> str:
    """Formats that a page tells of, a line each; of the others the schemas say enough."""
    linked = {form.short: f"[`{form.file}`](schemas/{form.short}.schema.json)" for form in FORMATS}
    lines = [f"- {linked[form.short]}: {form.about} [More]({form.more})." for form in FORMATS if form.more]
    rest = ", ".join(linked[form.short] for form in FORMATS if not form.more)
    written = ", ".join(f"`{form.file}`" for form in FORMATS if not form.is_read)
    return "\n" + "\n".join([*lines, f"- Others: {rest}.", "", f"Only written: {written}.", ""])


def main() -> int:
    """Write what differs, and remove schemas that no format has."""
    files: dict[Path, Any] = made_files()
    SCHEMAS.mkdir(exist_ok=True)
    for path in SCHEMAS.glob("*.json"):
        if path not in files:
            path.unlink()
    for path, text in files.items():
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8", newline="\n")
            print(path.relative_to(DOCS.parent))
    return 0


if __name__ == "__main__":
    sys.exit(main())
