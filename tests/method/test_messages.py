# ruff: noqa: RUF001 - Chinese punctuation is meant
"""The catalogue of messages: every code has its words in every language, every field its value, plurals their forms."""

import errno
import json
import os
import pickle
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from spherecal.base.context import Context, Progress
from spherecal.base.errors import InputError, OutputError, reason
from spherecal.base.messages.catalogue import LANGUAGES, PLURALS, TemplateField, fill, parsed, phrase, table, template
from spherecal.base.messages.values import Phrase
from spherecal.base.resources import resource_path
from spherecal.data.findings import AdvisedRepair, Finding, leave_out
from spherecal_files.findings_file import as_json, as_written, findings_document, from_json, read_findings, with_values
from spherecal_files.json_file import read_json
from spherecal_verify.verify_bars import verify
from tests.conftest import ROOT
from tests.findings_in_code import errors_in_words, findings_in_code, phrases_in_code
from tests.networks import calibrated, one_thread

__all__ = ["one_thread"]

OTHERS = [language for language in LANGUAGES if language != "en"]
# What every finding's words may name without its being among the values.
GIVEN = {"where", "repairs"}
_TABLES = ("lists", "phrases", "words")
# Errors here are still English: files of other programs, arrays and studies, which a programmer meets, and simulators.
_ENGLISH = (
    "core/spherecal_gentl/gige/", "core/spherecal_gentl/producer/", "core/spherecal_app/cli/parsing.py",
    "core/spherecal_app/cli/producer_command.py",
    "core/spherecal_documents/export/",
    "core/spherecal/data/from_arrays.py", "core/spherecal_measuring/points.py",
    "core/spherecal_sim/", "core/spherecal_study/",
)  # fmt: skip


def flat(words: dict, path: str = "") -> dict[str, str]:
    """Every template of a table, by its path."""
    found: dict[str, str] = {}
    for name, one in words.items():
        found |= flat(one, f"{path}{name}.") if isinstance(one, dict) else {f"{path}{name}": one}
    return found


def fields(words: str) -> list[TemplateField]:
    return [piece for piece in parsed(words) if isinstance(piece, TemplateField)]


def codes() -> dict[str, dict]:
    return {code: words for code, words in table("en").items() if code not in _TABLES}


def kinds_of(code: str) -> list[str]:
    return [name for name, one in codes()[code].items() if isinstance(one, dict)]


# --- code and catalogue ----------------------------------------------------------------------------------------------


def test_every_finding_of_the_engine_has_its_words() -> None:
    made = findings_in_code()
    assert len(made) > 90
    for one in made:
        known = one.codes & codes().keys()
        assert known and (known == one.codes or len(one.codes) > 2), f"{one.place}: no words for {one.codes}"
        for code in known:
            kinds = (one.kinds & set(kinds_of(code))) if one.kinds else {""}
            kinds = kinds or (set(kinds_of(code)) if "*" in one.kinds else set())
            assert kinds, f"{one.place}: no words for {code} of kinds {one.kinds}"
            for kind in kinds:
                for part in ("title", "message", "hint"):
                    assert template(code, kind, part, "en") is not None, f"{one.place}: {code}.{kind} has no {part}"


def test_nothing_in_the_catalogue_is_of_no_use() -> None:
    made = findings_in_code()
    assert set(codes()) - {code for one in made for code in one.codes} == set()
    for code in codes():
        here = [one for one in made if code in one.codes]
        used = {kind for one in here for kind in one.kinds}
        assert "*" in used or set(kinds_of(code)) <= used, (code, set(kinds_of(code)) - used)
    keys = {key for one in phrases_in_code() for key in one.codes}
    window = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "spherecal_gui").rglob("*.py"))
    assert [group for group in table("en")["words"] if f'"{group}"' not in window] == []
    assert set(table("en")["phrases"]) - keys - {f"{key}-{part}" for key in keys for part in ("hint", "short")} == set()


