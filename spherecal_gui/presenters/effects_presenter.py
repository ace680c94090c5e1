"""What lenses and mounts do that no model has, in one sentence each."""

from typing import TYPE_CHECKING

from spherecal_gui.languages import translate

if TYPE_CHECKING:
    from spherecal_gui.tasks.camera_effects import CameraEffect


def field_text(effects: "tuple[CameraEffect, ...]") -> str:
    """What the maps show."""
    worst = max(effects, key=lambda one: one.field_rms_px)
    if worst.field_px is None:
        return translate("Effects", "Every lens does what its model says.")
    text = translate("Effects", "The lens of {camera} is farthest from its model: {px:.3f} px. It is corrected.")
    return text.format(camera=worst.camera, px=worst.field_rms_px)


def drift_text(effects: "tuple[CameraEffect, ...]") -> str:
    """What the lines show."""
    moving = [one for one in effects if len(one.drift_px) and one.drift_px.any()]
    if not moving:
        return translate("Effects", "No camera turned over the placements.")
    worst = max(moving, key=lambda one: float(one.drift_px.max()))
    text = translate("Effects", "{camera} turned most over the placements: {px:.2f} px. Look at its mount and cable.")
    return text.format(camera=worst.camera, px=float(worst.drift_px.max()))
