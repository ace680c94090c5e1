"""What was assumed where a session does not state it, as findings."""

from collections.abc import Sequence

from spherecal.findings import Finding
from spherecal.session.bar_registry import ASSUMED_EXPANSION_PER_KELVIN, ASSUMED_FACTOR, ASSUMED_TEMPERATURE_C
from spherecal.session.model import Bar, Session


def assumed_of_session(session: Session) -> list[Finding]:
    """Findings of what a calibration takes as given: the cameras' priors and the bar of the scale."""
    found = []
    if without := tuple(camera.id for camera in session.cameras if "distortion" in camera.assumed):
        priors = "prior" if len(without) == 1 else "priors"
        states = "states" if len(without) == 1 else "state"
        message = f"The {priors} of {', '.join(without)} {states} no distortion: it begins at 0."
        hint = "It is estimated unless the intrinsics are fixed; state it in session.json if it is known."
        found.append(Finding("info", "prior-assumed", message, hint, without))
    if guessed := tuple(camera.id for camera in session.cameras if "focal_length" in camera.assumed):
        message = f"The focal lengths of {', '.join(guessed)} are only assumed."
        hint = "State focal_length_mm and pixel_pitch_um of the data sheets if the calibration does not succeed."
        found.append(Finding("info", "prior-assumed", message, hint, guessed))
    scale = session.scale
    bars = [bar for bar in session.bars if scale is not None and bar.id == scale.bar]
    return found + assumed_of_bars(bars)


def assumed_of_bars(bars: Sequence[Bar]) -> list[Finding]:
    """Findings of what these bars do not state."""
    return [finding for bar in bars for finding in (*_figures(bar), *_lengths(bar))]


def _figures(bar: Bar) -> list[Finding]:
    said = []
    if "reference_temperature_c" in bar.assumed:
        said.append(f"its lengths are taken to hold at {ASSUMED_TEMPERATURE_C:g} degrees Celsius")
    if "expansion_per_kelvin" in bar.assumed:
        per_million = 1e6 * ASSUMED_EXPANSION_PER_KELVIN
        said.append(
            f"its expansion is taken as {per_million:g} ppm per kelvin (steel), anything from 0 to {2 * per_million:g} "
            "being possible, which widens the uncertainty"
        )
    if any("coverage_factor" in length.assumed and length.certified for length in bar.lengths):
        said.append(f"its expanded uncertainties are taken to have k = {ASSUMED_FACTOR:g}")
    if not said:
        return []
    message = f"Bar {bar.id} does not state all figures: {'; '.join(said)}."
    return [Finding("info", "bar-assumed", message, "State what its certificate says.", (bar.id,))]


def _lengths(bar: Bar) -> list[Finding]:
    without = [f"{length.from_mark} to {length.to_mark}" for length in bar.lengths if not length.certified]
    if not without:
        return []
    decides = "errors against them decide nothing" if bar.role == "check" else "the scale is as uncertain"
    message = (
        f"Bar {bar.id} states no uncertainty of {', '.join(without)}: that of a class II rule is taken, 0.3 mm + 0.2 "
        f"mm/m, and {decides}."
    )
    hint = "State expanded_uncertainty_mm as its certificate does, or have the bar calibrated."
    return [Finding("info", "length-without-uncertainty", message, hint, (bar.id,))]