def test_every_field_has_a_value_where_the_code_writes_them_out() -> None:
    checked = 0
    for one in findings_in_code():
        if one.values is None or len(one.codes) > 1 or len(one.kinds) > 1 or "*" in one.kinds:
            continue
        (code,), kind = one.codes, next(iter(one.kinds), "")
        asked = {f.name for part in ("message", "hint") for f in fields(template(code, kind, part, "en") or "")}
        assert asked <= one.values | GIVEN, f"{one.place}: {code}.{kind} lacks {asked - one.values - GIVEN}"
        checked += 1
    for one in phrases_in_code():
        known = one.codes & set(table("en")["phrases"])
        assert known, f"{one.place}: no words for {one.codes}"
        for key in known if one.values is not None and len(one.codes) == 1 else ():
            words = [table("en")["phrases"].get(name, "") for name in (key, f"{key}-hint", f"{key}-short")]
            asked = {f.name for f in fields("".join(words))}
            assert asked <= (one.values or set()), f"{one.place}: {key} lacks {asked - (one.values or set())}"
            checked += 1
    assert checked > 80


def test_errors_are_codes_with_values() -> None:
    """No error is a sentence where it is raised, but in the rooms that are named."""
    found = errors_in_words()
    assert {place: lines for place, lines in found.items() if not place.startswith(_ENGLISH)} == {}
    assert [room for room in _ENGLISH if not any(place.startswith(room) for place in found)] == []


def test_an_error_has_its_code_and_the_hint_beside_it() -> None:
    error = InputError(Phrase("error-no-registered-bar", {"file": Path("bars.json"), "serial": '"7"'}), "Look again.")
    assert (error.code, error.message, error.hint) == (
        "error-no-registered-bar",
        'bars.json: the registry has no bar "7".',
        "Look again.",
    )
    error = InputError(Phrase("error-no-profile", {"folder": Path("a")}))
    assert str(error) == "a: is not a rig profile. Make one: spherecal profile save RESULT --to PROFILE."
    assert error.words("de")[0] == "a: ist kein Profil eines Aufbaus."
    assert InputError("Text.").code == "" and InputError("Text.").words("de") == ("Text.", "")


@pytest.mark.parametrize("language", LANGUAGES)
def test_errors_of_files_are_in_every_language(tmp_path: Path, language: str) -> None:
    """Where in the file, what was expected and what was found, and the problem's own hint."""
    path = tmp_path / "session.json"
    path.write_text('{"format": "spherecal/session", "version": 9}', encoding="utf-8")
    with pytest.raises(InputError) as raised:
        read_json(path, "spherecal/session", 1)
    message, hint = raised.value.words(language)
    problem = raised.value.parts[0].values["problem"]  # type: ignore[union-attr]
    assert (problem.key, dict(problem.values)) == ("problem-later-version", {"given": 9, "known": 1})
    assert message.startswith(str(path)) and "9" in message and "SphereCal" in hint
    assert (message == raised.value.message) == (language == "en")


# --- languages -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("language", OTHERS)
def test_every_language_has_every_text_with_its_figures(language: str) -> None:
    english, other = flat(table("en")), flat(table(language))
    assert set(english) == set(other)
    for path, words in english.items():
        ours, theirs = fields(words), fields(other[path])
        assert {f.name for f in ours if f.kind != "#"} <= {f.name for f in theirs}, path
        allowed = {f.name for f in ours} | ({"where", "cameras", "observations"} if path.endswith("hint") else set())
        assert {f.name for f in theirs} <= allowed, path
        for field in theirs:  # a figure has as many digits in every language
            same = [f.spec for f in ours if f.name == field.name and f.kind == ":"]
            assert field.kind != ":" or field.spec in same or field.spec in ("capital", "count"), path
        assert bool(words.strip()) == bool(other[path].strip()), path
        assert words.count("[") == words.count("]") == other[path].count("[") == other[path].count("]"), path
        assert words.strip() == words or path.startswith("lists."), path


