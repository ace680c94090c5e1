"""One calibration in a profile: entry.json with what was known when it was saved, and hashes of the files beside it."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.rig import Rig, Verdict
from spherecal_files import codec
from spherecal_files.codec import serial
from spherecal_files.filesystem import read_below
from spherecal_files.rig_file import read_rig
from spherecal_files.verification_file import OVERRIDE, Override

ENTRY_FILE = "entry.json"
RIG_FILE = "rig.json"
# What an entry may hold beside entry.json; no name out of a file is ever opened.
FILES = (RIG_FILE, "targets.json", "verification.json", "bars.csv", "covariance.npy", "points.csv")
# rig.json of 100 cameras has 0.2 MB, targets.json of 1000 targets 0.5 MB.
_MOST_BYTES = 64 << 20
_MOST_CAMERAS, _MOST_SETTINGS, _MOST_NUMBERS = 1000, 1000, 100

Setting = str | float | bool | list[float]


@dataclass(frozen=True)
class CameraEntry:
    """What is known of a camera: serial, model, optics, temperature and its settings (exposure, gain, ...) by name."""

    id: str
    serial: str | None = None
    model: str | None = None
    pixel_pitch_um: float | None = None
    focal_length_mm: float | None = None
    temperature_c: float | None = None
    settings: Mapping[str, Setting] | None = None


@dataclass(frozen=True)
class Entry:
    """A saved calibration; times are in UTC, `volume_mm` the low and high corner of its points in the rig's world."""

    saved_at: datetime
    calibrated_at: datetime
    valid: bool
    rms_px: float | None
    sigma0: float | None
    input_sha256: str
    files: Mapping[str, str]
    cameras: tuple[CameraEntry, ...] = ()
    note: str = ""
    temperature_c: float | None = None
    sphere_diameter_mm: float | None = None
    scale_source: str = "none"
    scale_artefact: str | None = None
    scale_relative_uncertainty: float | None = None
    volume_mm: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    verdict: str | None = None  # of the bars
    bar_mean_error_mm: float | None = None
    bar_max_error_mm: float | None = None
    written_by: str = ""
    care: str = ""  # what it is to be used with care for, in words; empty where nothing is
    failed: bool = False  # the bars show the rig to be wrong
    override: Override | None = None  # who uses it all the same

    @property
    def calibration_verdict(self) -> Verdict:
        """One of the three words on the calibration."""
        return "not-valid" if not self.valid else "use-with-care" if self.care else "valid"

    @property
    def contradicted(self) -> bool:
        """Whether its verification failed; entries of older versions say it by the verdict alone."""
        return self.failed or self.verdict == "inconsistent"


