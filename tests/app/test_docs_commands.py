"""The documents keep their word: commands run, options exist, files and codes named are there."""

import contextlib
import io
import re
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from xml.etree import ElementTree

import pytest
from conftest import ROOT

from spherecal.base.messages.catalogue import table
from spherecal_app.cli.main import main
from spherecal_app.cli.options import make_parser
from spherecal_files.read_session import read_session

DOCS = ROOT / "docs"
# The wizard's own page and studies are written by runs, decisions tell of what was.
PAGES = sorted(
    path for path in DOCS.rglob("*.md") if "decisions" not in path.parts and not path.name.startswith("studies")
)
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
PREPARE = re.compile(r"<!-- prepare: (.+?) -->")


@dataclass(frozen=True)
class Block:
    """One thing of a page to be run: `sh` or `python`."""

    language: str
    text: str


def blocks(page: Path) -> Iterator[Block]:
    """What a page wants to have run, preparations included, in order."""
    text = page.read_text(encoding="utf-8")
    for found in re.finditer(rf"{PREPARE.pattern}|{FENCE.pattern}", text, re.MULTILINE | re.DOTALL):
        prepare, language, body = found.groups()
        if prepare:
            yield Block("sh", prepare)
        elif language in ("sh", "python"):
            yield Block(language, body)


# Pages that run; of those in several languages the English one, whose commands the others have (see below).
RUNNABLE = [page for page in PAGES if any(blocks(page)) and page.parent.name not in ("de", "zh")]
TRANSLATED_PAGES = [page for page in PAGES if any(blocks(page)) and page.parent.name in ("de", "zh")]