@pytest.mark.parametrize("language", LANGUAGES)
def test_plural_forms_are_as_many_as_the_language_has(language: str) -> None:
    count, form = PLURALS[language]
    for path, words in flat(table(language)).items():
        for field in fields(words):
            assert field.kind != "#" or len(field.spec.split("|")) == count, path
    assert {form(n) for n in range(12)} == set(range(count))


def test_chinese_is_chinese_and_german_is_not_english() -> None:
    english, german, chinese = (flat(table(language)) for language in ("en", "de", "zh_CN"))
    for path, words in english.items():
        letters = re.sub(r"\{[^}]*\}|[^A-Za-z]", "", words)
        if len(letters) > 6:
            assert re.search(r"[一-鿿]", chinese[path]), path
        if len(letters) > 12:
            assert german[path] != words, path


def sample(field: TemplateField) -> object:
    """A value that a field can show."""
    if field.kind == "#" or field.spec == "count":
        return (
            2
            if field.kind == "#" and field.name not in ("where", "cameras", "groups", "images", "part")
            else ("A", "B")
        )
    if field.spec in (*table("en")["lists"], "capital"):
        return "text" if field.spec == "capital" else ("A", "B")
    if field.name in ("low", "high", "place_mm"):
        return (1.0, 2.0, 3.0)
    return 7.0 if field.spec not in ("", "number", "short") else "text"


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_template_can_be_filled(language: str) -> None:
    for path, words in flat(table(language)).items():
        values: dict[str, object] = {}
        for field in sorted(fields(words), key=lambda f: (f.kind == "#", f.spec == "")):
            values.setdefault(field.name, sample(field))
        of_finding = not path.startswith("phrases.")  # in phrases brackets are brackets
        for with_options in (True, False) if of_finding and path.endswith("hint") else (None,):
            said = fill(words, values, language, with_options=with_options)  # type: ignore[arg-type]
            left = said.replace(" | ", "")
            wrong = r"[{}\[#|]" if of_finding else r"[{}#]"
            assert path.startswith("lists.") or not re.search(wrong, left), (path, said)


@pytest.mark.parametrize(
    ("language", "one", "two"),
    [
        ("en", "1 image contradicts all others and is hardly used: C1@P1 (3 of 9", "2 images contradict all others"),
        ("de", "1 Bild widerspricht allen anderen und wird kaum benutzt: C1@P1 (3 von 9", "2 Bilder widersprechen"),
        ("zh_CN", "1 幅图像与其余全部矛盾，几乎未被采用：C1@P1（第一幅", "2 幅图像与其余全部矛盾"),
    ],
)
def test_plurals(language: str, one: str, two: str) -> None:
    for images, expected in ((("C1@P1",), one), (("C1@P1", "C2@P1"), two)):
        values = {"images": images, "out": 3, "points": 9}
        finding = Finding("image-contradicts", "warning", values, ("C1", "P1"), leave_out(*images))
        assert finding.words("message", language).startswith(expected)


def numbers(text: str) -> list[str]:
    """The figures of a text in order of size, without those of names such as C01."""
    return sorted(re.findall(r"(?<![\w@.-])[+-]?\d+(?:\.\d+)?", text))


@pytest.mark.parametrize("language", OTHERS)
def test_findings_of_real_results_have_their_figures_in_every_language(language: str) -> None:
    calibration, session, _ = calibrated("rigA", 3, scale="bar", bar_poses=4)
    found = [*calibration.rig.quality.findings, *verify(session, calibration.rig).findings]
    found += calibrated("demo", 1)[0].rig.quality.findings
    assert len({finding.code for finding in found}) > 3
    for finding in found:
        for part in ("message", "hint"):
            english, other = finding.words(part, "en"), finding.words(part, language)
            assert numbers(english) == numbers(other), (english, other)
            assert not english or english != other


# --- one finding -----------------------------------------------------------------------------------------------------


