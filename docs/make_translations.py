"""Brings the window's translations up to date: `python3 dev.py translations`.

Collects every text of `spherecal_gui` into resources/translations/spherecal_LANGUAGE.ts (to be edited with Qt Linguist)
and compiles these into the .qm files that the program reads. Exit code 1 where a text is not translated yet.
"""

import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "resources" / "translations"
LANGUAGES = ("de", "zh_CN")


def tool(name: str) -> str:
    """Qt's program of this name, as PySide6 brings it."""
    return str(Path(sys.executable).with_name(name + (".exe" if os.name == "nt" else "")))


def sources() -> list[str]:
    """All files with texts, relative to the repository."""
    return sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "spherecal_gui").rglob("*.py"))


def collect(output: Path, language: str) -> None:
    """Update a .ts file: new texts come in, those that are gone go, what is translated stays."""
    command = [tool("pyside6-lupdate"), *sources(), "-ts", str(output), "-source-language", "en_US"]
    command += ["-target-language", language, "-no-obsolete", "-locations", "none", "-silent"]
    subprocess.run(command, cwd=ROOT, check=True)


def compile_file(source: Path, output: Path) -> None:
    """Make the .qm file that Qt reads."""
    subprocess.run([tool("pyside6-lrelease"), "-silent", str(source), "-qm", str(output)], cwd=ROOT, check=True)


def unfinished(path: Path) -> list[str]:
    """The texts of a .ts file that have no finished translation."""
    missing = []
    for message in ET.parse(path).iter("message"):
        translation = message.find("translation")
        if translation is None or translation.get("type") is not None or not (translation.text or "").strip():
            missing.append(message.findtext("source", ""))
    return missing


def main() -> int:
    """Update and compile all languages."""
    code = 0
    for language in LANGUAGES:
        path = FOLDER / f"spherecal_{language}.ts"
        collect(path, language)
        missing = unfinished(path)
        for text in missing:
            print(f"{path.name}: not translated: {text}")
        compile_file(path, path.with_suffix(".qm"))
        print(f"{path.name}: {len(list(ET.parse(path).iter('message')))} texts, {len(missing)} not translated")
        code = code or int(bool(missing))
    return code


if __name__ == "__main__":
    sys.exit(main())
