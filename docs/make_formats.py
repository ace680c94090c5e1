"""Writes docs/schemas/*.schema.json and the tables of docs/formats.md: `python docs/make_formats.py`.

The schemas are those of the formats (spherecal/files/codec.py) and of docs/file_formats; tests/method/test_schemas.py
compares them with readers and writers.
"""

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(path) for path in (DOCS, DOCS.parent, DOCS.parent / "core") if str(path) not in sys.path]

from file_formats import FORMATS  # noqa: E402
from file_formats.other import MEASURED_SET  # noqa: E402

from spherecal.files.codec import UNREAD, FileFormat, Schema  # noqa: E402

SCHEMAS = DOCS / "schemas"
PAGE = DOCS / "formats.md"
_BLOCK = re.compile(r"(<!-- made by docs/make_formats\.py: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
_LIMITS = {"minimum": "from {:g}", "maximum": "to {:g}", "exclusiveMinimum": "above {:g}"}
# The page has tables of what people write or commonly read; of the others it links the schema, which describes every
# field in the same words.
_TABLES = {"session", "targets", "rig", "ball", "frame", "bars", "issuer", "body", "measurements"}
_NO_LIMIT = 1e15  # bounds of this size only keep sums finite


def schema_of(form: FileFormat) -> Schema:
    """A format's schema; that of the stream defines its other lines as well."""
    return form.schema | ({"$defs": {"set": MEASURED_SET}} if form.short == "measurements" else {})


def made_files() -> dict[Path, str]:
    """Everything that is made: contents by path."""
    files = {SCHEMAS / f"{form.short}.schema.json": _json(schema_of(form)) for form in FORMATS}
    page = PAGE.read_text(encoding="utf-8")
    blocks = {"overview": _overview(), "fields": _fields()}
    return files | {PAGE: _BLOCK.sub(lambda found: found[1] + blocks[found[2]] + found[3], page)}


def _json(schema: Schema) -> str:
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def _overview() -> str:
    lines = ["| file | format | schema | |", "|---|---|---|---|"]
    for form in FORMATS:
        more = f" [More]({form.more})." if form.more else ""
        written = "" if form.is_read else " Only written."
        file, schema = (
            f"[`{form.file}`](#{_anchor(form)})",
            f"[schema](schemas/{form.short}.schema.json)",
        )
        lines.append(f"| {file} | `spherecal/{form.short}` | {schema} | {form.about}{written}{more} |")
    return "\n".join(lines) + "\n"


def _anchor(form: FileFormat) -> str:
    return f"fields-of-{form.short}"


def _fields() -> str:
    return "\n".join(_section(form) for form in FORMATS)


def _section(form: FileFormat) -> str:
    lines = [f"### {form.file} {{#{_anchor(form)}}}", "", " ".join((form.about, *form.rules)), ""]
    if form.short not in _TABLES:
        return "\n".join([*lines[:3], f"Fields: [schema](schemas/{form.short}.schema.json).", ""])
    lines += ["| field | value | needed | |", "|---|---|---|---|"]
    schema = form.schema
    for key in ("format", "version"):
        del schema["properties"][key]
    rows = _rows(schema, "", set(schema["required"]))
    lines += [f"| `{name}` | {value} | {need} | {about} |" for name, value, need, about in rows]
    return "\n".join(lines) + "\n"


def _rows(schema: Schema, above: str, required: set[str]) -> Iterator[tuple[str, str, str, str]]:
    """Place, value, need and description of the fields of an object and of all that they hold."""
    for key, field in schema.get("properties", {}).items():
        place = f"{above}{key}"
        need = "not read" if field.get("$comment") == UNREAD else "yes" if key in required else ""
        yield place, _value(field), need, field.get("description", "")
        yield from _below(field, place)


def _below(field: Schema, place: str) -> Iterator[tuple[str, str, str, str]]:
    """The rows of what a field holds, of each of its forms."""
    for one in field.get("anyOf", ()):
        yield from _below(one, place)
    if "properties" in field:
        yield from _rows(field, f"{place}.", set(field.get("required", ())))
    if "items" in field:
        yield from _below(field["items"], f"{place}[]")
    if isinstance(field.get("additionalProperties"), dict):
        yield from _below(field["additionalProperties"], f"{place}.*")


def _value(schema: Schema) -> str:
    if "enum" in schema:
        return ", ".join(f"`{option}`" for option in schema["enum"] if option is not None)
    if "const" in schema:
        return f"`{schema['const']}`"
    if "type" not in schema:
        kinds = [_value(one) for one in schema.get("anyOf", ()) if one.get("type") != "null"]
        return " or ".join(dict.fromkeys(kinds)) or "any"
    kind = schema["type"]
    kind = next(one for one in kind if one != "null") if isinstance(kind, list) else kind
    return {"array": _list, "object": _object, "string": _string}.get(kind, _number)(schema, kind)


def _list(schema: Schema, _: str) -> str:
    least, most = schema.get("minItems"), schema.get("maxItems")
    if "prefixItems" in schema:
        return f"list of {len(schema['prefixItems'])}"
    lengths = [one["minItems"] for one in schema.get("anyOf", ())]
    count = f" of {' or '.join(map(str, lengths))}" if lengths else ""
    if least is not None:
        count = (
            f" of {least}" if least == most else f" of {least} or more" if most is None else f" of {least} to {most}"
        )
    elif most is not None:
        count = f" of at most {most}"
    inner = schema.get("items", {})
    if inner.get("type") == "array" and "minItems" in inner:
        return f"list{count or ' of'} lists of {inner['minItems']}"
    return f"list{count}"


def _object(schema: Schema, _: str) -> str:
    return "object by name" if "additionalProperties" in schema else "object"


def _string(schema: Schema, _: str) -> str:
    if schema.get("format") in ("date", "date-time"):
        return {"date": "date", "date-time": "time with zone"}[schema["format"]]
    return {100: "name", 64: "id", 500: "path"}.get(schema.get("maxLength", 0), "text")


def _number(schema: Schema, kind: str) -> str:
    name = {"integer": "whole number", "boolean": "true or false"}.get(kind, kind)
    bounds = [words.format(schema[key]) for key, words in _LIMITS.items() if abs(schema.get(key, 1e99)) < _NO_LIMIT]
    return " ".join((name, *bounds))


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
