"""A small valid session folder, and ways to spoil it, for the tests of its reader."""

import copy
import json
from pathlib import Path
from typing import Any

from spherecal.targets.family import make_target_set
from spherecal_files.target_set_file import write_target_set

VALID: dict[str, Any] = {
    "format": "spherecal/session",
    "version": 1,
    "cameras": [
        {
            "id": "C01",
            "serial": "50-0503343",
            "image_size": [2064, 1544],
            "prior": {"matrix": [[2318, 0, 1031.5], [0, 2318, 771.5], [0, 0, 1]], "distortion": [0, 0, 0, 0, 0]},
            "intrinsics_group": "all",
        },
        {
            "id": "C02",
            "image_size": [2064, 1544],
            "pixel_pitch_um": 3.45,
            "focal_length_mm": 8.0,
            "intrinsics_group": "all",
        },
    ],
    "target_set": "targets.json",
    "sphere": {"nominal_diameter_mm": 500.0},
    "placements": [{"id": "P1"}, {"id": "P2", "images": {"C01": "P2/C01.png"}}],
    "scale": {"kind": "target_spacing", "from": "A", "to": "E", "distance_mm": 20.0, "surface": "sphere"},
    "bars": [
        {
            "id": "A",
            "role": "check",
            "marks": {"A1": {"target": 901, "point": "centre"}, "A2": {"target": 902, "point": "centre"}},
            "lengths": [
                {
                    "from": "A1",
                    "to": "A2",
                    "length_mm": 412.345,
                    "expanded_uncertainty_mm": 0.004,
                    "coverage_factor": 2,
                }
            ],
            "expansion_per_kelvin": 1.15e-5,
            "reference_temperature_c": 20.0,
        }
    ],
    "bar_poses": [{"id": "A-01", "bar": "A", "temperature_c": 21.5}],
    "board": {"rows": 3, "columns": 4, "pitch_mm": 3.5},
}
OBSERVATIONS = [
    "placement,camera,target,point,u,v,sigma_u,sigma_v",
    "P1,C01,1,A,100.25,200.5,0.04,0.04",
    "P1,C02,1,A,300.25,200.5,0.04,0.04",
    "A-01,C02,901,centre,1000,1e3,0.04,0.05",
]


def make_session(folder: Path, document: object = None, lines: list[str] | None = None) -> Path:
    text = json.dumps(VALID if document is None else document, allow_nan=True)
    (folder / "session.json").write_text(text, encoding="utf-8")
    (folder / "observations.csv").write_text("\n".join(lines or OBSERVATIONS) + "\n", encoding="utf-8")
    write_target_set(folder / "targets.json", make_target_set(3))
    return folder


def changed(*path: str | int, to: object) -> dict[str, Any]:
    """The valid session with one value put in place of another (or added)."""
    document: Any = copy.deepcopy(VALID)
    value = document
    for key in path[:-1]:
        value = value[key]
    value[path[-1]] = to
    return document


def without(*path: str | int) -> dict[str, Any]:
    document: Any = copy.deepcopy(VALID)
    value = document
    for key in path[:-1]:
        value = value[key]
    del value[path[-1]]
    return document
