"""What to do about a finding, by its code, in the reader's language; the engine's own words are English."""

from PySide6.QtCore import QCoreApplication

from spherecal_gui import languages

translate = QCoreApplication.translate


def own_words(code: str, where: tuple[str, ...]) -> str | None:
    """What to do about a finding of this code; None in English, where the engine says it better, and for new codes."""
    text = None if languages.now() == "en" else _advice().get(code)
    return None if text is None else text.format(where=", ".join(where) or "-")


def codes_with_advice() -> frozenset[str]:
    """The codes that there is advice for."""
    return frozenset(_advice())


def _advice() -> dict[str, str]:
    return _about_cameras() | _about_placements() | _about_lengths()


def _about_cameras() -> dict[str, str]:
    return {
        "no-targets": translate(
            "Advice", "The finding names the likely cause: polarity, file, light, focus or distance."
        ),
        "rig-incomplete": translate("Advice", "Verify the rig with a bar, or calibrate it with this program."),
        "prior-assumed": translate("Advice", "State the distortion if it is known; it is estimated from 0 otherwise."),
        "no-targets-here": translate("Advice", "The finding names the likely cause: light, focus or a covered lens."),
        "empty-table": translate("Advice", "Export the observations once more, or use the images."),
        "nothing-reconstructed": translate(
            "Advice", "Put the ball where three cameras see it at once, and check that the right targets are chosen."
        ),
        "not-converged": translate("Advice", "Check the focal lengths in the bench file, and add placements."),
        "stopped-early": translate("Advice", "Calibrate again and let it come to its end."),
        "degenerate-geometry": translate(
            "Advice", "Spread the placements over the volume, in different depths, seen by three cameras or more."
        ),
        "cameras-unlinked": translate("Advice", "Put the ball where cameras of both groups see it: {where}."),
        "pose-ambiguous": translate(
            "Advice", "Show the ball nearer to these, or at more places in their image: {where}."
        ),
        "linked-by-a-thread": translate(
            "Advice", "One more placement that these see together with the others: {where}."
        ),
        "groups-of-cameras": translate("Advice", "Nothing needs to be done."),
        "behind-camera": translate(
            "Advice", "Cameras or targets may be mixed up: compare the serial numbers of {where}."
        ),
        "mirrored": translate("Advice", "Switch the mirroring off in the camera, or choose the right targets."),
        "intrinsics-held": translate("Advice", "Show the ball in more parts of the images of {where}."),
        "weak-self-calibration": translate("Advice", "Add placements in different depths; concerned: {where}."),
        "little-coverage": translate("Advice", "Put the ball where the images of {where} are still empty."),
        "outliers-removed": translate(
            "Advice",
            "Some are normal: reflections, dirt. If there are many, look at the images of {where}; mask reflections.",
        ),
        "camera-noisy": translate("Advice", "Check focus, aperture and exposure of {where}, and that nothing shakes."),
        "camera-moved": translate("Advice", "Fix the mount, then split or recalibrate: {where}."),
        "cameras-moved": translate("Advice", "Fasten the part of the frame that they hang on: {where}. Record again."),
        "ball-moved": translate(
            "Advice", "Trigger all cameras at once, let the ball come to rest, and record again: {where}."
        ),
        "cameras-swapped": translate(
            "Advice", "Compare the serial numbers; the images can be exchanged with the button: {where}."
        ),
        "lens-misfit": translate(
            "Advice",
            "Lengths suffer little with the ball turned at every placement; check them with a bar. Concerned: {where}.",
        ),
        "fixed-intrinsics-contradicted": translate(
            "Advice", "Was the lens of {where} changed or refocused? Calibrate with free lenses."
        ),
        "prior-focal-length": translate("Advice", "Correct focal length or pixel pitch of {where} in the bench file."),
        "image-contradicts": translate(
            "Advice", "Look at these images; leave them out or take the placement again: {where}."
        ),
        "target-contradicts": translate("Advice", "Look for a sticker that is loose or there twice, and take it off."),
        "swapped-back": translate("Advice", "Nothing needs to be done."),
        "left-out": translate("Advice", "Nothing needs to be done."),
        "pose-split": translate("Advice", "Fix the camera's mount before the next calibration: {where}."),
        "pose-unconfirmed": translate("Advice", "Fasten the camera, and verify with a bar that it sees: {where}."),
        "fits-badly": translate("Advice", "Use more targets, and more placements of the ball."),
        "poses-scatter": translate("Advice", "The stated uncertainties are wider by as much: {where}."),
        "images-rejected": translate("Advice", "Look at the images of {where}; take them again or leave them out."),
        "image-repeated": translate("Advice", "Take the placement again, or leave the old image out: {where}."),
        "capture-times": translate("Advice", "Take the placement again, or leave this image out: {where}."),
        "recording-contradicts": translate(
            "Advice",
            "Was something moving: the ball or the frame? Trigger all cameras at once and record again.",
        ),
        "camera-contradicts": translate("Advice", "Look at its images of the bar, then calibrate again: {where}."),
        "camera-not-verified": translate("Advice", "Lay the bar where they see it: {where}."),
        "rig-with-care": translate("Advice", "See the findings of the calibration."),
        "rig-not-valid": translate("Advice", "See the findings of the calibration, and calibrate again."),
        "camera-not-checked": translate("Advice", "Show them the ball or the bar: {where}."),
        "camera-not-in-rig": translate("Advice", "Calibrate the rig with them: {where}."),
    }


