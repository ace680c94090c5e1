"""The cameras of a new recording: names, lenses and sensors by model."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from spherecal.base.messages.values import Phrase
from spherecal_cameras.camera_settings import CameraProfile
from spherecal_cameras.capture import SessionCamera, session_ids
from spherecal_cameras.makers import TABLE
from spherecal_cameras.plan import CapturePlan, camera_spec_json, recorded_camera_json
from spherecal_cameras.protocol import CameraError, CameraInfo, CameraSource, Discovery, SetupReport, session_behind


def pitch_of_model(model: str) -> float | None:
    """The pixel pitch in um of a camera model; None for one that is not in the table."""
    return next((pitch for pitch, begins in TABLE["pitches"] if re.match(begins, model.strip(), re.IGNORECASE)), None)


Document = dict[str, object]


@dataclass(frozen=True)
class RigCameras:
    """The cameras of the rig that send images, and why the others do not, by serial; `names` of all that were found."""

    cameras: tuple[SessionCamera, ...]
    names: Mapping[str, str]
    problems: Mapping[str, CameraError] = field(default_factory=dict)

    def or_raise(self) -> "RigCameras":
        """Itself; CameraError, one for all, where no camera can be used."""
        if self.cameras:
            return self
        problems = list(self.problems.values())
        if not problems:
            raise CameraError(Phrase("error-no-camera-found"))
        said = Phrase("sentences", {"texts": [error.parts[0] for error in problems]})
        raise CameraError(said, *problems[0].parts[1:2])


def camera_name(profile: CameraProfile, info: CameraInfo) -> str:
    """The name of a camera for people: the user's, else the camera's own, else its serial number."""
    return profile.entry(info.serial).name or info.user_name or info.serial


def session_cameras(
    source: CameraSource,
    plan: CapturePlan,
    discovery: Discovery,
    reports: tuple[SetupReport, ...],
    profile: CameraProfile,
    kept: Mapping[str, Document] | None = None,
) -> RigCameras:
    """The cameras of the rig, each as described in the plan or the recording, else in the profile."""
    by_serial = {report.serial: report for report in reports}
    names = session_ids({info.serial: camera_name(profile, info) for info in discovery.cameras})
    cameras, problems = list[SessionCamera](), dict[str, CameraError]()
    for info in discovery.cameras:
        if not profile.entry(info.serial).in_rig:
            continue
        name, report = names[info.serial], by_serial.get(info.serial, SetupReport(info.serial))
        try:
            document = _document(source, plan, profile, info, name, report)
            size = report.image_size or info.image_size
            prior = document["image_size"]
            assert isinstance(prior, list | tuple)
            if size is not None and list(prior) != list(size):
                sides = {"width": size[0], "height": size[1], "prior_width": prior[0], "prior_height": prior[1]}
                raise CameraError(Phrase("error-prior-size", {"camera": name, **sides}))
        except CameraError as error:
            problems[info.serial] = error
        else:
            cameras.append(SessionCamera(info.serial, document))
    there = {camera.serial for camera in cameras}
    absent = (SessionCamera(serial, dict(entry)) for serial, entry in (kept or {}).items() if serial not in there)
    return RigCameras((*cameras, *absent), names, problems)


def _document(
    source: CameraSource, plan: CapturePlan, profile: CameraProfile, info: CameraInfo, name: str, report: SetupReport
) -> Document:
    planned, recorded = plan.camera(info.serial, name), session_behind(source)
    size = report.image_size or info.image_size
    spec = None if recorded is None else next((c for c in recorded.cameras if c.id == info.user_name), None)
    if size is None and recorded is None:
        status = source.statuses().get(info.serial)
        if status is None or not status.cause:
            raise CameraError(Phrase("error-camera-not-usable", {"camera": name}))
        raise CameraError(Phrase("error-camera-unusable", {"camera": name, "cause": status.cause}), status.remedy)
    if planned is not None:
        return {**planned, "serial": info.serial}
    if spec is not None and recorded is not None:
        return recorded_camera_json(spec, recorded, info.serial)
    assert size is not None
    kept = profile.entry(info.serial)
    pitch = kept.pixel_pitch_um or pixel_pitch_um(info, report)
    return camera_spec_json(name, info.serial, info.model, size, pitch, kept.focal_length_mm)


def pixel_pitch_um(info: CameraInfo, report: SetupReport | None) -> float | None:
    """The pixel pitch as the camera says, else as its model's data sheet; None where neither is known."""
    said = next((one.got for one in (report.features if report else ()) if one.feature == "pixel pitch"), "")
    return float(said) if said else pitch_of_model(info.model)
