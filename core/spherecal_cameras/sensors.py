"""Pixel pitches by camera model, from the makers' data sheets: start values for cameras without SensorPixelWidth."""

import re

# um, and how models with such a sensor begin. Where one series has several sensors, the number of columns tells.
_BY_MODEL: tuple[tuple[float, str], ...] = (
    (3.45, r"acA(1440-(73|220)|2040-(35|55|120)|2440-|4096-|4112-)"),  # IMX273, 265, 252, 264, 250, 267, 255, 304, 253
    (5.86, r"acA1920-(40|48|50|155)"),  # IMX249, 174
    (5.5, r"acA(2000-(50|165|340)|2040-(25|90|180))"),  # CMV2000, CMV4000
    (4.8, r"acA(640-(300|750)|800-(200|510)|1300-(75|200)|1920-150|2500-(20|60))"),  # PYTHON
    (2.4, r"acA(3088-|5472-)"),  # IMX178, 183
    (3.45, r"(Blackfly S |Oryx )?(BFS|ORX)-\w+-(16S2|23S3|31S4|32S4|50S5|51S5|88S6|89S6|122S6|123S6)"),
    (5.86, r"(Blackfly S )?BFS-\w+-23S6"),
    (2.4, r"(Blackfly S )?BFS-\w+-(63S4|200S[67])"),
    (2.74, r"(Blackfly S )?BFS-\w+-(161S7|163S7|244S8)"),  # IMX540, 542
    (3.45, r"((AVT|Allied Vision) )?((Mako|Manta) )?G-(158|319|507|895|1236)[BC]"),
    (5.86, r"((AVT|Allied Vision) )?((Mako|Manta) )?G-(234|235)[BC]"),
    (2.74, r"(Allied Vision )?(Alvium )?1800 U-811"),  # IMX546
    (3.45, r"MV-C[AS](016-10|032-10|050-10)"),  # IMX273, 265, 264
    (2.4, r"MV-C[AES](060-1|200-10)"),  # IMX178, 183
)


def pitch_of_model(model: str) -> float | None:
    """The pixel pitch in um of a camera model; None for one that is not in the table."""
    return next((pitch for pitch, begins in _BY_MODEL if re.match(begins, model.strip(), re.IGNORECASE)), None)