@pytest.mark.parametrize("page", TRANSLATED_PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_a_translated_page_has_the_commands_of_the_english_one(page: Path) -> None:
    assert list(blocks(page)) == list(blocks(page.parents[1] / page.name))


# Commands that only read files and write what `-o` names: what a page has run, the next need not run on the same files.
REPEATED = ("calibrate", "report")
_written: dict[str, dict[str, bytes]] = {}


def run_line(line: str) -> None:
    """Run one line of a shell block in this process; only our own commands are known."""
    words = shlex.split(line, comments=True)
    if not words:
        return
    assert words[0] == "spherecal", f"only spherecal commands may stand in a block that is run: {line}"
    assert not set(words) & {"|", "&&", "&", ">"}, f"no shell syntax, please: {line}"
    if words[1] not in REPEATED:
        assert main(words[1:]) == 0, line
        return
    output = Path(make_parser().parse_args(words[1:]).output)
    others = [word for word in words[1:] if word != str(output)]
    assert len(others) == len(words) - 2, line
    known = repr((others, output.suffix, {name: sha256(data).digest() for name, data in files(Path()).items()}))
    if known not in _written:
        assert main(words[1:]) == 0, line
        _written[known] = files(output) if output.is_dir() else {"": output.read_bytes()}
    for name, data in _written[known].items():
        (output / name).parent.mkdir(parents=True, exist_ok=True)
        (output / name).write_bytes(data)


def files(folder: Path) -> dict[str, bytes]:
    """The bytes of every file in a folder, by their names there."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("page", RUNNABLE, ids=lambda page: str(page.relative_to(DOCS)))
def test_commands_of_a_page_run(
    page: Path, request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("SPHERECAL_BARS", str(tmp_path / "bars.json"))
    if page.name == "api.md":  # its example begins with a recorded session
        run_line("spherecal simulate demo --observations-only -o my-session")
    for block in blocks(page):
        if block.language == "python":
            exec(compile(block.text, str(page), "exec"), {"__name__": "example"})
        else:
            for line in block.text.splitlines():
                if line == "spherecal demo -o try":  # that was run
                    shutil.copytree(request.getfixturevalue("demo_tried") / "try", "try")
                else:
                    run_line(line)


def commands_named(page: Path) -> Iterator[str]:
    """Every line or inline code of a page that begins with `spherecal`."""
    text = page.read_text(encoding="utf-8")
    yield from re.findall(r"`(spherecal [^`\n]+)`", text)
    for line in re.findall(r"^(?: {4}|\t)(?:\.venv/bin/)?(spherecal .+)$", text, re.MULTILINE):
        yield re.split(r"\s{2,}|\s[&|#]", line)[0]


NAMING = [*PAGES, ROOT / "README.md", *sorted((ROOT / "examples").glob("*.md"))]


@pytest.mark.parametrize("page", NAMING, ids=lambda page: str(page.relative_to(ROOT)))
def test_whole_command_lines_are_ones_that_the_program_takes(page: Path) -> None:
    """Indented lines without brackets and alternatives: they cannot be run here, but are parsed to their last word."""
    text = re.sub(r" \\\n\s+", " ", page.read_text(encoding="utf-8"))
    for found in re.findall(r"^ {4}(?:\.venv/bin/)?spherecal ([^\n]+)$", text, re.MULTILINE):
        first = re.split(r"\s{2,}|\s#|\s&(?!&)", found)[0].removesuffix(" &&")
        for line in first.split(" && spherecal "):
            if re.search(r"[\[\]|]|\.\.\.", line):
                continue
            words = shlex.split(line)
            said = io.StringIO()
            with contextlib.redirect_stderr(said):
                try:
                    make_parser().parse_args(words)
                except SystemExit:
                    pytest.fail(f"{page.name}: spherecal {line}: {said.getvalue()}")


@pytest.mark.slow
def test_the_readmes_way_from_images_to_a_report_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its lines on one's own images, on those of the demo."""
    from spherecal.base.context import Context
    from spherecal_sim.render_session import demo_session

    session = read_session(demo_session(Context()))
    for placement in session.placements:
        for camera, image in placement.images.items():
            (tmp_path / "my-images" / camera).mkdir(parents=True, exist_ok=True)
            shutil.copy(image, tmp_path / "my-images" / camera / f"{placement.id}.png")
    monkeypatch.chdir(tmp_path)
    part = (ROOT / "README.md").read_text(encoding="utf-8").partition("## Your own images")[2].partition("\n## ")[0]
    lines = re.findall(r"^ {4}\.venv/bin/(spherecal .+)$", part, re.MULTILINE)
    assert [line.split()[1] for line in lines] == ["targets", "session", "calibrate", "report", "export"]
    for line in lines:
        run_line(line)
    assert (tmp_path / "my-report.pdf").read_bytes().startswith(b"%PDF") and any((tmp_path / "for-opencv").iterdir())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_commands_named_exist_with_their_options(page: Path) -> None:
    """Placeholders cannot be run; but the command and each option must be known to the program."""
    for line in commands_named(page):
        alternatives = line.replace("[", " ").replace("]", " ").rstrip(" \\").split()
        command = [word for word in alternatives[1:] if re.fullmatch(r"[a-z][a-z|-]*", word)]
        options = [word.rstrip(",.") for word in alternatives if word.startswith("--")]
        if command:
            text = help_of(tuple(command[:2]))
            missing = [option for option in options if option.split("=")[0] not in text]
            assert not missing, f"{page.name}: {line}: {missing} unknown"


@cache
def help_of(words: tuple[str, ...]) -> str:
    """The help of the longest chain of subcommands that the words name; every first word must be one."""
    first = words[0].split("|")[0]
    said = io.StringIO()
    chain = [first]
    with contextlib.redirect_stdout(said), pytest.raises(SystemExit) as left:
        make_parser().parse_args([first, "--help-all" if first == "calibrate" else "--help"])
    assert left.value.code == 0, f"there is no command {first}"
    for word in words[1:2]:  # what is no subcommand is an argument, whose help is that of the command
        inner = io.StringIO()
        quiet = contextlib.redirect_stderr(io.StringIO())
        with contextlib.redirect_stdout(inner), quiet, contextlib.suppress(SystemExit):
            make_parser().parse_args([*chain, word.split("|")[0], "--help"])
        said.write(inner.getvalue())
    return said.getvalue()


def test_dev_commands_named_exist() -> None:
    import dev

    for page in [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]:
        for name in re.findall(r"python3? dev\.py ([a-z]+)", page.read_text(encoding="utf-8")):
            assert name in dev.COMMANDS, f"{page.name}: dev.py {name}"


def test_finding_codes_named_are_ones_that_the_program_gives() -> None:
    """Codes that have words, which another test compares with those of the engine."""
    known = table("en")
    for page in DOCS.glob("guide/**/trouble.md"):
        codes = re.findall(r"^\| ((?:`[a-z-]+`,? ?)+)", page.read_text(encoding="utf-8"), re.MULTILINE)
        named = [code for cell in codes for code in re.findall(r"`([a-z-]+)`", cell)]
        assert len(named) > 15, page
        missing = [code for code in named if code not in known]
        assert not missing, f"{page}: {missing}"


@pytest.mark.parametrize("language", ["de", "zh"])
def test_the_guide_says_the_same_in_every_language(language: str) -> None:
    """The same pages, commands, pictures and finding codes."""
    for english in sorted((DOCS / "guide").glob("*.md")):
        other = DOCS / "guide" / language / english.name
        ours, theirs = english.read_text(encoding="utf-8"), other.read_text(encoding="utf-8")
        assert [b.text for b in blocks(english)] == [b.text for b in blocks(other)], other
        assert re.findall(r"pictures/(\S+)\)", ours) == re.findall(r"pictures/(\S+)\)", theirs), other
        codes = re.compile(r"^\| (`[a-z-]+`(?:, `[a-z-]+`)*)", re.MULTILINE)
        assert codes.findall(ours) == codes.findall(theirs), other
        assert ours.count("\n## ") == theirs.count("\n## "), other


# --- the guide and the window ----------------------------------------------------------------------------------------

BOLD = re.compile(r"\*\*(.+?)\*\*", re.DOTALL)
TRANSLATED = {"de": "spherecal_de.ts", "zh": "spherecal_zh_CN.ts"}


def plain(text: str) -> str:
    """A word of the window or of the guide, without shortcuts, line breaks and what a word ends with."""
    return re.sub(r"\s+", " ", text.replace("&", "")).rstrip(" :.…")


@cache
def words_on_screen(language: str) -> dict[str, set[str]]:
    """What the window shows for each of its English texts in a language: the English where nobody has translated it."""
    tree = ElementTree.parse(ROOT / "resources" / "translations" / TRANSLATED.get(language, TRANSLATED["de"]))
    shown: dict[str, set[str]] = {}
    for message in tree.getroot().iter("message"):
        source, translation = message.findtext("source") or "", message.find("translation")
        done = translation is not None and translation.get("type") is None and translation.text
        text = (translation.text or "") if done and translation is not None and language != "en" else source
        shown.setdefault(plain(source), set()).add(plain(text))
    titles = table({"zh": "zh_CN"}.get(language, language))
    for code, words in table("en").items():
        if "title" in words and code != "phrases":
            shown.setdefault(plain(words["title"]), set()).add(plain(titles[code]["title"]))
    for group, words in table("en")["words"].items():
        for code, said in words.items():
            shown.setdefault(plain(said), set()).add(plain(titles["words"][group][code]))
    return shown


@pytest.mark.parametrize("page", sorted(p.name for p in (DOCS / "guide").glob("*.md")))
def test_words_of_the_window_are_those_on_the_screen(page: str) -> None:
    """In the guide bold is what stands on the screen, word by word, in each language; emphasis is italic."""
    english = [plain(word) for word in BOLD.findall((DOCS / "guide" / page).read_text(encoding="utf-8"))]
    unknown = [word for word in english if word not in words_on_screen("en")]
    assert not unknown, f"{page}: not in the window: {unknown}"
    for language in TRANSLATED:
        shown = words_on_screen(language)
        theirs = [plain(word) for word in BOLD.findall((DOCS / "guide" / language / page).read_text(encoding="utf-8"))]
        assert len(theirs) == len(english), f"{language}/{page}: {len(theirs)} words in bold, {len(english)} in English"
        wrong = [(o, t, shown[o]) for o, t in zip(english, theirs, strict=True) if t not in shown[o]]
        assert not wrong, f"{language}/{page}: (English, guide, window): {wrong}"


def test_the_guides_description_of_the_bench_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Typed off the guide by somebody who reads only it."""
    from spherecal_cameras.plan import read_plan

    text = (DOCS / "guide" / "bench.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for prepare in PREPARE.findall(text):
        run_line(prepare)
    typed = re.search(r"```json\n(.*?)```", text, re.DOTALL)
    assert typed is not None
    (tmp_path / "bench.json").write_text(typed[1], encoding="utf-8")
    plan = read_plan(tmp_path / "bench.json")
    assert [one.id for one in plan.sets] == ["P1", "P2", "P3", "P4", "B-01", "B-02", "A-01"]
    assert {bar.role for bar in plan.bars} == {"scale", "check"}


def test_pictures_named_are_there() -> None:
    for page in PAGES:
        for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / name).is_file(), f"{page}: {name}"
