"""The cameras of a new recording, as session.json describes them."""

from spherecal.base.messages.values import Phrase
from spherecal_cameras.capture import SessionCamera, session_ids
from spherecal_cameras.plan import CapturePlan, camera_spec_json, recorded_camera_json
from spherecal_cameras.profile import CameraProfile
from spherecal_cameras.protocol import CameraError, CameraInfo, CameraSource, Discovery, SetupReport, session_behind

Document = dict[str, object]


def camera_name(profile: CameraProfile, info: CameraInfo) -> str:
    """The name of a camera for people: the user's, else the camera's own, else its serial number."""
    return profile.entry(info.serial).name or info.user_name or info.serial


def session_cameras(
    source: CameraSource,
    plan: CapturePlan,
    discovery: Discovery,
    reports: tuple[SetupReport, ...],
    profile: CameraProfile,
) -> tuple[SessionCamera, ...]:
    """Every camera that was found, as described in the plan or the recording, else in the profile."""
    sizes = {report.serial: report.image_size for report in reports}
    names = session_ids({info.serial: camera_name(profile, info) for info in discovery.cameras})
    cameras, problems = list[SessionCamera](), list[CameraError]()
    for info in discovery.cameras:
        name, size = names[info.serial], sizes.get(info.serial) or info.image_size
        try:
            document = _document(source, plan, profile, info, name, size)
            _check_size(name, size, document)
        except CameraError as error:
            problems.append(error)
        else:
            cameras.append(SessionCamera(info.serial, document))
    if problems:
        raise CameraError(Phrase("sentences", {"texts": [error.parts[0] for error in problems]}), problems[0].parts[1])
    return tuple(cameras)


def _document(
    source: CameraSource,
    plan: CapturePlan,
    profile: CameraProfile,
    info: CameraInfo,
    name: str,
    size: tuple[int, int] | None,
) -> Document:
    planned, recorded = plan.camera(info.serial, name), session_behind(source)
    if planned is not None:
        return {**planned, "serial": info.serial}
    spec = None if recorded is None else next((c for c in recorded.cameras if c.id == info.user_name), None)
    if spec is not None and recorded is not None:
        return recorded_camera_json(spec, recorded, info.serial)
    if size is None:
        status = source.statuses().get(info.serial)
        if status is None or not status.cause:
            raise CameraError(Phrase("error-camera-not-usable", {"camera": name}))
        raise CameraError(Phrase("error-camera-unusable", {"camera": name, "cause": status.cause}), status.remedy)
    kept = profile.entry(info.serial)
    return camera_spec_json(name, info.serial, info.model, size, kept.pixel_pitch_um, kept.focal_length_mm)


def _check_size(name: str, size: tuple[int, int] | None, document: Document) -> None:
    prior = document["image_size"]
    assert isinstance(prior, list | tuple)
    if size is not None and list(prior) != list(size):
        sides = {"width": size[0], "height": size[1], "prior_width": prior[0], "prior_height": prior[1]}
        raise CameraError(Phrase("error-prior-size", {"camera": name, **sides}))
