"""Which numbers of the cameras' lenses a table shows, and what they are called there."""

from collections.abc import Sequence

from spherecal.data.rig import RigCamera
from spherecal.geometry.camera import FISHEYE_NAMES, INTRINSIC_NAMES, is_fisheye
from spherecal_documents.report.language import label


def lens_columns(cameras: Sequence[RigCamera]) -> dict[int, str]:
    """Places (of the 16) and names of the distortion numbers that any camera uses; both names where models differ."""
    wide = [bool(is_fisheye(camera.intrinsics)) for camera in cameras]
    names: dict[int, str] = {}
    for i in range(4, len(INTRINSIC_NAMES)):
        if not any(lens_number(camera, i) != 0 for camera in cameras):
            continue
        own = [INTRINSIC_NAMES[i]] if not all(wide) else []
        other = [FISHEYE_NAMES[i]] if any(wide) and i < len(FISHEYE_NAMES) else []
        names[i] = " / ".join(dict.fromkeys(own + other))
    return names


def lens_number(camera: RigCamera, i: int) -> float:
    """The number in place `i` of the 16; 0 in places that a fisheye lens does not have."""
    if i >= len(FISHEYE_NAMES) and is_fisheye(camera.intrinsics):
        return 0.0
    return float(camera.intrinsics[i])


def lens_model_words(cameras: Sequence[RigCamera]) -> str:
    """The model or models that the numbers belong to."""
    wide = [camera.id for camera in cameras if is_fisheye(camera.intrinsics)]
    if not wide:
        return label("report-opencv")
    if len(wide) == len(cameras):
        return label("report-opencv-fisheye")
    return label("report-opencv-both", cameras=tuple(wide))
