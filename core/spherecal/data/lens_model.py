"""Which lens model each camera of a session is calibrated with, and priors brought into it."""

from dataclasses import replace

import numpy as np

from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.session import CameraSpec, Session
from spherecal.geometry.camera import LensModel, estimated_mask, is_fisheye, lens_model
from spherecal.geometry.lens_fit import fit_lens, image_field


def with_lens_model(session: Session, model: LensModel) -> Session:
    """The session with all cameras of one lens model; priors of another are fitted to it over the image."""
    return replace(session, cameras=tuple(_with_model(camera, model) for camera in session.cameras))


def like(camera: CameraSpec, intrinsics: FloatArray) -> CameraSpec:
    """The camera with the lens model of a calibrated lens (16,), where one of the two alone is fisheye."""
    if bool(is_fisheye(intrinsics)) == bool(is_fisheye(camera.prior)):
        return camera
    return _with_model(camera, lens_model(intrinsics))


def _with_model(camera: CameraSpec, model: LensModel) -> CameraSpec:
    return replace(camera, lens_model=model, prior=prior_in_model(camera.id, camera.prior, camera.image_size, model))


def prior_in_model(camera: str, prior: FloatArray, image_size: tuple[int, int], model: LensModel) -> FloatArray:
    """A prior (16,) as the nearest lens of a model over an image of (width, height) px."""
    found = fit_lens(prior, image_field(image_size), model)
    if found is None:
        raise InputError(Phrase("error-prior-folds", {"camera": camera, "model": model}))
    return found.intrinsics


def estimated_intrinsics(session: Session, free: bool) -> BoolArray:
    """Which intrinsics (c, 16) of each camera are estimated, by its lens model (docs/conventions.md, decision 0001)."""
    masks = [estimated_mask(camera.lens_model) for camera in session.cameras]
    return np.array(masks).reshape(-1, 16) & free
