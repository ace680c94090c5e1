"""What was assumed where a session does not state it, as findings."""

from collections.abc import Mapping, Sequence

from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.session import Bar, Session

# Of a bar whose material is not stated: steel's, and anything from none (carbon fibre, Invar) to twice that (aluminium;
# scale/bar_temperature.py).
ASSUMED_EXPANSION_PER_KELVIN = 1.15e-5
ASSUMED_TEMPERATURE_C = 20.0  # ISO 1
ASSUMED_FACTOR = 2.0


def assumed_of_session(session: Session, seen: Mapping[str, float] | None = None) -> list[Finding]:
    """Findings of what a calibration takes as given: the cameras' priors and the bar of the scale."""
    seen = seen or {}
    found = []
    if without := tuple(camera.id for camera in session.cameras if "distortion" in camera.assumed):
        found.append(Finding("prior-assumed", "info", where=without, kind="distortion"))
    if seen:
        least, most = min(seen.values()), max(seen.values())
        found.append(Finding("prior-assumed", "info", {"least_px": least, "most_px": most}, tuple(seen), kind="seen"))
    unknown = [camera.id for camera in session.cameras if "focal_length" in camera.assumed]
    if guessed := tuple(one for one in unknown if one not in seen):
        found.append(Finding("prior-assumed", "info", where=guessed, kind="focal-length"))
    scale = session.scale
    bars = [bar for bar in session.bars if scale is not None and bar.id == scale.bar]
    return found + assumed_of_bars(bars)


def assumed_of_bars(bars: Sequence[Bar]) -> list[Finding]:
    """Findings of what these bars do not state."""
    return [finding for bar in bars for finding in (*_figures(bar), *_lengths(bar))]


def _figures(bar: Bar) -> list[Finding]:
    assumed = []
    if "reference_temperature_c" in bar.assumed:
        assumed.append(Phrase("bar-temperature", {"celsius": ASSUMED_TEMPERATURE_C}))
    if "expansion_per_kelvin" in bar.assumed:
        ppm = 1e6 * ASSUMED_EXPANSION_PER_KELVIN
        assumed.append(Phrase("bar-expansion", {"ppm": ppm, "most_ppm": 2 * ppm}))
    if any("coverage_factor" in length.assumed and length.certified for length in bar.lengths):
        assumed.append(Phrase("bar-factor", {"k": ASSUMED_FACTOR}))
    return [Finding("bar-assumed", "info", {"assumed": assumed}, (bar.id,))] if assumed else []


def _lengths(bar: Bar) -> list[Finding]:
    given = [(length.from_mark, length.to_mark) for length in bar.lengths if not length.certified]
    without = [Phrase("length", {"first": first, "second": second}) for first, second in given]
    effect = Phrase("decides-nothing" if bar.role == "check" else "scale-as-uncertain")
    values = {"lengths": without, "effect": effect}
    return [Finding("length-without-uncertainty", "info", values, (bar.id,))] if without else []
