"""What is being done, in the reader's language; the engine and the jobs name their stages in English."""

from spherecal_gui.languages import translate


def stage_name(stage: str) -> str:
    """The stage in words; itself where it is new."""
    return {
        "detect": translate("Stages", "Finding the targets in all images"),
        "finding boards": translate("Stages", "Finding the board in all images"),
        "two-view gate": translate("Stages", "Comparing pairs of cameras"),
        "triples": translate("Stages", "Linking three cameras at a time"),
        "start values": translate("Stages", "Start values"),
        "growing the network": translate("Stages", "Growing the network"),
        "robust adjustment": translate("Stages", "First adjustment"),
        "resection": translate("Stages", "Checking each camera's pose"),
        "bundle adjustment": translate("Stages", "Adjusting everything together"),
        "known ball": translate("Stages", "Comparing with the stored ball"),
        "soft ball": translate("Stages", "Adjusting with a slightly deformable ball"),
        "rigid ball": translate("Stages", "Computing with the ball as one rigid body"),
        "moved cameras": translate("Stages", "Looking for the camera that moved"),
        "uncertainty": translate("Stages", "Uncertainties"),
        "diagnosis": translate("Stages", "Looking for faults"),
        "verification": translate("Stages", "Measuring the bars"),
        "check": translate("Stages", "Comparing with the calibration"),
        "guidance": translate("Stages", "Working out the next placement"),
        "setting exposures": translate("Stages", "Setting exposures"),
        "testing stillness": translate("Stages", "Testing that nothing moves"),
        # the jobs'
        "opening the source": translate("Stages", "Opening the source"),
        "looking for cameras": translate("Stages", "Looking for cameras"),
        "opening the cameras": translate("Stages", "Opening the cameras"),
        "giving the camera an address": translate("Stages", "Giving the camera an address"),
        "building the camera driver": translate("Stages", "Building the camera driver"),
        "setting up the camera": translate("Stages", "Setting up the camera"),
        "taking images": translate("Stages", "Capturing images"),
        "finding targets": translate("Stages", "Finding targets"),
        "writing the images": translate("Stages", "Writing the images"),
        "reading the session": translate("Stages", "Reading what was captured"),
        "writing the result": translate("Stages", "Writing the result"),
        "reading the result": translate("Stages", "Reading the result"),
        "comparing with the calibration in use": translate("Stages", "Comparing with the calibration in use"),
        "drawing the report": translate("Stages", "Drawing the report"),
        "saving the profile": translate("Stages", "Saving in the profile"),
        "exporting": translate("Stages", "Exporting"),
    }.get(stage, stage)
