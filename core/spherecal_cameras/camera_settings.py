"""The camera profile `cameras.json`: what the user says about cameras and drivers, kept by serial number."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, replace
from dataclasses import field as default
from pathlib import Path
from typing import get_args

from spherecal_cameras.protocol import CameraSettings, Region, TriggerMode
from spherecal_files import codec
from spherecal_files.atomic import write_file_whole
from spherecal_files.codec import name, serial
from spherecal_files.json_file import JsonValue, unique


@dataclass(frozen=True)
class CameraDescription:
    """A camera's name, settings, lens and sensor as far as the user has said; `in_rig` False: it is left out."""

    serial: str
    name: str | None = None
    settings: CameraSettings = default(default_factory=CameraSettings)
    focal_length_mm: float | None = None
    pixel_pitch_um: float | None = None
    in_rig: bool = True


@dataclass(frozen=True)
class CameraProfile:
    """All that is kept: cameras by serial, and the user's own driver files or folders."""

    cameras: dict[str, CameraDescription] = default(default_factory=dict)
    producers: tuple[str, ...] = ()

    def entry(self, serial: str) -> CameraDescription:
        """What is known of a camera; defaults for one that was never set."""
        return self.cameras.get(serial, CameraDescription(serial))

    def settings(self) -> dict[str, CameraSettings]:
        """The settings by serial."""
        return {serial: entry.settings for serial, entry in self.cameras.items()}

    def rig_of(self, serials: Iterable[str]) -> list[str]:
        """Those of these cameras that nobody has left out."""
        return [serial for serial in serials if self.entry(serial).in_rig]

    def serial_of(self, name: str) -> str | None:
        """The serial number of a camera by its name, None where no camera has it."""
        return next((serial for serial, entry in self.cameras.items() if entry.name == name), None)

    def with_entry(self, entry: CameraDescription) -> "CameraProfile":
        """The profile with one camera's entry replaced or added."""
        return replace(self, cameras={**self.cameras, entry.serial: entry})


def default_profile_path() -> Path:
    """Where the profile is kept unless the user names a file."""
    from platformdirs import user_config_path

    return user_config_path("spherecal", appauthor=False) / "cameras.json"


def read_profile(path: Path) -> CameraProfile:
    """The profile in a file, an empty one where there is no such file."""
    if not path.exists():
        return CameraProfile()
    return CAMERAS.read(path)


SETTINGS = codec.record(
    "Settings that are applied when it is opened.",
    CameraSettings,
    codec.optional("exposure_us", codec.positive("Exposure time."), omit=None),
    codec.optional("gain_db", codec.number("Gain.", -20, 60, "dB"), omit=None),
    codec.optional("pixel_format", codec.text("GenICam's name of the pixel format."), omit=None),
    codec.optional(
        "region",
        codec.items("`[x, y, width, height]` in px.", codec.integer("", 0, 65536), length=4).mapped(
            lambda sides: Region(*sides), astuple
        ),
        omit=None,
    ),
    codec.optional("trigger", codec.choice("Trigger.", get_args(TriggerMode)), omit=None),
    codec.optional("trigger_source", codec.text("GenICam's name of the line."), omit=None),
    codec.optional("frame_rate_hz", codec.positive("Frame rate."), omit=None),
    codec.optional("packet_size", codec.integer("Bytes of a packet.", 0, 10**9), omit=None),
    codec.optional("packet_delay", codec.integer("Between packets, in the camera's ticks.", 0, 10**9), omit=None),
    codec.optional("frame_delay", codec.integer("Before a frame is sent, in the camera's ticks.", 0, 10**9), omit=None),
    codec.optional("throughput_bytes_s", codec.integer("Most that the camera sends, bytes/s.", 1, 10**11), omit=None),
)
_CAMERA = codec.record(
    "",
    CameraDescription,
    codec.field("serial", serial("Its serial number.")),
    codec.optional("name", name("The name that people know it by."), omit=None),
    codec.optional("focal_length_mm", codec.positive("Focal length of its lens.", "mm"), omit=None),
    codec.optional("pixel_pitch_um", codec.positive("Pixel pitch of its sensor.", "um"), omit=None),
    codec.optional("in_rig", codec.boolean("Whether it belongs to the rig; else it is never opened."), omit=True),
    codec.optional("settings", SETTINGS),
)


def _check_names(cameras: Sequence[CameraDescription], value: JsonValue) -> None:
    named = [(one, camera.name) for one, camera in zip(value.items(), cameras, strict=True) if camera.name]
    unique([one for one, _ in named], [called for _, called in named], "name")


_CAMERAS = codec.items("The cameras.", _CAMERA, differ="serial").checked(_check_names)
CAMERAS = codec.FileFormat(
    "spherecal/cameras",
    "cameras.json",
    "Settings of cameras by serial number, in the user's settings.",
    codec.record(
        "",
        CameraProfile,
        codec.optional(
            "producers", codec.items("Driver files (.cti) and folders of the user's own.", codec.text("")), omit=()
        ),
        codec.optional(
            "cameras",
            _CAMERAS.mapped(
                lambda cameras: {one.serial: one for one in cameras},
                lambda by_serial: [camera for _, camera in sorted(by_serial.items())],
            ),
        ),
    ),
    ("Serial numbers and names differ.",),
    more="cameras.md",
)


def write_profile(path: Path, profile: CameraProfile) -> None:
    """Write the profile whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file_whole(path, (json.dumps(CAMERAS.document(profile), indent=1) + "\n").encode())
