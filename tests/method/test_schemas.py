"""The published schemas: they are current, what the program writes fits them, and they accept what the readers accept."""  # noqa: E501

import copy
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from jsonschema import Draft202012Validator

from docs.make_formats import SCHEMAS, made_files
from spherecal.base.errors import InputError
from spherecal_files.json_file import JsonValue
from tests.schema_samples import SAMPLES

PUBLISHED: dict[str, dict[str, Any]] = {
    path.name.removesuffix(".schema.json"): json.loads(path.read_text(encoding="utf-8"))
    for path in SCHEMAS.glob("*.json")
}
# Each kind, each way to be a wrong name, the edges of numbers.
WRONG: tuple[Any, ...] = (
    None, True, False, "x", "", "a,b", " x", "a\nb", ".", "y" * 1001, 0, 1, -1, 1.5, 6.0, -300, 1e31, 10**400, [], {},
    [1], [[1]], ["x"], {"x": 1}, {"a,b": 1}, "2026-11-21", "2026-02-31", "2026-11-21T09:30:00", "ab" * 32,
)  # fmt: skip


def closed(schema: Any) -> Any:
    """The schema with every field refused that it does not describe."""
    if isinstance(schema, list):
        return [closed(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    made = {
        word: {name: closed(one) for name, one in inner.items()} if word in ("properties", "$defs") else closed(inner)
        for word, inner in schema.items()
    }
    return {"additionalProperties": False, **made} if "type" in made and "properties" in made else made


def assert_fits(document: Any, schema: Any) -> None:
    """A document as the schema says."""
    assert [f"{one.json_path}: {one.message:.200}" for one in Draft202012Validator(schema).iter_errors(document)] == []


def test_what_is_published_is_current() -> None:
    files = made_files()
    for schema in PUBLISHED.values():
        Draft202012Validator.check_schema(schema)
    assert {path for path in files if path.suffix == ".json"} == set(SCHEMAS.glob("*.json"))
    for path, text in files.items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name} is not current: python docs/make_formats.py"


def test_every_format_in_the_code_has_a_schema() -> None:
    quoted = re.compile(r'"spherecal/([a-z-]+)"')
    sources = [path for folder in ("core", "spherecal_gui") for path in (ROOT / folder).rglob("*.py")]
    assert {name for path in sources for name in quoted.findall(path.read_text(encoding="utf-8"))} == set(PUBLISHED)


def spoilt(value: Any) -> Iterator[Any]:
    """The value with each part in turn missing, doubled, or replaced by something else; of lists the first item."""
    yield from (one for one in WRONG if one != value or isinstance(one, bool) != isinstance(value, bool))
    if isinstance(value, list) and value:
        yield value[:-1]
        yield [*value, copy.deepcopy(value[0])]
        yield from ([one, *value[1:]] for one in spoilt(value[0]))
    if isinstance(value, dict):
        yield from ({key: one for key, one in value.items() if key != left_out} for left_out in value)
        for key in value:
            yield from ({**value, key: one} for one in spoilt(value[key]))


def complaint(name: str, folder: Path, document: Any) -> str | None:
    """What the reader says against a document; None where it takes it."""
    try:
        SAMPLES[name].read(folder, document)
    except InputError as error:
        return str(error)
    return None


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLES)
def test_schema_and_reader_agree(name: str, tmp_path: Path) -> None:
    sample, schema = SAMPLES[name], PUBLISHED[name]
    assert_fits(sample.short, closed(schema))
    validator = Draft202012Validator(schema)
    assert complaint(name, tmp_path, sample.short) is None
    beyond = re.compile("|".join(sample.beyond) or "(?!)")
    refused = accepted = 0
    for document in (one for one in spoilt(sample.short) if isinstance(one, dict)):
        said = complaint(name, tmp_path, document)
        fits = validator.is_valid(document)
        if said is None:
            assert fits, ([one.message for one in validator.iter_errors(document)], document)
            accepted += 1
        else:
            assert not fits or beyond.search(said), (said, document)
            refused += 1
    assert refused > 20 and accepted > 0


@pytest.mark.parametrize("name", SAMPLES)
def test_the_reader_knows_no_field_that_the_schema_lacks(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: set[tuple[str, str]] = set()
    original = JsonValue.fields

    def fields(self: JsonValue, required: Any = (), optional: Any = ()) -> dict[str, JsonValue]:
        if json.loads(self.file.read_text(encoding="utf-8"))["format"] == f"spherecal/{name}":
            asked.update((re.sub(r"\[\d+\]", "[]", self.place), key) for key in (*required, *optional))
        return original(self, required, optional)

    monkeypatch.setattr(JsonValue, "fields", fields)
    assert complaint(name, tmp_path, SAMPLES[name].short) is None
    missing = [f"{place}.{key}" for place, key in asked if not _has(PUBLISHED[name], place, key)]
    assert asked and not missing


def _has(schema: dict[str, Any], place: str, key: str) -> bool:
    """Whether the schema describes a field of the object at a place."""
    found = [schema]
    for part in re.findall(r"\[\]|[^.\[\]]+", place):
        found = [inner for one in found for inner in _inner(one, part)]
    return any(key in one.get("properties", ()) for one in _forms(found)) or not found


def _forms(schemas: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [form for one in schemas for form in (one, *_forms(one.get("anyOf", [])))]


def _inner(schema: dict[str, Any], part: str) -> Iterator[dict[str, Any]]:
    for form in _forms([schema]):
        if part == "[]" and "items" in form:
            yield form["items"]
        elif part in form.get("properties", {}):
            yield form["properties"][part]
        elif isinstance(form.get("additionalProperties"), dict):
            yield form["additionalProperties"]
