"""German and Chinese: every text is there, keeps its placeholders, and the compiled files are those of the texts."""

import ast
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6.QtWidgets", reason="Qt cannot be loaded here", exc_type=ImportError)

from PySide6.QtWidgets import QLabel

from spherecal.base.resources import resource_path
from spherecal_gui import app, languages
from spherecal_gui.workflow import Step
from tests.conftest import ROOT

sys.path.insert(0, str(ROOT / "docs"))
import make_translations as made

OTHERS = tuple(code for code in languages.LANGUAGES if code != "en")
FIELD = re.compile(r"\{[^}]*\}")


@pytest.fixture
def english_again(qapp):
    yield
    languages.use("en")


def ts(language: str) -> Path:
    return resource_path("translations", f"spherecal_{language}.ts")


def messages(path: Path) -> list[tuple[str, str]]:
    found = ET.parse(path).iter("message")
    return [(one.findtext("source", ""), one.findtext("translation", "")) for one in found]


def test_the_languages_are_those_that_are_made():
    assert set(OTHERS) == set(made.LANGUAGES)


@pytest.mark.parametrize("language", OTHERS)
def test_every_text_is_translated(language, tmp_path):
    """Collected again from the sources, so that a text that came in since is missed."""
    if not Path(made.tool("pyside6-lupdate")).exists():
        pytest.skip("pyside6-lupdate is not installed")
    fresh = tmp_path / "fresh.ts"
    fresh.write_bytes(ts(language).read_bytes())
    made.collect(fresh, language)
    assert made.unfinished(fresh) == [], "run: python3 dev.py translations, then translate them with Qt Linguist"
    assert len(messages(fresh)) > 400


def test_no_text_is_where_it_is_not_collected():
    """Qt's lupdate does not look into f-strings: three texts stayed English."""
    found = []
    for path in (ROOT / "spherecal_gui").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.JoinedStr):
                continue
            calls = [one for one in ast.walk(node) if isinstance(one, ast.Call)]
            names = {getattr(one.func, "attr", getattr(one.func, "id", "")) for one in calls}
            found += [f"{path.name}:{node.lineno}"] if names & {"tr", "translate"} else []
    assert found == []


@pytest.mark.parametrize("language", OTHERS)
def test_placeholders_and_breaks_are_kept(language):
    for source, translated in messages(ts(language)):
        assert sorted(FIELD.findall(source)) == sorted(FIELD.findall(translated)), source
        assert source.count("\n") == translated.count("\n"), source
        assert translated.strip() == translated, source


@pytest.mark.parametrize("language", OTHERS)
def test_the_compiled_file_is_that_of_the_texts(language, tmp_path):
    if not Path(made.tool("pyside6-lrelease")).exists():
        pytest.skip("pyside6-lrelease is not installed")
    made.compile_file(ts(language), tmp_path / "again.qm")
    assert (tmp_path / "again.qm").read_bytes() == ts(language).with_suffix(".qm").read_bytes()


def test_chinese_is_chinese_and_german_is_not_english():
    for source, translated in messages(ts("zh_CN")):
        letters = re.sub(r"\{[^}]*\}|[^A-Za-z]", "", source)
        if len(letters) > 6:
            assert re.search(r"[一-鿿]", translated), source
    same = [source for source, german in messages(ts("de")) if source == german and len(source) > 12]
    assert not [text for text in same if "{" not in text], same


@pytest.mark.parametrize("language", OTHERS)
def test_help_is_there_in_every_language(language):
    english = {path.name for path in resource_path("help", "en").glob("*.html")}
    assert {path.name for path in resource_path("help", language).glob("*.html")} == english
    assert len(english) == 11
    for path in resource_path("help", language).glob("*.html"):
        (picture,) = re.findall(r'<img src="([^"]+)"', path.read_text(encoding="utf-8"))
        assert (path.parent / picture).is_file(), path


@pytest.mark.parametrize(("language", "word", "step"), [("de", "Kalibrieren", "Verbinden"), ("zh_CN", "标定", "连接")])
def test_the_window_speaks(qtbot, tmp_path, monkeypatch, english_again, language, word, step):
    from spherecal_gui.languages import step_title

    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    languages.use(language)
    window = app.make_window(tmp_path / "projects")
    qtbot.addWidget(window)
    words = {label.text() for label in window.findChildren(QLabel)}
    assert word in words
    assert step_title(Step("connect", "connect")) == step
    window.close()


def test_words_of_a_parent_class_are_found_by_its_children(qtbot, english_again):
    """`tr` looks in the class of the object first: a page that inherits a text must still find it."""
    from spherecal_gui.controllers.controller import Controller
    from spherecal_gui.pages.verify_page import VerifyPage

    languages.use("de")
    page = VerifyPage(Controller())
    qtbot.addWidget(page)
    assert page.again.text() == "Letzte Lage neu aufnehmen"


def test_another_language_makes_the_window_anew_and_goes_on(qtbot, tmp_path, monkeypatch, english_again):
    monkeypatch.setenv("SPHERECAL_SETTINGS", str(tmp_path / "settings.ini"))
    program = app.Program(tmp_path / "projects", "en")
    program.window.new_project("simulated:nonsense")
    qtbot.waitUntil(lambda: program.window.controller.runner.running is None, timeout=120_000)
    folder = program.window.controller.project.folder
    program.speak("de")
    window = program.window
    qtbot.waitUntil(lambda: window.controller.runner.running is None, timeout=120_000)
    assert window.header.home.text() == "Startseite"
    assert window.controller.project.folder == folder
    assert window.settings.value("language") == "de"
    window.close()


def test_the_command_tells_what_is_missing(tmp_path):
    broken = tmp_path / "x.ts"
    broken.write_text(
        '<TS><context><message><source>a</source><translation type="unfinished"></translation></message>'
        "<message><source>b</source><translation>c</translation></message></context></TS>"
    )
    assert made.unfinished(broken) == ["a"]


def test_lupdate_runs_here():
    """Else the test of missing texts would pass for the wrong reason."""
    tool = made.tool("pyside6-lupdate")
    if not Path(tool).exists():
        pytest.skip("pyside6-lupdate is not installed")
    assert subprocess.run([tool, "-version"], capture_output=True, check=False).returncode == 0
