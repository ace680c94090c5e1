"""The report's other forms: HTML, JSON and the calibration certificate; what the verification adds to its pages."""

import json
import re
import shutil
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from spherecal.base.errors import InputError
from spherecal_app.cli.main import main
from spherecal_documents.report.dcc import ISSUER, clean, dcc_bytes, decimal
from spherecal_documents.report.html import _STYLE
from spherecal_documents.report.sections_rig import image_cells
from spherecal_documents.report.write_report import make_report, write_report
from spherecal_documents.scene.picture import scene_picture
from spherecal_rigs.result_folder import read_result
from tests.documents.test_report import PICTURE, page_texts

STATED = {
    "format": "spherecal/issuer", "version": 1,
    "laboratory": {"name": "Measuring Room 3", "city": "Braunschweig", "country": "DE", "email": "m3@example.com"},
    "customer": {"name": "Works & Sons <Ltd>", "city": "Ulm", "country": "DE"}, "person": "A. Person",
    "rig_serial": "RIG-7", "begin": "2026-11-20", "end": "2026-11-21", "place": "customer",
}  # fmt: skip


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small rig, calibrated, and verified against a limit."""
    from spherecal.calibrate import calibrate
    from spherecal_files.write_result import write_result
    from spherecal_files.write_verification import write_verification
    from spherecal_sim.simulate_session import simulate_session
    from spherecal_sim.truth import SimulationOptions
    from spherecal_verify.limit import parse_limit
    from spherecal_verify.verify_bars import VerifySettings, verify

    folder = tmp_path_factory.mktemp("forms") / "result"
    session, _ = simulate_session("rigA", 2, SimulationOptions(targets=40, placements=3, bar_poses=2))
    done = calibrate(session)
    write_result(done, folder, {"seed": 0})
    verification = verify(session, done.rig, None, VerifySettings(parse_limit("0.3+L/5000")))
    write_verification(verification, folder, folder / "rig.json")
    return folder


class Texts(HTMLParser):
    """Collects the texts, the tags, and whether every tag is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.open: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "br"):
            self.open.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_all_forms_say_the_same(result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rig in space is drawn: that the command shows a rendered scene, tests/documents/test_report.py says."""
    monkeypatch.setenv("SPHERECAL_3D", "painted")
    for form in ("html", "json"):
        assert main(["report", str(result), "-o", str(tmp_path / f"r.{form}")]) == 0
        again = tmp_path / f"again.{form}"
        write_report(result, again, render=scene_picture)
        assert again.read_bytes() == (tmp_path / f"r.{form}").read_bytes()
    document = json.loads((tmp_path / "r.json").read_bytes())
    write_report(result, tmp_path / "rendered.html", render=lambda *_: PICTURE)
    rendered = Texts()
    rendered.feed((tmp_path / "rendered.html").read_text())
    page = Texts()
    page.feed((tmp_path / "r.html").read_text())
    assert page.open == rendered.open == []
    assert any(link.startswith("data:image/png") for link in rendered.links)
    assert all(
        link.startswith(("#", "data:image/png;base64,")) for link in (*page.links, *rendered.links)
    )  # nothing is loaded from anywhere
    shown = " ".join(" ".join(page.texts).split())
    joined = " ".join(page_texts(result))
    squeezed = joined.replace(" ", "")
    assert document["verdicts"][1]["verdict"] == "PASS"
    for section in document["sections"]:
        assert section["title"] in shown and section["title"] in joined
        for text in section["paragraphs"]:
            assert " ".join(text.split()) in shown and "".join(text.split()) in squeezed
        for table in section["tables"]:
            assert all(len(row) == len(table["columns"]) for row in table["rows"])
            for row in table["rows"]:
                for cell in row:
                    assert " ".join(cell.split()) in shown and "".join(cell.split()) in squeezed
    for key in ("conformity", "budget", "artefacts", "departures", "exclusions", "coverage", "origin", "uncertainty"):
        assert any(section["key"] == key for section in document["sections"])
    for name in ("Assessed by", "Date", "Signature"):
        assert name in joined and name in shown
    budget = next(s for s in document["sections"] if s["key"] == "budget")
    parts = {"certificate", "thermometer", "expansion", "centring", "resolution"}
    assert {row[0] for row in budget["tables"][0]["rows"]} == parts


def test_the_style_sheet_is_whole() -> None:
    assert _STYLE.count("{") == _STYLE.count("}")
    numbers = re.findall(r"[ :(,]([\d.]+)(?:rem|px|%|fr)", _STYLE)
    assert "1.2" in numbers and not [n for n in numbers if re.match(r"0\d", n)], "two numbers without a blank"


def test_hostile_names_stay_text(tmp_path: Path, result: Path) -> None:
    copy = tmp_path / "result"
    copy.mkdir()
    for path in result.iterdir():
        text = path.read_bytes()
        if path.suffix in (".json", ".csv"):
            text = text.replace(b"SphereCal", b"<script>x</script>")
        (copy / path.name).write_bytes(text)
    document = json.loads((copy / "rig.json").read_bytes())
    document.pop("covariance", None)
    for camera in document["cameras"]:  # ids are plain names, serial numbers are whatever the maker wrote
        camera["serial"] = "<b>C&1"
    for finding in document["quality"]["findings"]:
        finding["message"] += " <b>C&1"
    (copy / "rig.json").write_text(json.dumps(document))
    write_report(copy, tmp_path / "r.html")
    html = (tmp_path / "r.html").read_text()
    assert "<script" not in html and "<b>C&1" not in html and "&lt;b&gt;C&amp;1" in html
    Xml.fromstring(dcc_bytes(read_result(copy), ISSUER.read(written(tmp_path, STATED))))


def test_image_cells_count_the_used_observations(result: Path) -> None:
    read = read_result(result)
    for camera in read.rig.cameras:
        cells = image_cells(read, camera.id)
        assert cells is not None
        assert cells.shape[1] == 10
        own = read.residuals.rows_of[camera.id]
        assert 0.98 * read.residuals.used[own].sum() <= cells.sum() <= read.residuals.used[own].sum()
    assert image_cells(read, "none") is None


def test_hashes_are_those_of_the_files(result: Path) -> None:
    import hashlib

    section = make_report(read_result(result)).section("origin")
    assert section is not None
    rows = {row[0]: row[1] for row in section.tables[0].rows}
    for name in ("rig.json", "points.csv", "verification.json", "covariance.npy"):
        assert rows[name] == hashlib.sha256((result / name).read_bytes()).hexdigest()


def written(folder: Path, document: object) -> Path:
    path = folder / "issuer.json"
    path.write_text(json.dumps(document))
    return path


# The content model of DCC 3.2.1 and D-SI 2.1.0 as far as a certificate of ours goes: each element's children in order
# with least and most, transcribed from the published schemas; a text stands for a text of this form. The certificate
# has one language, so one content. Of these elements dcc.xsd 3.3.0 has the same order, numbers and values.
TEXT = r"\S+(\s+\S+)*"
CONTACT = [("name", 1, 1), ("eMail", 0, 1), ("location", 0, 1)]
MODEL: dict[str, object] = {
    "digitalCalibrationCertificate": [("administrativeData", 1, 1), ("measurementResults", 1, 1)],
    "administrativeData": [
        ("dccSoftware", 1, 1), ("coreData", 1, 1), ("items", 1, 1), ("calibrationLaboratory", 1, 1),
        ("respPersons", 1, 1), ("customer", 1, 1),
    ],
    "dccSoftware": [("software", 1, 99)], "usedSoftware": [("software", 1, 99)],
    "software": [("name", 1, 1), ("release", 1, 1)], "release": TEXT,
    "coreData": [
        ("countryCodeISO3166_1", 1, 1), ("usedLangCodeISO639_1", 1, 9), ("mandatoryLangCodeISO639_1", 1, 9),
        ("uniqueIdentifier", 1, 1), ("beginPerformanceDate", 1, 1), ("endPerformanceDate", 1, 1),
        ("performanceLocation", 1, 1),
    ],
    "countryCodeISO3166_1": "[A-Z]{2}", "usedLangCodeISO639_1": "[a-z]{2}", "mandatoryLangCodeISO639_1": "[a-z]{2}",
    "uniqueIdentifier": TEXT, "beginPerformanceDate": r"\d{4}-\d\d-\d\d", "endPerformanceDate": r"\d{4}-\d\d-\d\d",
    "performanceLocation": "laboratory|customer|laboratoryBranch|customerBranch|other",
    "items": [("item", 1, 999)], "item": [("name", 1, 1), ("manufacturer", 1, 1), ("identifications", 1, 1)],
    "identifications": [("identification", 1, 99)],
    "identification": [("issuer", 1, 1), ("value", 1, 1), ("name", 0, 1)],
    "issuer": "manufacturer|calibrationLaboratory|customer|owner|other", "{dcc}value": TEXT,
    "calibrationLaboratory": [("contact", 1, 1)], "contact": [("name", 1, 1), ("eMail", 0, 1), ("location", 1, 1)],
    "customer": [("name", 1, 1), ("eMail", 0, 1), ("location", 1, 1)], "manufacturer": CONTACT, "person": CONTACT,
    "location": [("city", 0, 1), ("countryCode", 0, 1)], "city": TEXT, "countryCode": "[A-Z]{2}", "eMail": TEXT,
    "respPersons": [("respPerson", 1, 99)], "respPerson": [("person", 1, 1), ("mainSigner", 0, 1)],
    "mainSigner": "true|false", "name": [("content", 1, 1)], "content": r"[\s\S]+",
    "measurementResults": [("measurementResult", 1, 99)],
    "measurementResult": [
        ("name", 1, 1), ("description", 0, 1), ("usedMethods", 0, 1), ("usedSoftware", 0, 1),
        ("measuringEquipments", 0, 1), ("influenceConditions", 0, 1), ("results", 1, 1), ("measurementMetaData", 0, 1),
    ],
    "description": [("content", 1, 1)], "declaration": [("content", 1, 1)], "text": [("content", 1, 1)],
    "usedMethods": [("usedMethod", 1, 99)], "usedMethod": [("name", 1, 1), ("norm", 0, 9)], "norm": TEXT,
    "measuringEquipments": [("measuringEquipment", 1, 99)],
    "measuringEquipment": [("name", 1, 1), ("identifications", 0, 1)],
    "influenceConditions": [("influenceCondition", 1, 99)], "influenceCondition": [("name", 1, 1), ("data", 1, 1)],
    "results": [("result", 1, 999)], "result": [("name", 1, 1), ("description", 0, 1), ("data", 1, 1)],
    "data": [("text", 0, 1), ("quantity", 0, 9999)], "quantity": [("name", 0, 1), ("{si}real", 1, 1)],
    "{si}real": [("{si}value", 1, 1), ("{si}unit", 1, 1), ("{si}expandedUnc", 0, 1)],
    "{si}value": r"[-+]?\d+(\.\d+)?", "{si}unit": r"(\\[a-z]+)+",
    "{si}expandedUnc": [
        ("{si}uncertainty", 1, 1), ("{si}coverageFactor", 1, 1), ("{si}coverageProbability", 1, 1),
        ("{si}distribution", 0, 1),
    ],
    "{si}uncertainty": r"\d+(\.\d+)?", "{si}coverageFactor": r"[1-9]\d*(\.\d+)?",
    "{si}coverageProbability": r"0\.\d+", "{si}distribution": TEXT,
    "measurementMetaData": [("metaData", 1, 99)],
    "metaData": [
        ("name", 0, 1), ("description", 0, 1), ("norm", 0, 9), ("declaration", 0, 1), ("conformity", 0, 1),
    ],
    "conformity": "pass|fail|conditionalPass|conditionalFail|noPass|noFail",
}  # fmt: skip


def short(tag: str) -> str:
    return tag.replace("{https://ptb.de/dcc}", "").replace("{https://ptb.de/si}", "{si}")


def check_model(element: Xml.Element) -> None:
    """An element against the transcribed model, and all below it."""
    name = short(element.tag)
    model = MODEL.get("{dcc}value" if name == "value" else name)
    assert model is not None, name
    if isinstance(model, str):
        assert not len(element) and re.fullmatch(model, element.text or ""), (name, element.text)
        return
    assert isinstance(model, list)
    names = [short(child.tag) for child in element]
    assert names, name
    order = [one for one, _, _ in model]
    assert set(names) <= set(order), (name, names)
    assert names == sorted(names, key=order.index), (name, names)
    for one, least, most in model:
        assert least <= names.count(one) <= most, (name, one)
    for child in element:
        check_model(child)


def test_the_certificate_keeps_the_content_model(result: Path, tmp_path: Path) -> None:
    """As far as a transcription of the schema goes; `test_the_certificate_is_valid` asks the schema itself."""
    output = tmp_path / "certificate.xml"
    assert main(["report", str(result), "-o", str(output), "--issuer", str(written(tmp_path, STATED))]) == 0
    root = Xml.fromstring(output.read_bytes())
    assert root.get("schemaVersion") == "3.2.1"
    check_model(root)
    read = read_result(result)
    dcc, si = "{https://ptb.de/dcc}", "{https://ptb.de/si}"
    assert read.bars is not None
    # the numbers are those of the files
    first = root.findall(f".//{dcc}measurementResult")[0].findall(f".//{dcc}result")
    assert len(first) == len(read.rig.cameras)
    camera = read.rig.cameras[0]
    values = {
        q.findtext(f"{dcc}name/{dcc}content"): float(q.findtext(f".//{si}value") or "nan")
        for q in first[0].findall(f".//{dcc}quantity")
    }
    assert values["fu, in pixels"] == camera.intrinsics[0]
    assert values["projection centre Z"] == camera.centre_mm[2]
    quantity = root.findall(f".//{dcc}measurementResult")[1].findall(f".//{dcc}result//{dcc}quantity")[0]
    length = read.bars.lengths[0]
    assert float(quantity.findtext(f".//{si}value") or "nan") == pytest.approx(length.mean_error_mm)
    assert float(quantity.findtext(f".//{si}uncertainty") or "nan") == pytest.approx(length.expanded_uncertainty_mm)
    assert root.findtext(f".//{dcc}conformity") == "pass"
    assert root.findtext(f".//{dcc}customer/{dcc}name/{dcc}content") == "Works & Sons <Ltd>"
    again = dcc_bytes(read, ISSUER.read(tmp_path / "issuer.json"))
    assert again == output.read_bytes()


def recorded(rig: dict, verification: dict) -> None:
    rig["recorded_at"] = "2001-02-03T01:30:00+02:00"
    rig["cameras"][0]["serial"] = "S/N <1>"


def nothing_known(rig: dict, verification: dict) -> None:
    rig.pop("covariance", None)
    for length in verification["lengths"]:
        length.pop("expanded_uncertainty_mm")
    for pose in verification["procedure"]["poses"]:
        pose.pop("temperature_c")


def nothing_measured(rig: dict, verification: dict) -> None:
    verification.pop("procedure")
    for length in verification["lengths"]:
        length.pop("mean_error_mm")


def not_valid(rig: dict, verification: dict) -> None:
    rig["quality"] |= {"valid": False, "verdict": "not-valid"}
    acceptance = verification["procedure"]["acceptance"]
    acceptance |= {"verdict": "cannot tell", "doubts": []}


def failed(rig: dict, verification: dict) -> None:
    """With care, of many bars, and used all the same by people whose names are hard on XML."""
    rig["quality"] |= {"verdict": "use-with-care", "affected": [{"scale": True}, {"camera": "C01"}]}
    said = {"by": "<Jörg> & 中 ]]>", "reason": 'e\u0301 "x"', "at": "2026-11-27T10:00:00+00:00"}
    verification |= {"override": said, "lengths": 60 * verification["lengths"]}
    verification["decision"]["verdict"] = "inconsistent"
    verification["procedure"]["acceptance"]["verdict"] = "fail"
    for length, k in zip(verification["lengths"], (0.9, 1, 2.0000001, 12.706, 1e6, 1e20), strict=False):
        length |= {"coverage_factor": k, "mean_error_mm": -1e-12 / k, "expanded_uncertainty_mm": 1e-30 * k}


CHANGES = [recorded, nothing_known, nothing_measured, not_valid, failed]


def changed(result: Path, folder: Path, change: Callable[[dict, dict], None] | None) -> bytes:
    """The certificate of the result after a change of its files; None: without a verification."""
    copy = folder / "changed"
    shutil.copytree(result, copy)
    if change is None:
        (copy / "verification.json").unlink()
        (copy / "bars.csv").unlink()
    else:
        rig, verification = (json.loads((copy / name).read_bytes()) for name in ("rig.json", "verification.json"))
        change(rig, verification)
        (copy / "rig.json").write_text(json.dumps(rig))
        (copy / "verification.json").write_text(json.dumps(verification))
    issuer = {key: value for key, value in STATED.items() if key not in ("begin", "end", "place")}
    return dcc_bytes(read_result(copy), ISSUER.read(written(folder, issuer)))


@pytest.mark.parametrize("change", [None, *CHANGES])
def test_the_content_model_holds_whatever_is_unknown(result: Path, tmp_path: Path, change) -> None:
    root = Xml.fromstring(changed(result, tmp_path, change))
    check_model(root)
    said = [e.text for e in root.iter("{https://ptb.de/dcc}content")]
    assert (root.findtext(".//{https://ptb.de/dcc}beginPerformanceDate") == "2001-02-02") == (change is recorded)
    assert ("S/N <1>" in [e.text for e in root.iter("{https://ptb.de/dcc}value")]) == (change is recorded)
    assert said.count("Not recorded.") == (2 if change in (nothing_known, nothing_measured) else 1)
    assert ("No length was measured." in said) == (change is nothing_measured)


@pytest.mark.parametrize("change", [None, *CHANGES])
def test_the_certificate_is_valid(result: Path, tmp_path: Path, change) -> None:
    """By PTB's own schema, where its files are at hand: SPHERECAL_DCC_XSD names dcc.xsd."""
    import os

    schema = os.environ.get("SPHERECAL_DCC_XSD")
    if not schema:
        pytest.skip("the schema is not here (set SPHERECAL_DCC_XSD to dcc.xsd 3.2.1)")
    xmlschema = pytest.importorskip("xmlschema")
    xmlschema.XMLSchema11(schema).validate(changed(result, tmp_path, change).decode())


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"customer": None}, 'lacks "customer"'), ({"person": "  "}, "is empty"),
        ({"laboratory": {"name": "x", "city": "y", "country": "Germany"}}, "two capital letters"),
        ({"begin": "21.11.2026"}, "must be a date"), ({"place": "moon"}, "must be"),
    ],
)  # fmt: skip
def test_an_issuer_that_cannot_be_used_is_named(tmp_path: Path, changes: dict, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        ISSUER.read(written(tmp_path, {**STATED, **changes}))


def test_a_certificate_needs_its_issuer_and_a_scale(result: Path, tmp_path: Path, capsys) -> None:
    assert main(["report", str(result), "-o", str(tmp_path / "c.xml")]) == 2
    assert "--issuer" in capsys.readouterr().err
    late = {**STATED, "begin": "2026-12-01"}
    with pytest.raises(InputError, match="before it begins"):
        dcc_bytes(read_result(result), ISSUER.read(written(tmp_path, late)))


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0.0"), (-0.0, "0.0"), (1e-7, "0.0000001"), (2331.25, "2331.25"), (-1e9, "-1000000000.0")]
)
def test_numbers_are_plain_decimals(value: float, text: str) -> None:
    assert decimal(value) == text
    assert float(decimal(np.pi * 1e-5)) == np.pi * 1e-5


def test_texts_hold_nothing_xml_forbids() -> None:
    assert clean(" a\x00b\x0b \ud800c ") == "a b c"
    assert clean("\x01") == "-"