_SETTING = codec.one_of(
    "",
    codec.boolean(""),
    codec.text(""),
    codec.items("", codec.number("")).mapped(lambda found: list(found[:_MOST_NUMBERS])),
    codec.number(""),
)
SETTINGS = codec.entries("Its settings by name.", _SETTING).that(
    lambda settings: len(settings) <= _MOST_SETTINGS,
    Phrase("problem-many-settings", {"most": _MOST_SETTINGS}),
    maxProperties=_MOST_SETTINGS,
)
"""A camera's settings by name: numbers, texts, true or false, or a few numbers (a region)."""
_CAMERA = codec.record(
    "",
    CameraEntry,
    codec.field("id", codec.identifier("Its id.")),
    codec.optional("serial", serial("Its serial number.")),
    codec.optional("model", codec.text("The model name that its maker uses.")),
    codec.optional("pixel_pitch_um", codec.positive("Pixel pitch of its sensor.", "um")),
    codec.optional("focal_length_mm", codec.positive("Focal length of its lens.", "mm")),
    codec.optional("temperature_c", codec.celsius("Its temperature in degrees Celsius.")),
    codec.optional("settings", SETTINGS),
)
_QUALITY = codec.group(
    "quality",
    "As in rig.json.",
    codec.field("valid", codec.boolean("As in rig.json.")),
    codec.unread("verdict", "As in rig.json.", "calibration_verdict"),
    codec.optional("care", codec.prose("What requires care; empty where nothing does.")),
    codec.optional("rms_px", codec.number("As in rig.json.", 0)),
    codec.optional("sigma0", codec.number("As in rig.json.", 0)),
)
_SCALE = codec.group(
    "scale",
    "Where the scale comes from.",
    codec.field("source", codec.text("As in rig.json."), "scale_source"),
    codec.optional("artefact", codec.text("The bar or board."), "scale_artefact"),
    codec.optional(
        "relative_uncertainty", codec.number("Relative standard uncertainty.", 0), "scale_relative_uncertainty"
    ),
)
_VERIFICATION = codec.group(
    "verification",
    "The result of the verification with bars.",
    codec.field("verdict", codec.text("The verdict.")),
    codec.optional("mean_error_mm", codec.number("Mean error."), "bar_mean_error_mm"),
    codec.optional("max_abs_error_mm", codec.number("Largest error, without its sign.", 0), "bar_max_error_mm"),
    codec.optional("failed", codec.boolean("Whether it shows the rig to be wrong."), omit=False),
    codec.optional("override", OVERRIDE, omit=None),
    is_needed=False,
)
_FILES = codec.record(
    "SHA-256 of the files beside it.",
    dict,
    codec.field(RIG_FILE, codec.text("The rig.")),
    *(codec.optional(file, codec.text(f"{file}.")) for file in FILES if file != RIG_FILE),
)
_SOFTWARE = codec.group(
    "software",
    "The program that wrote it.",
    codec.optional("version", codec.text("Its version."), "written_by"),
    codec.unread("name", "Its name.", lambda _: "SphereCal"),
    is_needed=False,
)
ENTRY = codec.FileFormat(
    "spherecal/profile-entry",
    ENTRY_FILE,
    "A calibration in a profile, and the files beside it.",
    codec.record(
        "",
        Entry,
        codec.field("saved_at", codec.time("When it was saved.")),
        codec.field("calibrated_at", codec.time("When it was calibrated.")),
        codec.optional("note", codec.text("A note.")),
        _QUALITY,
        _SCALE,
        codec.optional("sphere_diameter_mm", codec.positive("Diameter of the ball.", "mm")),
        codec.optional("temperature_c", codec.celsius("The rig's temperature in degrees Celsius.")),
        codec.optional(
            "volume_mm",
            codec.matrix("Low and high corner of the calibrated points.", 2, 3).that(
                lambda corners: all(a <= b for a, b in zip(*corners, strict=True)), Phrase("problem-low-corner")
            ),
        ),
        _VERIFICATION,
        codec.field(
            "cameras",
            codec.items(
                "The cameras.",
                _CAMERA,
                most=_MOST_CAMERAS,
                excess=Phrase("problem-many-entries", {"most": _MOST_CAMERAS}),
            ),
        ),
        codec.field("input_sha256", codec.digest("`input_sha256` of the rig.")),
        codec.field("files_sha256", replace(_FILES, entry=dict), "files"),
        _SOFTWARE,
    ),
    ("`volume_mm` has the low corner first.",),
    more="profiles.md",
)


def read_entry(folder: Path) -> Entry:
    """The entry in a folder of a profile's history."""
    return ENTRY.read(folder / ENTRY_FILE, below=folder)


def sha256(path: Path) -> str:
    """The SHA-256 of a file."""
    return hashlib.sha256(read_below(path.parent, path.name, _MOST_BYTES)).hexdigest()


def checked_rig(folder: Path, entry: Entry) -> Rig:
    """The rig of an entry."""
    path = folder / RIG_FILE
    if sha256(path) != entry.files[RIG_FILE]:
        raise InputError(Phrase("error-changed-since", {"file": path}))
    return read_rig(path)