def moved() -> Finding:
    size = Phrase("move-microradians", {"shift": Phrase("shift-mm", {"shift": 0.25}), "microradians": 90.0})
    evidence = Phrase("shows-move", {"px": 0.5, "chi_square": 123.4, "dof": 6, "limit": 30.0})
    values = {"camera": "C03", "place": "P2", "size": size, "evidence": evidence}
    return Finding("camera-moved", "warning", values, ("C03", "P2"), (AdvisedRepair("split", "C03@P2"),), "before")


def test_phrases_are_of_the_same_language() -> None:
    assert moved().message == (
        "Camera C03 has moved before P2, by about 0.25 mm and 90 microradians: its image points shift by 0.5 px "
        "(chi-square 123 on 6 degrees of freedom; noise stays below 30)."
    )
    assert moved().words("message", "de").startswith("Die Kamera C03 hat sich vor P2 bewegt, um etwa 0.25 mm")
    assert phrase(Phrase("camera-at", {"camera": "C1", "place": "P2"}), "zh_CN") == "C1（P2）"


@pytest.mark.parametrize(
    ("language", "turned", "images"),
    [
        ("en", "C03 was turned by 0.3° at placement 2", "4 images contradict the others"),
        ("de", "C03 wurde bei Aufstellung 2 um 0.3° gedreht", "4 Bilder widersprechen den anderen"),
        ("zh_CN", "C03 在第 2 次摆放时转动了 0.3°", "有 4 幅图像与其他图像矛盾"),
    ],
)
def test_titles_are_short(language: str, turned: str, images: str) -> None:
    size = Phrase("move-turned", {"shift": Phrase("shift-mm", {"shift": 0.25}), "degrees": 0.3})
    finding = replace(moved(), values={**moved().values, "size": size})
    assert finding.words("title", language) == turned
    assert "0.25 mm" in finding.words("message", language)
    four = {"images": ["C1@P1", "C2@P1", "C3@P1", "C4@P1"], "out": 3, "points": 9}
    assert Finding("image-contradicts", "warning", four, kind="images").words("title", language) == images
    assert as_written("warning", "image-contradicts", "m.", "").words("title", language)


def test_options_are_named_only_where_there_are_repairs_and_no_buttons() -> None:
    assert "Calibrate again with --split C03@P2: from there on" in moved().hint
    assert moved().words("hint", "en", with_options=False) == "Fix the camera's mount."
    assert replace(moved(), repairs=()).hint == "Fix the camera's mount."


def test_a_field_without_a_value_leaves_no_gap() -> None:
    assert fill("A {a} b.", {"a": None}) == "A b."
    assert fill("{a} Then.", {"a": None}) == "Then."
    assert fill("Done. {a}", {"a": None}) == "Done."
    with pytest.raises(KeyError):
        fill("{missing}", {})


def test_findings_are_equal_where_they_say_the_same() -> None:
    same = as_written("warning", "camera-moved", moved().message, moved().hint, ("C03", "P2"))
    assert same == moved() and hash(same) == hash(moved())
    assert same != replace(moved(), severity="error") and moved() != "camera-moved"
    assert same.words("message", "de") == moved().message, "what was only written stays as it was"
    assert same.words("title", "de") == "Eine Kamera wurde zwischen Aufstellungen bewegt"
    assert as_written("info", "new-one", "m.", "").words("title", "de") == "new one"


def test_an_error_is_not_lost_where_its_words_cannot_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    refused = OutputError(Phrase("error-cannot-write", {"file": "x.json", "why": reason(error)}), "Go on.")
    assert str(refused) == "x.json: cannot be written (no space left on device). Go on."
    assert refused.words("de") == ("x.json: kann nicht geschrieben werden (der Datenträger ist voll).", "Go on.")
    assert pickle.loads(pickle.dumps(refused)).words("de") == refused.words("de")
    assert reason(OSError(errno.EIO, "Input/output error")) == "input/output error"

    def cannot(*_: object) -> str:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr("spherecal.base.errors.phrase", cannot)
    assert "x.json" in str(OutputError(Phrase("error-cannot-read", {"file": "x.json", "why": "?"})))


