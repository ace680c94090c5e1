"""Which parts of others this program consists of, under which licences, as installed here; the bill of materials."""

import json
import platform
import re
import sys
import uuid
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from spherecal import __version__
from spherecal.base.resources import resource_path

EXTRAS = ("gui", "cameras")
_TEXT_FILES = re.compile(r"(licen[cs]e|copying|notice|copyright)[^/]*$", re.IGNORECASE)
_LONGEST_NAME = 60  # some packages put the whole text into the field that is meant for the name
_SPDX = re.compile(r"[A-Za-z0-9.+-]+( (AND|OR|WITH) [A-Za-z0-9.+-]+)*")
# Packages whose metadata name the licence in words of their own.
_SAID_OTHERWISE = {
    "Apache 2.0": "Apache-2.0",
    "Apache Software License V2.0": "Apache-2.0",
    "BSD": "BSD-3-Clause",
    "License agreement for matplotlib versions 1.3.0 and later": "PSF-2.0",
}

# Files of others in resources: name, version, licence, home page, the file with its text.
_SHIPPED = (
    ("Inter", "3.19", "OFL-1.1", "https://rsms.me/inter", "Inter-OFL-1.1.txt"),
    ("Tabler Icons", "3.51.0", "MIT", "https://tabler.io/icons", "Tabler-Icons-MIT.txt"),
)

LGPL_NOTE = """\
Qt, PySide6 and Shiboken6 (The Qt Company Ltd. and others) are used under the GNU Lesser General Public License,
version 3. They are separate shared libraries, in the folder PySide6 beside this program or in the Python environment:
you may replace them by your own builds of the same interfaces, and nothing in SphereCal's licence forbids to take it
apart for debugging such a replacement. Their source code of exactly this version is offered by the Qt Project
(download.qt.io, folder qtforpython and qt); whoever passes SphereCal on passes on this notice and the texts of the LGPL
and the GPL that follow."""


@dataclass(frozen=True)
class LicensedPart:
    """One part: its name, version, licence (an SPDX expression where one is known), home page and licence texts."""

    name: str
    version: str
    licence: str
    home: str = ""
    texts: tuple[tuple[str, str], ...] = ()


def parts(extras: Iterable[str] = EXTRAS) -> tuple[LicensedPart, ...]:
    """Python, all packages that are installed here and that `spherecal[extras]` needs, font and icons; by name."""
    found = [_part(one) for name, one in _closure(extras).items() if name != "spherecal"]
    found += shipped() if "gui" in extras else ()
    return (_python(), *sorted(found, key=lambda part: part.name.lower()))


def shipped() -> tuple[LicensedPart, ...]:
    """The font and the icons of the window, which are files of others in our resources."""
    return tuple(
        LicensedPart(
            name, version, licence, home, ((text, resource_path("licences", text).read_text(encoding="utf-8")),)
        )
        for name, version, licence, home, text in _SHIPPED
    )


def licence_text() -> str:
    """The parts as one text: a list, the note on Qt where it is there, then each part's own texts."""
    known = parts()
    lines = [f"SphereCal {__version__} is under the Apache License 2.0. It contains or uses:", ""]
    lines += [f"  {part.name} {part.version}: {part.licence}" for part in known]
    if any(part.name.lower().startswith("pyside6") for part in known):
        lines += ["", LGPL_NOTE]
        for name in ("LGPL-3.0", "GPL-3.0"):
            lines += ["", "=" * 100, name, "", resource_path("licences", f"{name}.txt").read_text(encoding="utf-8")]
    for part in known:
        for name, text in part.texts:
            lines += ["", "=" * 100, f"{part.name} {part.version}: {name}", "", text]
    return "\n".join(lines) + "\n"


