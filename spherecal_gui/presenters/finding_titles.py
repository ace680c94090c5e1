"""Findings in a few words in the reader's language, by their codes; the engine's own sentence stands below."""

from PySide6.QtCore import QCoreApplication

translate = QCoreApplication.translate


def finding_title(code: str) -> str:
    """A title for a finding of this code; the code itself where it is new."""
    return _titles().get(code) or code.replace("-", " ")


def known_codes() -> frozenset[str]:
    """The codes that have a title."""
    return frozenset(_titles())


def _titles() -> dict[str, str]:
    return _about_rig() | _about_placements() | _about_lengths()


def _about_rig() -> dict[str, str]:
    return {
        "no-targets": translate("Findings", "No target was found in any image"),
        "no-targets-here": translate("Findings", "No target was found by one camera or at one placement"),
        "empty-table": translate("Findings", "The table of observations is empty"),
        "nothing-reconstructed": translate("Findings", "Nothing could be calibrated"),
        "not-converged": translate("Findings", "The computation did not settle"),
        "stopped-early": translate("Findings", "The computation was stopped"),
        "degenerate-geometry": translate("Findings", "The pictures do not determine the rig"),
        "cameras-unlinked": translate("Findings", "Some cameras hang together with no others"),
        "pose-ambiguous": translate("Findings", "Some cameras may stand in two places"),
        "linked-by-a-thread": translate("Findings", "Some cameras hang together by too little"),
        "groups-of-cameras": translate("Findings", "The cameras were joined in groups"),
        "behind-camera": translate("Findings", "Points lie behind their cameras"),
        "mirrored": translate("Findings", "The images are mirrored, or the targets are others"),
        "intrinsics-held": translate("Findings", "Some lenses could not be determined"),
        "weak-self-calibration": translate("Findings", "Focal lengths are known poorly"),
        "little-coverage": translate("Findings", "Parts of some images stayed empty"),
        "outliers-removed": translate("Findings", "Some dots were left out"),
        "camera-noisy": translate("Findings", "A camera is less sharp or shakes"),
        "camera-moved": translate("Findings", "A camera was moved between placements"),
        "cameras-moved": translate("Findings", "Some cameras moved together"),
        "ball-moved": translate("Findings", "The ball moved between exposures"),
        "cameras-swapped": translate("Findings", "The images of two cameras are exchanged"),
        "lens-misfit": translate("Findings", "The lens model does not fit quite"),
        "fixed-intrinsics-contradicted": translate("Findings", "The given lens is not the one in use"),
        "prior-focal-length": translate("Findings", "The focal length in the bench file is wrong"),
        "image-contradicts": translate("Findings", "One image contradicts all others"),
        "target-contradicts": translate("Findings", "A target is loose or there twice"),
        "swapped-back": translate("Findings", "Exchanged images were put back"),
        "left-out": translate("Findings", "Left out"),
        "pose-split": translate("Findings", "A moved camera was split"),
        "pose-unconfirmed": translate("Findings", "A camera was moved before its last image"),
        "fits-badly": translate("Findings", "The observations fit badly, and are few"),
        "poses-scatter": translate("Findings", "Images of some cameras do not quite agree"),
        "images-rejected": translate("Findings", "Most of what a camera saw was left out"),
        "image-repeated": translate("Findings", "An old image was stored once more"),
        "capture-times": translate("Findings", "An image was not taken with the others"),
        "recording-contradicts": translate("Findings", "The recording contradicts itself"),
        "camera-contradicts": translate("Findings", "A camera does not stand where the calibration has it"),
        "camera-not-verified": translate("Findings", "Some cameras saw no mark of a bar"),
        "rig-with-care": translate("Findings", "The calibration is to be used with care"),
        "rig-incomplete": translate("Findings", "The file of the rig does not say everything"),
        "prior-assumed": translate("Findings", "The lenses' distortion is not given"),
        "rig-not-valid": translate("Findings", "The calibration itself is not valid"),
        "camera-not-checked": translate("Findings", "Some cameras were not checked"),
        "camera-not-in-rig": translate("Findings", "A camera is not part of the calibration"),
    }