def _about_placements() -> dict[str, str]:
    return {
        "few-placements": translate("Advice", "Take four placements spread over the volume."),
        "placements-clustered": translate("Advice", "Spread the ball over the whole volume that will be measured."),
        "placements-stacked": translate("Advice", "Put the ball to the sides too, not only nearer and farther."),
        "placements-contradict": translate(
            "Advice",
            "Cameras or images may be mixed up: leave out one after the other until the rest agrees. Worst: {where}.",
        ),
        "placements-repeated": translate("Advice", "Take other placements, or leave one of them out: {where}."),
        "wrong-placement": translate(
            "Advice", "An old image was stored again: leave it out or take the placement again: {where}."
        ),
        "two-view-points": translate("Advice", "Turn or move the ball so that three cameras see more of its dots."),
        "ball-changed": translate("Advice", "Were targets replaced? Is it the same ball?"),
        "ball-not-known": translate("Advice", "Is it the ball of the calibration?"),
        "ball-size": translate("Advice", "Look at the temperatures; verify with a bar."),
        "bar-length": translate("Advice", "Verify with more poses, or calibrate anew. Poses: {where}."),
        "ball-shape-changed": translate(
            "Advice", "Check how the ball is held, loose stickers, temperature. Worst: {where}."
        ),
        "rigid-form-misfit": translate(
            "Advice",
            "Lenses that the model does not follow do that. Else fasten the cameras and let the ball come to rest.",
        ),
        "ball-profile-refused": translate("Advice", "Give the profile of the ball that was recorded, or none."),
        "ball-profile-scale": translate("Advice", "Check the bar, its temperature, and the spacing of the targets."),
        "form-rigid": translate("Advice", "Nothing needs to be done."),
        "form-free": translate("Advice", "Lengths are surer with a stiff ball, turned by 30 to 60 degrees each time."),
        "form-soft": translate(
            "Advice", "Lengths are surer with a ball that keeps its shape: how is it held, are stickers loose?"
        ),
        "board-shape": translate("Advice", "Estimate the board's points, or give measured ones."),
        "board-shape-estimated": translate("Advice", "Nothing needs to be done."),
        "board-not-found": translate("Advice", "Normal where it is out of view; else check sharpness and light."),
        "not-on-board": translate("Advice", "Check rows and columns of the board."),
        "few-frames": translate("Advice", "Wave the bar all over the volume, in all directions."),
    }


def _about_lengths() -> dict[str, str]:
    return {
        "no-scale": translate(
            "Advice", "Show the bar that gives the scale to two cameras or more, or choose a scale on the bench."
        ),
        "scale-uncertainty": translate(
            "Advice", "A scale from a certified bar is surer than one from printed targets."
        ),
        "scale-uncertainty-unknown": translate("Advice", "Calibrate again with this program."),
        "scale-conflict": translate(
            "Advice",
            "Check the bar's lengths and marks, and in which size the targets were printed: all lengths depend on it.",
        ),
        "scale-bar-left-out": translate("Advice", "Verify with a second bar."),
        "target-distance": translate("Advice", "Correct the distance on the bench, or choose the targets you printed."),
        "ball-diameter": translate(
            "Advice", "Measure the ball, then the bar and the printed targets; correct what is wrong on the bench."
        ),
        "print-scale": translate("Advice", "A printed sheet errs like that; the bar counts."),
        "length-uncertainty": translate("Advice", "Verify it with a check bar."),
        "length-doubtful": translate(
            "Advice", "Compare with the certificate, look at the marks, have the bar calibrated: {where}."
        ),
        "bars-disagree": translate("Advice", "Check both bars; measure a third one: {where}."),
        "no-check-bars": translate("Advice", "Take poses of a check bar."),
        "mark-not-found": translate("Advice", "Show the bar to more cameras: {where}."),
        "contradicting-views": translate("Advice", "Show the bar's marks to three cameras or more: {where}."),
        "outlying-views": translate("Advice", "Look at the bar's images of these cameras: {where}."),
        "bar-assumed": translate("Advice", "State what the certificate says: {where}."),
        "length-without-uncertainty": translate("Advice", "State the uncertainty of its lengths: {where}."),
        "no-temperature": translate("Advice", "Note the bar's temperature with every pose."),
        "temperatures-differ": translate(
            "Advice", "Read the thermometer again, on the bar; let the bars lie beside the rig for an hour."
        ),
        "camera-covariance-missing": translate("Advice", "Calibrate again with this program."),
        "camera-uncertainty-unknown": translate("Advice", "Calibrate again with this program."),
        "certificate-expired": translate("Advice", "Have the bar calibrated again: {where}."),
        "certificate-expires-soon": translate("Advice", "Have the bar calibrated again soon: {where}."),
        "certificate-not-yet": translate("Advice", "Check the dates of the certificate: {where}."),
        "no-certificate": translate("Advice", "Enter the bar's certificate: {where}."),
    }