def bill_of_materials() -> bytes:
    """The parts as CycloneDX 1.5 JSON; the same parts give the same bytes (no time stamp, number from the contents)."""
    known, installed = parts(), _closure(EXTRAS)
    components = [_component(part) for part in known]
    references = {_key(part.name): component["bom-ref"] for part, component in zip(known, components, strict=True)}
    references["spherecal"] = f"pkg:pypi/spherecal@{__version__}"
    dependencies = []
    for name, one in installed.items():
        needed = _needs(one, EXTRAS if name == "spherecal" else ()) & references.keys()
        dependencies.append({"ref": references[name], "dependsOn": sorted(references[n] for n in needed)})
    document: dict[str, Any] = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "name": "SphereCal",
                "version": __version__,
                "bom-ref": references["spherecal"],
                "licenses": [{"license": {"id": "Apache-2.0"}}],
            }
        },
        "components": components,
        "dependencies": sorted(dependencies, key=lambda entry: entry["ref"]),
    }
    contents = json.dumps(document, sort_keys=True)
    document["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_OID, contents)}"
    return (json.dumps(document, indent=1) + "\n").encode()


def _component(part: LicensedPart) -> dict[str, Any]:
    generic = part.name in ("Python", *(one[0] for one in _SHIPPED))
    reference = f"pkg:{'generic' if generic else 'pypi'}/{_key(part.name)}@{part.version}"
    known = _SPDX.fullmatch(part.licence) is not None
    single = known and " " not in part.licence and not part.licence.startswith("LicenseRef")
    if single:
        licence: Mapping[str, Any] = {"license": {"id": part.licence}}
    else:
        licence = {"expression": part.licence} if known else {"license": {"name": part.licence}}
    component = {
        "type": "library", "name": part.name, "version": part.version, "bom-ref": reference, "purl": reference,
        "licenses": [licence],
    }  # fmt: skip
    return component


def _closure(extras: Iterable[str]) -> dict[str, Distribution]:
    """All installed distributions that `spherecal[extras]` needs, itself first, by normalised name."""
    found: dict[str, Distribution] = {}
    waiting: list[tuple[str, tuple[str, ...]]] = [("spherecal", tuple(extras))]
    while waiting:
        name, wanted = waiting.pop(0)
        if name in found:
            continue
        try:
            found[name] = distribution(name)
        except PackageNotFoundError:  # of an extra that is not installed
            continue
        waiting += [(needed, ()) for needed in sorted(_needs(found[name], wanted))]
    return found


def _needs(one: Distribution, extras: Iterable[str]) -> set[str]:
    """The normalised names of what a distribution needs on this machine with these extras."""
    from packaging.requirements import Requirement

    asked = [Requirement(text) for text in one.requires or ()]
    return {
        _key(r.name) for r in asked if r.marker is None or any(r.marker.evaluate({"extra": e}) for e in ("", *extras))
    }


def _part(one: Distribution) -> LicensedPart:
    fields = one.metadata
    homes = [url.partition(",")[2].strip() for url in fields.get_all("Project-URL") or ()]
    texts = {}
    for file in one.files or ():
        if ".dist-info/" in str(file) and _TEXT_FILES.search(str(file)):
            path = Path(str(file.locate()))
            if path.is_file():
                texts[path.name] = path.read_text(encoding="utf-8", errors="replace")
    return LicensedPart(
        name=fields["Name"],
        version=one.version,
        licence=_licence(one),
        home=_field(one, "Home-page") or (homes[0] if homes else ""),
        texts=tuple(sorted(texts.items())),
    )


def _licence(one: Distribution) -> str:
    """The licence's name: the expression, else the short field, else what the classifiers say."""
    said = (_field(one, "License-Expression") or _field(one, "License")).strip()
    if said and len(said) <= _LONGEST_NAME and "\n" not in said:
        return _SAID_OTHERWISE.get(said, said)
    classifiers = one.metadata.get_all("Classifier") or ()
    classified = [c.split(" :: ")[-1] for c in classifiers if c.startswith("License ::")]
    return " AND ".join(classified) or "see its licence text"


def _field(one: Distribution, name: str) -> str:
    return next(iter(one.metadata.get_all(name) or ("",)))


def _python() -> LicensedPart:
    library = Path(sys.base_prefix) / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}"
    candidates = (
        resource_path("licences", "Python.txt"),
        library / "LICENSE.txt",
        Path(sys.base_prefix) / "LICENSE.txt",
    )
    text = next((path.read_text(encoding="utf-8") for path in candidates if path.is_file()), "")
    return LicensedPart(
        "Python", platform.python_version(), "PSF-2.0", "https://www.python.org", (("LICENSE", text),) if text else ()
    )


def _key(name: str) -> str:
    return re.sub(r"[-_. ]+", "-", name).lower()