def _about_placements() -> dict[str, str]:
    return {
        "few-placements": translate("Findings", "Few placements"),
        "placements-clustered": translate("Findings", "The placements lie close together"),
        "placements-stacked": translate("Findings", "The placements lie one behind the other"),
        "placements-contradict": translate("Findings", "The placements contradict each other"),
        "placements-repeated": translate("Findings", "Two placements are the same"),
        "wrong-placement": translate("Findings", "Images belong to another placement"),
        "two-view-points": translate("Findings", "Many dots were seen by two cameras only"),
        "ball-changed": translate("Findings", "Targets on the ball were replaced or moved"),
        "ball-not-known": translate("Findings", "The ball is not the one of the calibration"),
        "ball-size": translate("Findings", "The rig or the ball has grown or shrunk"),
        "bar-length": translate("Findings", "A bar is measured wrong"),
        "ball-shape-changed": translate("Findings", "The ball changed or moved"),
        "rigid-form-misfit": translate("Findings", "The ball does not fit as one rigid body, and is not the cause"),
        "ball-profile-refused": translate("Findings", "The stored shape of the ball was not used"),
        "ball-profile-scale": translate("Findings", "The stored ball and the session have different scales"),
        "form-rigid": translate("Findings", "The ball was taken as one rigid body"),
        "form-free": translate("Findings", "The ball was not taken as rigid"),
        "form-soft": translate("Findings", "The ball was taken as nearly rigid"),
        "board-shape": translate("Findings", "The board is not as flat as stated"),
        "board-shape-estimated": translate("Findings", "The board's shape was estimated"),
        "board-not-found": translate("Findings", "The board was not found in some images"),
        "not-on-board": translate("Findings", "Some dots do not belong to the board"),
        "few-frames": translate("Findings", "Few pictures of the bar"),
    }


def _about_lengths() -> dict[str, str]:
    return {
        "no-scale": translate("Findings", "Lengths are arbitrary: there is no scale"),
        "scale-uncertainty": translate("Findings", "How certain the scale is"),
        "scale-uncertainty-unknown": translate("Findings", "It is not known how certain the scale is"),
        "scale-conflict": translate("Findings", "Two sources of the scale disagree"),
        "scale-bar-left-out": translate("Findings", "The bar that gave the scale cannot verify"),
        "target-distance": translate("Findings", "The given distance is not that of the targets"),
        "ball-diameter": translate("Findings", "The ball is not as large as stated"),
        "print-scale": translate("Findings", "The targets were printed in another size"),
        "length-uncertainty": translate("Findings", "How certain lengths will be"),
        "length-doubtful": translate("Findings", "A certified length is doubtful"),
        "bars-disagree": translate("Findings", "The bars disagree"),
        "certificate-expired": translate("Findings", "A bar's certificate has expired"),
        "certificate-expires-soon": translate("Findings", "A bar's certificate expires soon"),
        "certificate-not-yet": translate("Findings", "A bar's certificate lies in the future"),
        "no-certificate": translate("Findings", "A bar has no certificate"),
        "no-check-bars": translate("Findings", "No check bar was shown"),
        "mark-not-found": translate("Findings", "A mark of the bar was not found"),
        "contradicting-views": translate("Findings", "Cameras disagree about a mark"),
        "outlying-views": translate("Findings", "Single views of a mark were left out"),
        "no-temperature": translate("Findings", "The bar's temperature was not measured"),
        "bar-assumed": translate("Findings", "A bar's figures were assumed"),
        "length-without-uncertainty": translate("Findings", "A bar's length has no uncertainty"),
        "temperatures-differ": translate("Findings", "The bar's temperatures differ"),
        "camera-covariance-missing": translate("Findings", "The cameras' uncertainty is not known"),
        "camera-uncertainty-unknown": translate("Findings", "A camera's uncertainty is not known"),
    }
