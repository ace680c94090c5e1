"""A Digital Calibration Certificate of a result, by the schemas of PTB's DCC 3.2.1 and D-SI 2.1.0 (ptb.de/dcc)."""

import hashlib
import re
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
from spherecal_documents.report.model import Verdict
from spherecal_documents.report.verdicts import calibration_verdict, verification_verdict
from spherecal_files.codec import FileFormat, Kind, choice, field, optional, record, text
from spherecal_files.codec import date as day
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


_COUNTRY = text("Two capital letters.").that(
    lambda said: re.fullmatch("[A-Z]{2}", said), Phrase("problem-country"), pattern="^[A-Z]{2}$"
)


def _said(about: str) -> Kind[str]:
    return text(about).mapped(lambda said: " ".join(said.split())).that(bool, Phrase("problem-name-empty"))


def _stated_contact(about: str) -> Kind[Contact]:
    return record(
        about,
        Contact,
        field("name", _said("Its name.")),
        field("city", _said("Where it is.")),
        field("country", _COUNTRY),
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
    verified = result.bars is not None and result.bars.lengths
    found = _e("measurementResults", _calibration(result), _verification(result) if verified else None)
    root = _e("digitalCalibrationCertificate", _administrative(result, issuer), found, schemaVersion=SCHEMA)
    root.set(f"{{{XSI}}}schemaLocation", f"{DCC} https://ptb.de/dcc/v{SCHEMA}/dcc.xsd")
    Xml.indent(root, " ")
    return Xml.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _e(name: str, *parts: Xml.Element | str | None, space: str = DCC, **attributes: str) -> Xml.Element:
    """An element with a text or with elements, of which None is left out."""
    made = Xml.Element(f"{{{space}}}{name}", attributes)
    for part in parts:
        if isinstance(part, str):
            made.text = clean(part)
        elif part is not None:
            made.append(part)
    return made


def clean(text: str) -> str:
    """Text without what XML 1.0 forbids, with single spaces; "-" where nothing is left."""
    kept = "".join(c if c >= " " and not 0xD800 <= ord(c) <= 0xDFFF and c not in "\ufffe\uffff" else " " for c in text)
    return " ".join(kept.split()) or "-"


def _name(text: str, name: str = "name") -> Xml.Element:
    return _e(name, _e("content", text, lang="en"))


def _administrative(result: Result, issuer: Issuer) -> Xml.Element:
    at = result.rig.recorded_at or datetime.fromtimestamp((result.folder / "rig.json").stat().st_mtime, UTC)
    end = issuer.end or issuer.begin or at.astimezone(UTC).date()
    begin = issuer.begin or end
    if end < begin:
        raise InputError(Phrase("error-measurement-dates", {"end": end.isoformat(), "begin": begin.isoformat()}))
    core = {
        "countryCodeISO3166_1": issuer.laboratory.country, "usedLangCodeISO639_1": "en",
        "mandatoryLangCodeISO639_1": "en", "uniqueIdentifier": issuer.number or fingerprint(result),
        "beginPerformanceDate": begin.isoformat(), "endPerformanceDate": end.isoformat(),
        "performanceLocation": issuer.place,
    }  # fmt: skip
    rig = f"Multi-camera measuring rig with {len(result.rig.cameras)} cameras"
    items = [_item(rig, issuer.manufacturer, ("customer", issuer.rig_serial, "serial number of the rig"))]
    for camera in result.rig.cameras:
        name = ("customer", camera.id, "name in the rig")
        known = ("manufacturer", camera.serial, "serial number") if camera.serial else name
        items.append(_item(f"Camera {camera.id}", "not stated", known))
    return _e(
        "administrativeData",
        _e("dccSoftware", _software("SphereCal", __version__)),
        _e("coreData", *(_e(key, said) for key, said in core.items())),
        _e("items", *items),
        _e("calibrationLaboratory", _contact("contact", issuer.laboratory)),
        _e("respPersons", _e("respPerson", _e("person", _name(issuer.person)), _e("mainSigner", "true"))),
        _contact("customer", issuer.customer),
    )


def _item(name: str, manufacturer: str, known: tuple[str, str, str]) -> Xml.Element:
    return _e("item", _name(name), _e("manufacturer", _name(manufacturer)), _identified(known))


def fingerprint(result: Result) -> str:
    """A number for a certificate that was given none: from the files that it certifies."""
    table = hashlib.sha256()
    for name in ("rig.json", "verification.json"):
        path = result.folder / name
        table.update(path.read_bytes() if path.is_file() else b"")
    return f"spherecal-{table.hexdigest()[:32]}"


def _software(name: str, release: str) -> Xml.Element:
    # PTB's schematron asks for a letter before the figures.
    said = f"v{release}" if release[:1].isdigit() else release or "unknown"
    return _e("software", _name(name), _e("release", said))


def _contact(name: str, contact: Contact) -> Xml.Element:
    email = _e("eMail", contact.email) if contact.email else None
    place = _e("location", _e("city", contact.city), _e("countryCode", contact.country)) if contact.city else None
    return _e(name, _name(contact.name), email, place)


def _identified(*entries: tuple[str, str, str]) -> Xml.Element:
    """Identifications: who gave each, its value, and what it is."""
    each = (
        _e("identification", _e("issuer", issuer), _e("value", value), _name(name)) for issuer, value, name in entries
    )
    return _e("identifications", *each)


def _measurement(
    title: str, verdict: Verdict, method: str, norm: str, result: Result, *parts: Xml.Element | None
) -> Xml.Element:
    used = _e("usedMethod", _name(method), _e("norm", norm) if norm else None)
    software = _software(result.software.name, result.software.version)
    words = _name(f"{verdict.word}: {verdict.sentence}", "description")
    head = (_name(title), words, _e("usedMethods", used), _e("usedSoftware", software))
    return _e("measurementResult", *head, *parts)


def _calibration(result: Result) -> Xml.Element:
    used = dict(result.software.details).get("method", "auto")
    method = f"Bundle adjustment of a ball's coded targets, method {used}"
    cameras = (_camera(camera, result.rig.reference_camera) for camera in result.rig.cameras)
    parts = _conditions("Temperature of the rig", []), _e("results", *cameras)
    return _measurement("Calibration of the cameras", calibration_verdict(result), method, "", result, *parts)


def _camera(camera: RigCamera, reference: str | None) -> Xml.Element:
    about = (
        f"OpenCV's {'fisheye ' if is_fisheye(camera.intrinsics) else ''}camera model, "
        "pixel (0, 0) is the centre of the top left one. "
        f"World: the frame of camera {reference}. x_camera = R x_world + t. {camera.observations} observations."
    )
    c, sigma, one, mm = camera, camera.sigma, r"\one", r"\milli\metre"
    lens_sd = [None] * len(c.intrinsics) if sigma is None else sigma.intrinsics.tolist()
    centre_sd = [None] * 3 if sigma is None else sigma.centre_mm.tolist()
    turns = () if sigma is None else zip("xyz", sigma.rotation_deg.tolist(), strict=True)
    centre = zip("XYZ", c.centre_mm.tolist(), centre_sd, strict=True)
    rows = [
        *((n, v, one, sd) for n, v, sd in zip(lens_names(c.intrinsics), c.intrinsics.tolist(), lens_sd, strict=False)),
        *((f"projection centre {n}", v, mm, sd) for n, v, sd in centre),
        *((f"R{row + 1}{column + 1}", float(v), one, None) for (row, column), v in np.ndenumerate(c.rotation)),
        *((f"standard uncertainty of the rotation about {n}", v, r"\degree", None) for n, v in turns),
        ("root mean square of the residuals, in pixels", c.rms_px, one, None),
    ]
    data = _e("data", *(_quantity(*row) for row in rows))
    return _e("result", _name(f"Camera {c.id}"), _name(about, "description"), data)


def _quantity(name: str, value: float | None, unit: str, sd: float | None = None, k: float = 2.0) -> Xml.Element | None:
    """A quantity with its expanded uncertainty, where that is known and not zero; None for no finite value."""
    if value is None or not np.isfinite(value):
        return None
    parts = {"value": decimal(value), "unit": unit}
    real = _si("real", *(_si(key, text) for key, text in parts.items()))
    if sd is not None and np.isfinite(sd) and sd > 0:
        parts = {
            "uncertainty": decimal(k * sd), "coverageFactor": decimal(k), "coverageProbability": decimal(_COVERAGE),
            "distribution": "normal" if k < _NORMAL_BELOW else "Student's t",
        }  # fmt: skip
        real.append(_si("expandedUnc", *(_si(key, text) for key, text in parts.items())))
    return _e(
        "quantity", _name(f"{name}, in pixels" if unit == r"\one" and name in INTRINSIC_NAMES[:4] else name), real
    )


def _si(name: str, *parts: Xml.Element | str) -> Xml.Element:
    return _e(name, *parts, space=SI)


def decimal(value: float) -> str:
    """A number as D-SI has it: with a decimal point and without an exponent."""
    text = np.format_float_positional(value, unique=True, trim="0")
    return "0.0" if not text.strip("-0.") else text


def _verification(result: Result) -> Xml.Element:
    bars = result.bars
    assert bars is not None
    procedure = bars.procedure
    known = [p.temperature_c for p in (procedure.poses if procedure else ()) if p.temperature_c is not None]
    departures = [one.text for one in (procedure.departures if procedure is not None else ())]
    about = "Mean of the measured minus the certified length, brought to the bar's temperature."
    data = _e("data")
    for x in bars.lengths:
        name = f"mean error of bar {x.bar}, {x.from_mark} to {x.to_mark}, {x.n} poses"
        k = x.coverage_factor or 0.0
        sd = x.expanded_uncertainty_mm / k if x.expanded_uncertainty_mm is not None and k >= 1 else None
        if (quantity := _quantity(name, x.mean_error_mm, r"\milli\metre", sd, k)) is not None:
            data.append(quantity)
    if not len(data):
        data.append(_name("No length was measured.", "text"))
    words = _name(" ".join((about, *departures)), "description")
    conformity = None
    if procedure is not None and procedure.acceptance is not None and procedure.acceptance.verdict in _CONFORMITY:
        conformity = _e(
            "metaData",
            _name("Conformity with the user's limit"),
            _name(f"{procedure.acceptance.limit.words()}: {procedure.acceptance.verdict}", "description"),
            _e("norm", "ISO 14253-1:2017"),
            _name(RULE, "declaration"),
            _e("conformity", _CONFORMITY[procedure.acceptance.verdict]),
        )
    return _measurement(
        "Verification with reference bars",
        verification_verdict(result),
        procedure.title if procedure is not None else "Measurement of reference bars",
        "VDI/VDE 2634-1 (reduced)" if procedure is not None else "",
        result,
        _equipment(procedure.bars if procedure is not None else ()),
        _conditions("Temperature of the reference bars", known),
        _e("results", _e("result", _name("Length errors"), words, data)),
        None if conformity is None else _e("measurementMetaData", conformity),
    )


def _equipment(bars: tuple[ArtefactRow, ...]) -> Xml.Element | None:
    if not bars:
        return None
    listed = _e("measuringEquipments")
    for bar in bars:
        entries = [("owner", bar.serial or bar.id, "serial number")]
        if bar.certificate:
            paper = f"certificate {bar.laboratory} {bar.issued}".strip()
            entries.append(("calibrationLaboratory", bar.certificate, paper))
        listed.append(_e("measuringEquipment", _name(f"Reference bar {bar.id}"), _identified(*entries)))
    return listed


def _conditions(title: str, temperatures: list[float]) -> Xml.Element:
    unit, ends = r"\degreecelsius", {"lowest": min, "highest": max}
    found = [_quantity(f"{name} temperature", pick(temperatures), unit) for name, pick in ends.items() if temperatures]
    data = _e("data", *(found or [_name("Not recorded.", "text")]))
    return _e("influenceConditions", _e("influenceCondition", _name(title), data))
