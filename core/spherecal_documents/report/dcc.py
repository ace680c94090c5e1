"""A Digital Calibration Certificate (PTB's DCC 3.2.1 with quantities in D-SI 2.1.0) of a result.

Whoever issues it states in a small JSON file what no measurement gives: laboratory, customer, person, dates.
Source: the published schema of DCC 3.2.1 (ptb.de/dcc).
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, date, datetime
from typing import Literal, get_args
from xml.etree import ElementTree as Xml

import numpy as np

from spherecal import __version__
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import RigCamera
from spherecal.geometry.camera import INTRINSIC_NAMES, is_fisheye, lens_names
from spherecal_documents.report.verdicts import calibration_verdict, verification_verdict
from spherecal_files.codec import FileFormat, Kind, choice, field, optional, record, text
from spherecal_files.codec import date as day
from spherecal_files.json_file import JsonValue
from spherecal_files.verification_file import ArtefactRow
from spherecal_rigs.result_folder import Result, refuse_failed
from spherecal_verify.limit import RULE

DCC, SI, XSI = "https://ptb.de/dcc", "https://ptb.de/si", "http://www.w3.org/2001/XMLSchema-instance"
SCHEMA = "3.2.1"
_COVERAGE, _NORMAL_BELOW = 0.9545, 2.001  # k of 2500 degrees of freedom; the normal distribution's is 2.000002
_CONFORMITY = {"pass": "pass", "fail": "fail", "cannot tell": "noPass"}

Place = Literal["laboratory", "customer", "laboratoryBranch", "customerBranch", "other"]


@dataclass(frozen=True)
class Contact:
    """A name and where it is: city and country (two letters), e-mail where known."""

    name: str
    city: str
    country: str
    email: str = ""


@dataclass(frozen=True)
class Issuer:
    """Who issues the certificate, to whom, and when and where it was measured."""

    laboratory: Contact
    customer: Contact
    person: str
    rig_serial: str
    manufacturer: str = "not stated"
    number: str = ""
    place: Place = "laboratory"
    begin: date | None = None
    end: date | None = None


def _check_country(country: str, value: JsonValue) -> None:
    if len(country) != 2 or not (country.isascii() and country.isalpha() and country.isupper()):
        raise value.error(Phrase("problem-country"))


def _check_not_empty(said: str, value: JsonValue) -> None:
    if not said:
        raise value.error(Phrase("problem-name-empty"))


def _said(about: str) -> Kind[str]:
    return text(about).mapped(lambda said: " ".join(said.split())).checked(_check_not_empty)


def _stated_contact(about: str) -> Kind[Contact]:
    return record(
        about,
        Contact,
        field("name", _said("Its name.")),
        field("city", _said("Where it is.")),
        field("country", text("Two capital letters.").checked(_check_country, pattern="^[A-Z]{2}$")),
        optional("email", _said("Its e-mail address.")),
    )


ISSUER = FileFormat(
    "spherecal/issuer",
    "issuer.json",
    "Laboratory, customer, person and dates of a certificate, for `spherecal report --issuer`.",
    record(
        "",
        Issuer,
        field("laboratory", _stated_contact("Who issues the certificate.")),
        field("customer", _stated_contact("For whom.")),
        field("person", _said("Who is responsible.")),
        field("rig_serial", _said("Serial number of the rig.")),
        optional("manufacturer", _said("Who made the rig.")),
        optional("number", _said("Number of the certificate.")),
        optional("place", choice("Where it was measured; `laboratory` where absent.", get_args(Place))),
        optional("begin", day("First day of the measurement.")),
        optional("end", day("Last day.")),
    ),
    ("No text is empty.",),
    more="verification.md#reports",
)


def dcc_bytes(result: Result, issuer: Issuer) -> bytes:
    """The certificate as XML, by the published schema of DCC 3.2.1; the same result and issuer give the same bytes."""
    if not result.rig.cameras or not result.has_scale:
        raise InputError(Phrase("error-certificate-needs", {"folder": result.folder}))
    refuse_failed(result.folder)
    for prefix, name in (("dcc", DCC), ("si", SI), ("xsi", XSI)):
        Xml.register_namespace(prefix, name)
    where = f"{DCC} https://ptb.de/dcc/v{SCHEMA}/dcc.xsd"
    root = Xml.Element(
        _q("digitalCalibrationCertificate"), {"schemaVersion": SCHEMA, f"{{{XSI}}}schemaLocation": where}
    )
    _administrative(root, result, issuer)
    results = _add(root, "measurementResults")
    _calibration(results, result)
    if result.bars is not None and result.bars.lengths:
        _verification(results, result)
    Xml.indent(root, " ")
    return Xml.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _q(name: str) -> str:
    return f"{{{DCC}}}{name}"


def _add(parent: Xml.Element, name: str, text: str | None = None, **attributes: str) -> Xml.Element:
    child = Xml.SubElement(parent, _q(name), attributes)
    if text is not None:
        child.text = clean(text)
    return child


def clean(text: str) -> str:
    """Text without what XML 1.0 forbids, with single spaces; "-" where nothing is left."""
    kept = "".join(c if c >= " " and not 0xD800 <= ord(c) <= 0xDFFF and c not in "\ufffe\uffff" else " " for c in text)
    return " ".join(kept.split()) or "-"


def _name(parent: Xml.Element, text: str, name: str = "name") -> None:
    _add(_add(parent, name), "content", text, lang="en")


def _administrative(root: Xml.Element, result: Result, issuer: Issuer) -> None:
    data = _add(root, "administrativeData")
    _software(_add(data, "dccSoftware"), "SphereCal", __version__)
    core = _add(data, "coreData")
    begin, end = _dates(result, issuer)
    for key, said in (
        ("countryCodeISO3166_1", issuer.laboratory.country),
        ("usedLangCodeISO639_1", "en"),
        ("mandatoryLangCodeISO639_1", "en"),
        ("uniqueIdentifier", issuer.number or fingerprint(result)),
        ("beginPerformanceDate", begin.isoformat()),
        ("endPerformanceDate", end.isoformat()),
        ("performanceLocation", issuer.place),
    ):
        _add(core, key, said)
    items = _add(data, "items")
    item = _add(items, "item")
    _name(item, f"Multi-camera measuring rig with {len(result.rig.cameras)} cameras")
    _contact(_add(item, "manufacturer"), Contact(issuer.manufacturer, "", ""))
    _identified(item, [("customer", issuer.rig_serial, "serial number of the rig")])
    for camera in result.rig.cameras:
        one = _add(items, "item")
        _name(one, f"Camera {camera.id}")
        _contact(_add(one, "manufacturer"), Contact("not stated", "", ""))
        name = ("customer", camera.id, "name in the rig")
        _identified(one, [("manufacturer", camera.serial, "serial number") if camera.serial else name])
    laboratory = _add(data, "calibrationLaboratory")
    _contact(_add(laboratory, "contact"), issuer.laboratory)
    person = _add(_add(data, "respPersons"), "respPerson")
    _contact(_add(person, "person"), Contact(issuer.person, "", ""))
    _add(person, "mainSigner", "true")
    _contact(_add(data, "customer"), issuer.customer)


def _dates(result: Result, issuer: Issuer) -> tuple[date, date]:
    at = result.rig.recorded_at or datetime.fromtimestamp((result.folder / "rig.json").stat().st_mtime, UTC)
    end = issuer.end or issuer.begin or at.astimezone(UTC).date()
    begin = issuer.begin or end
    if end < begin:
        raise InputError(Phrase("error-measurement-dates", {"end": end.isoformat(), "begin": begin.isoformat()}))
    return begin, end


def fingerprint(result: Result) -> str:
    """A number for a certificate that was given none: from the files that it certifies."""
    table = hashlib.sha256()
    for name in ("rig.json", "verification.json"):
        path = result.folder / name
        table.update(path.read_bytes() if path.is_file() else b"")
    return f"spherecal-{table.hexdigest()[:32]}"


def _software(parent: Xml.Element, name: str, release: str) -> None:
    software = _add(parent, "software")
    _name(software, name)
    # PTB's schematron asks for a letter before the figures.
    _add(software, "release", f"v{release}" if release[:1].isdigit() else release or "unknown")


def _contact(parent: Xml.Element, contact: Contact) -> None:
    _name(parent, contact.name)
    if contact.email:
        _add(parent, "eMail", contact.email)
    if contact.city:
        location = _add(parent, "location")
        _add(location, "city", contact.city)
        _add(location, "countryCode", contact.country)


def _identified(parent: Xml.Element, entries: list[tuple[str, str, str]]) -> None:
    listed = _add(parent, "identifications")
    for issuer, value, name in entries:
        one = _add(listed, "identification")
        _add(one, "issuer", issuer)
        _add(one, "value", value)
        _name(one, name)


def _rich(parent: Xml.Element, name: str, *sentences: str) -> None:
    """Sentences as one content: several are translations of each other, of which a reader shows one."""
    _name(parent, " ".join(sentences), name)


def _measurement(
    results: Xml.Element, title: str, description: str, method: str, norm: str, result: Result
) -> Xml.Element:
    found = _add(results, "measurementResult")
    _name(found, title)
    _rich(found, "description", description)
    used = _add(_add(found, "usedMethods"), "usedMethod")
    _name(used, method)
    if norm:
        _add(used, "norm", norm)
    _software(_add(found, "usedSoftware"), result.software.name, result.software.version)
    return found


def _calibration(results: Xml.Element, result: Result) -> None:
    verdict = calibration_verdict(result)
    method = dict(result.software.details).get("method", "auto")
    found = _measurement(
        results, "Calibration of the cameras", f"{verdict.word}: {verdict.sentence}",
        f"Bundle adjustment of a ball's coded targets, method {method}", "", result,
    )  # fmt: skip
    _conditions(found, "Temperature of the rig", [])
    listed = _add(found, "results")
    for camera in result.rig.cameras:
        _camera(listed, camera, result.rig.reference_camera)


def _camera(listed: Xml.Element, camera: RigCamera, reference: str | None) -> None:
    one = _add(listed, "result")
    _name(one, f"Camera {camera.id}")
    _rich(
        one,
        "description",
        f"OpenCV's {'fisheye ' if is_fisheye(camera.intrinsics) else ''}camera model, "
        "pixel (0, 0) is the centre of the top left one. "
        f"World: the frame of camera {reference}. x_camera = R x_world + t. {camera.observations} observations.",
    )
    data = _add(one, "data")
    sigma = camera.sigma
    for i, name in enumerate(lens_names(camera.intrinsics)):
        sd = None if sigma is None else float(sigma.intrinsics[i])
        _quantity(data, name, float(camera.intrinsics[i]), r"\one", sd)
    for axis, value, i in zip("XYZ", camera.centre_mm.tolist(), range(3), strict=True):
        _quantity(
            data,
            f"projection centre {axis}",
            value,
            r"\milli\metre",
            None if sigma is None else float(sigma.centre_mm[i]),
        )
    rows = [(f"R{r + 1}{c + 1}", float(camera.rotation[r, c])) for r in range(3) for c in range(3)]
    for name, value in rows:
        _quantity(data, name, value, r"\one", None)
    if sigma is not None:
        for axis, value in zip("xyz", sigma.rotation_deg.tolist(), strict=True):
            _quantity(data, f"standard uncertainty of the rotation about {axis}", value, r"\degree", None)
    if camera.rms_px is not None:
        _quantity(data, "root mean square of the residuals, in pixels", camera.rms_px, r"\one", None)


def _quantity(data: Xml.Element, name: str, value: float, unit: str, sd: float | None, k: float = 2.0) -> None:
    """A quantity with its expanded uncertainty, where that is known and not zero."""
    if not np.isfinite(value):
        return
    quantity = _add(data, "quantity")
    _name(quantity, f"{name}, in pixels" if unit == r"\one" and name in INTRINSIC_NAMES[:4] else name)
    real = Xml.SubElement(quantity, f"{{{SI}}}real")
    _si(real, "value", decimal(value))
    _si(real, "unit", unit)
    if sd is not None and np.isfinite(sd) and sd > 0:
        expanded = Xml.SubElement(real, f"{{{SI}}}expandedUnc")
        _si(expanded, "uncertainty", decimal(k * sd))
        _si(expanded, "coverageFactor", decimal(k))
        _si(expanded, "coverageProbability", decimal(_COVERAGE))
        _si(expanded, "distribution", "normal" if k < _NORMAL_BELOW else "Student's t")


def _si(parent: Xml.Element, name: str, text: str) -> None:
    Xml.SubElement(parent, f"{{{SI}}}{name}").text = text


def decimal(value: float) -> str:
    """A number as D-SI has it: with a decimal point and without an exponent."""
    text = np.format_float_positional(value, unique=True, trim="0")
    return "0.0" if not text.strip("-0.") else text


def _verification(results: Xml.Element, result: Result) -> None:
    bars = result.bars
    assert bars is not None
    verdict = verification_verdict(result)
    procedure = bars.procedure
    found = _measurement(
        results,
        "Verification with reference bars",
        f"{verdict.word}: {verdict.sentence}",
        procedure.title if procedure is not None else "Measurement of reference bars",
        "VDI/VDE 2634-1 (reduced)" if procedure is not None else "",
        result,
    )
    if procedure is not None:
        _equipment(found, procedure.bars)
    poses = procedure.poses if procedure is not None else ()
    known = [pose.temperature_c for pose in poses if pose.temperature_c is not None]
    _conditions(found, "Temperature of the reference bars", known)
    one = _add(_add(found, "results"), "result")
    _name(one, "Length errors")
    _rich(
        one,
        "description",
        "Mean of the measured minus the certified length, brought to the bar's temperature.",
        *(one.text for one in (procedure.departures if procedure is not None else ())),
    )
    data = _add(one, "data")
    for x in bars.lengths:
        if x.mean_error_mm is not None:
            name = f"mean error of bar {x.bar}, {x.from_mark} to {x.to_mark}, {x.n} poses"
            k = x.coverage_factor or 0.0
            sd = x.expanded_uncertainty_mm / k if x.expanded_uncertainty_mm is not None and k >= 1 else None
            _quantity(data, name, x.mean_error_mm, r"\milli\metre", sd, k)
    if not len(data):
        _rich(data, "text", "No length was measured.")
    if procedure is not None and procedure.acceptance is not None and procedure.acceptance.verdict in _CONFORMITY:
        about = _add(_add(found, "measurementMetaData"), "metaData")
        _name(about, "Conformity with the user's limit")
        _rich(about, "description", f"{procedure.acceptance.limit.words()}: {procedure.acceptance.verdict}")
        _add(about, "norm", "ISO 14253-1:2017")
        _rich(about, "declaration", RULE)
        _add(about, "conformity", _CONFORMITY[procedure.acceptance.verdict])


def _equipment(found: Xml.Element, bars: tuple[ArtefactRow, ...]) -> None:
    if not bars:
        return
    listed = _add(found, "measuringEquipments")
    for bar in bars:
        one = _add(listed, "measuringEquipment")
        _name(one, f"Reference bar {bar.id}")
        entries = [("owner", bar.serial or bar.id, "serial number")]
        if bar.certificate:
            entries.append(
                ("calibrationLaboratory", bar.certificate, f"certificate {bar.laboratory} {bar.issued}".strip())
            )
        _identified(one, entries)


def _conditions(found: Xml.Element, title: str, temperatures: list[float]) -> None:
    condition = _add(_add(found, "influenceConditions"), "influenceCondition")
    _name(condition, title)
    data = _add(condition, "data")
    if not temperatures:
        _rich(data, "text", "Not recorded.")
        return
    ends: tuple[tuple[str, Callable[[list[float]], float]], ...] = (("lowest", min), ("highest", max))
    for name, pick in ends:
        _quantity(data, f"{name} temperature", pick(temperatures), r"\degreecelsius", None)