def test_progress_has_numbers_and_words() -> None:
    iteration = Progress("bundle adjustment", 0.5, "", 3, 2.5)
    assert iteration.message == "iteration 3, cost 2.5" and iteration.words("de") == "Iteration 3, Kosten 2.5"
    seen: list[Progress] = []
    context = Context(seen.append).part_of("diagnosis", 0.25)
    context.report_iteration("bundle adjustment", 0.9, 4, 1.5)
    context.report("detect", 2.0, Phrase("image-of", {"number": 1, "images": 2}))
    assert [(one.stage, one.fraction, one.iteration, one.cost) for one in seen] == [
        ("diagnosis", 0.25, 4, 1.5),
        ("diagnosis", 0.25, None, None),
    ]
    assert seen[1].words("zh_CN") == "第 1 幅图像，共 2 幅" and Progress("detect", 0.0, "P1").words("de") == "P1"


# --- findings.json ---------------------------------------------------------------------------------------------------


def written(folder: Path, *findings: Finding) -> Path:
    (folder / "findings.json").write_text(json.dumps(findings_document(findings)), encoding="utf-8")
    return folder


def plainly(finding: Finding) -> Finding:
    return as_written(finding.severity, finding.code, finding.message, finding.hint, finding.where)


def test_values_come_back_from_their_file(tmp_path: Path) -> None:
    odd = Finding("two-view-points", "info", {"percent": float("nan")})
    written(tmp_path, moved(), odd)
    back = with_values([plainly(moved()), plainly(odd), as_written("info", "x", "m.", "h.")], tmp_path)
    assert [finding.written for finding in back] == [None, None, ("m.", "h.")]
    assert back[0].values == moved().values and back[0].repairs == moved().repairs
    assert back[0].severity == "warning" and back[0].words("message", "de") == moved().words("message", "de")
    other = replace(plainly(moved()), written=("Other words.", ""))
    assert with_values([other], tmp_path) == (other,), "the words of rig.json count"
    assert with_values([other], tmp_path / "empty") == (other,)
    assert findings_document([plainly(moved())]) is None


def test_a_findings_file_of_another_version_does_no_harm(tmp_path: Path) -> None:
    document = findings_document([moved()])
    assert document is not None
    entry = document["findings"][0]
    bad = [
        {**entry, "values": {}},
        {**entry, "values": {**entry["values"], "size": {"phrase": "no-such", "values": {}}}},
        {**entry, "values": {**entry["values"], "size": {"what": 1}}},
        {**entry, "code": "no-such-code"},
    ]
    (tmp_path / "findings.json").write_text(json.dumps({**document, "findings": [*bad, entry]}), encoding="utf-8")
    assert moved().message in [finding.message for finding in read_findings(tmp_path)]
    assert with_values([plainly(moved())], tmp_path)[0].values == moved().values
    (tmp_path / "findings.json").write_text('{"format": "spherecal/findings", "version": 1, "findings": [{}]}')
    with pytest.raises(InputError, match=r"findings\.json"):
        read_findings(tmp_path)


def test_values_as_json() -> None:
    value = (1, "a", 2.5, float("inf"), None, Phrase("camera", {"camera": "C1"}), ("x", ("y",)))
    assert from_json(json.loads(json.dumps(as_json(value)))) == value
    for wrong in ({"phrase": 1, "values": {}}, {"phrase": "camera"}, {"number": "x"}):
        with pytest.raises(ValueError):  # noqa: PT011
            from_json(wrong)


def test_the_tables_are_files_that_ship() -> None:
    for language in LANGUAGES:
        path = resource_path("messages", f"{language}.toml")
        assert tomllib.loads(path.read_text(encoding="utf-8"))["phrases"]
