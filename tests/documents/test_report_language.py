# ruff: noqa: RUF001 - Chinese punctuation is meant
"""The report in the interface's language: nothing stays English, nothing loses its figures."""

import io
import json
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import cast

import cv2
import numpy as np
import pytest
from pypdf import PdfReader
from pypdf.generic import DictionaryObject

from spherecal.base.errors import InputError
from spherecal.base.messages.catalogue import LANGUAGES
from spherecal_app.cli.main import main
from spherecal_documents.report import language as language_module
from spherecal_documents.report.detections import Detection, detection_sections
from spherecal_documents.report.language import label, speaking, word, written
from spherecal_documents.report.model import FindingText, Report, Strong
from spherecal_documents.report.sections_rig import rig_sections
from spherecal_documents.report.style import chinese_fonts
from spherecal_documents.report.write_report import make_report, write_report
from spherecal_files.findings_file import Sentence, as_written
from spherecal_files.write_verification import write_verification
from spherecal_rigs.result_folder import Result, read_bar_report, read_result
from spherecal_verify.limit import parse_limit
from spherecal_verify.verify_bars import VerifySettings, verify
from tests.documents.test_report import pdf_texts

OTHERS = [name for name in LANGUAGES if name != "en"]
# Words that are the same in a language.
SAME: dict[str, tuple[str, ...]] = {"de": ("distribution-normal",), "zh_CN": ()}
# What is no sentence: names of files, hashes, the method's own names, formulas.
_NO_WORDS = re.compile(r"[\w.]+\.(json|csv|npy)|[0-9a-f]{16,}|[A-Z]?[\d .,%°×x\u202f−+–-]*|E = .*|auto")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small rig, calibrated, and verified against a limit with a bar whose certificate is wrong."""
    from spherecal.calibrate import calibrate
    from spherecal_files.write_result import write_result
    from spherecal_sim.simulate_session import simulate_session
    from spherecal_sim.truth import SimulationOptions

    folder = tmp_path_factory.mktemp("language") / "result"
    session, _ = simulate_session("rigA", 2, SimulationOptions(targets=40, placements=3, bar_poses=3))
    done = calibrate(session)
    write_result(done, folder, {"method": "auto", "seed": 0})
    longest = max(session.bars[0].lengths, key=lambda x: x.length_mm)
    lengths = tuple(replace(x, length_mm=x.length_mm + 0.6 * (x is longest)) for x in session.bars[0].lengths)
    wrong = replace(session, bars=(replace(session.bars[0], lengths=lengths), *session.bars[1:]))
    verified = verify(wrong, done.rig, None, VerifySettings(parse_limit("0.3+L/5000")))
    assert verified.procedure and verified.procedure.acceptance
    assert verified.procedure.acceptance.verdict == "cannot tell"
    write_verification(verified, folder, folder / "rig.json")
    return folder


def texts_of(report: Report) -> list[str]:
    """Every line that people read in the report, apart from names, figures and formulas; drawings are not looked at."""
    lines = {line for text in strings(report) for line in text.split("\n")}
    return sorted(line for line in lines if re.search(r"[A-Za-z]{3}", line) and not _NO_WORDS.fullmatch(line))


def strings(value: object) -> Iterator[str]:
    """The texts in a model."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Strong):
        yield value.text
    elif isinstance(value, tuple):
        for one in value:
            yield from strings(one)
    elif is_dataclass(value):
        words = (f for f in fields(value) if f.name not in ("key", "style", "colour", "severity", "finding"))
        yield from (text for f in words for text in strings(getattr(value, f.name)))


@pytest.mark.parametrize("name", OTHERS)
def test_nothing_stays_english(result: Path, name: str) -> None:
    """Sentences, headings and table cells with words, in a report with doubts, budgets and findings."""
    read = read_result(result)
    assert read.bars is not None
    english = {words for f in (*read.rig.quality.findings, *read.bars.findings) for words in (f.message, f.hint)}
    plain = set(texts_of(make_report(read)))
    assert len(plain) > 80
    with speaking(name):
        report = make_report(read)
        assert {label(one) for one in SAME[name]} >= plain & set(texts_of(report))
    found = report.blocks(FindingText)
    assert len(found) > 3
    assert not {words for f in found for words in (f.message, f.hint) if words} & english


def sentences(folder: Path) -> list[Sentence]:
    """The rule and the departures of a verification."""
    bars = read_bar_report(folder)
    assert bars is not None and bars.procedure is not None
    return [bars.rule, *bars.procedure.departures]


def with_changes(result: Path, folder: Path, change: Callable[[str, object], object]) -> Path:
    """A copy of a result whose verification.json has other phrases; `change` gets the field's name and value."""
    copy = folder / "changed"
    shutil.copytree(result, copy)

    def changed(value: object) -> object:
        if isinstance(value, list):
            return [changed(one) for one in value]
        if not isinstance(value, dict):
            return value
        said = {key: change(key, one) if "phrase" in key and key != "phrase" else one for key, one in value.items()}
        return {key: changed(one) for key, one in said.items() if one is not None}

    document = json.loads((copy / "verification.json").read_text())
    (copy / "verification.json").write_text(json.dumps(changed(document)))
    return copy


def test_sentences_of_a_file_come_through(result: Path) -> None:
    found = sentences(result)
    assert len(found) == 7 and all(one.phrase is not None for one in found)
    assert [written(one) for one in found] == [one.text for one in found]
    with speaking("de"):
        rule, *rest = (written(one) for one in found)
        assert rule.startswith("jede der 18 |Abweichungen| gegen k u, k = ")
        assert not {rule, *rest} & {one.text for one in found}
        assert word({"pass": "verdict-pass"}, "pass") == "bestanden" and word({}, "new") == "new"
    with pytest.raises(InputError) as raised, speaking("xx"):
        pass
    assert raised.value.code == "error-report-language"


def no_phrase(key: str, value: object) -> None:
    return None


def other_sentence(key: str, value: object) -> object:
    other = {"phrase": "departure-by-hand", "values": {}}
    return [other for _ in value][1:] if isinstance(value, list) else other


def values_of_another_version(key: str, value: object) -> object:
    strange = {"phrase": "decision-rule", "values": {"k": {"x": []}}}
    return [strange for _ in value] if isinstance(value, list) else strange


@pytest.mark.parametrize("change", [no_phrase, other_sentence, values_of_another_version])
def test_sentences_without_their_phrase_stay_as_written(
    result: Path, tmp_path: Path, change: Callable[[str, object], object]
) -> None:
    texts = [one.text for one in sentences(result)]
    with speaking("de"):
        assert [written(one) for one in sentences(with_changes(result, tmp_path, change))] == texts


@pytest.mark.parametrize(
    ("name", "word"), [("de", "VERIFIZIERUNG FEHLGESCHLAGEN"), ("zh_CN", "验证未通过"), ("en", "VERIFICATION FAILED")]
)
def test_the_first_page_speaks(result: Path, name: str, word: str) -> None:
    with speaking(name):
        text = " ".join(strings(make_report(read_result(result)).sections[:2]))
    assert word in text
    assert ("must not be put to use" in text) == (name == "en")
    assert "length-doubtful" not in text


def test_pages_of_cameras_and_detections_speak(result: Path, tmp_path: Path) -> None:
    read = read_result(result)
    camera = read.rig.cameras[0]
    assert camera.sigma is not None
    fixed = replace(camera, sigma=replace(camera.sigma, intrinsics=np.zeros_like(camera.sigma.intrinsics)))
    read = replace(read, rig=replace(read.rig, cameras=(fixed, *read.rig.cameras[1:])))
    file = tmp_path / "image.png"
    cv2.imwrite(str(file), np.zeros(camera.image_size[::-1], np.uint8))
    uv = np.array([[400.0, 400.0], [420.0, 400.0]])
    seen = Detection("P1", camera.id, file, uv, np.array([1, 1]), np.array([True, True]))
    for name, words in (("en", {"fixed", "Detail"}), ("de", {"fest", "Ausschnitt"})):
        with speaking(name):
            texts = set(strings((rig_sections(read), tuple(detection_sections(read, [seen])))))
        assert words <= texts


@pytest.mark.parametrize("name", OTHERS)
def test_html_and_json_in_a_language(result: Path, tmp_path: Path, name: str) -> None:
    for ending in ("html", "json"):
        output = tmp_path / f"r.{ending}"
        assert main(["report", str(result), "-o", str(output), "--language", name]) == 0
    html = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert f'lang="{name.replace("_", "-")}"' in html
    assert {"de": "Unsicherheitsbudget", "zh_CN": "不确定度评定"}[name] in html
    assert "Uncertainty budget" not in html and "Assessed by" not in html
    document = json.loads((tmp_path / "r.json").read_bytes())
    assert document["format"] == "spherecal/report"
    english = tmp_path / "en.json"
    write_report(result, english)
    plain = json.loads(english.read_bytes())
    for a, b in zip(document["sections"], plain["sections"], strict=True):
        assert a["key"] == b["key"] and a["title"] != b["title"]
        figures = [re.findall(r"[\d.]{3,}", " ".join(row)) for t in a["tables"] for row in t["rows"]]
        assert figures == [re.findall(r"[\d.]{3,}", " ".join(row)) for t in b["tables"] for row in t["rows"]]


def test_a_pdf_in_chinese_can_be_read(result: Path, tmp_path: Path) -> None:
    """After one in English, in whose fonts there are no Chinese characters."""
    if not chinese_fonts():
        pytest.skip("this computer has no font with Chinese characters")
    write_report(result, tmp_path / "en.pdf")
    write_report(result, tmp_path / "zh.pdf", language="zh_CN")
    ours, theirs = (fonts_of((tmp_path / name).read_bytes()) for name in ("en.pdf", "zh.pdf"))
    assert any(name.startswith("Inter") for name in ours) and theirs - ours
    text = "".join(pdf_texts((tmp_path / "zh.pdf").read_bytes())).replace(" ", "")
    with speaking("zh_CN"):
        report = make_report(read_result(result))
    for section in report.sections:
        for said in (section.title, *section.texts):
            assert "".join(said.split()) in text


def fonts_of(pdf: bytes) -> set[str]:
    """The names of a PDF's fonts, without the letters before the plus."""
    found = set[str]()
    for page in PdfReader(io.BytesIO(pdf)).pages:
        resources = cast(DictionaryObject, page["/Resources"])
        for font in cast(DictionaryObject, resources["/Font"]).values():
            found.add(str(font.get_object()["/BaseFont"]).rpartition("+")[2])
    return found


def test_a_pdf_in_chinese_needs_a_font(result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from spherecal_documents.report import pdf as module

    monkeypatch.setattr(module, "chinese_fonts", lambda: ())
    with pytest.raises(InputError, match="no font with Chinese characters"):
        write_report(result, tmp_path / "r.pdf", language="zh_CN")
    assert not (tmp_path / "r.pdf").exists()


def test_unknown_findings_stay_as_they_are(result: Path) -> None:
    read: Result = read_result(result)
    odd = as_written("info", "new-one", "Something that was never said before: 5.", "Do nothing.", ())
    quality = replace(read.rig.quality, findings=(odd,))
    with speaking("de"):
        report = make_report(replace(read, rig=replace(read.rig, quality=quality)))
    assert report.blocks(FindingText)[0].message == odd.message
    assert language_module.language_now() == "en"
