"""observations.csv: image points of dots, read and written."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.observations import LEAST_SIGMA_PX, MARGIN, SIGMA_COLUMNS, Observations, name_problem
from spherecal_files.atomic import write_file_whole
from spherecal_files.json_file import decode
from spherecal_files.table_file import Table, read_table

COLUMNS = ("placement", "camera", "target", "point", "u", "v")

_MOST_BYTES = 128 << 20  # 2.5 million rows


def read_observations(
    path: Path, placements: Sequence[str], cameras: Sequence[str], image_sizes: Sequence[tuple[int, int]]
) -> Observations:
    """The observations in a file, checked against a session's ids and image sizes (w, h); point names sorted."""
    table = read_table(path, _MOST_BYTES, (COLUMNS, COLUMNS + SIGMA_COLUMNS), _header_problem)
    names = [decode(path, name) for name in sorted(set(table.columns["point"].tolist()))]
    for name in names:
        if problem := name_problem(name):
            row = int(np.argmax(table.columns["point"] == name.encode()))
            raise table.error(row, "point", Phrase("problem-point-name", {"problem": problem}))
    placement = table.lookup("placement", placements, Phrase("problem-not-placement"))
    camera = table.lookup("camera", cameras, Phrase("problem-not-camera"))
    target = table.whole_numbers("target")
    point = table.lookup("point", names, Phrase("problem-not-camera"))
    uv = np.column_stack([table.numbers(column) for column in "uv"])
    _check_inside(table, uv, np.array(image_sizes, dtype=float).reshape(-1, 2)[camera])
    sigma = None
    if len(table.columns) > len(COLUMNS):
        sigma = np.column_stack([table.numbers(column) for column in SIGMA_COLUMNS])
        for k, column in enumerate(SIGMA_COLUMNS):
            table.check(sigma[:, k] >= LEAST_SIGMA_PX, column, Phrase("problem-sigma", {"least": LEAST_SIGMA_PX}))
    ids = tuple(placements), tuple(cameras), tuple(names)
    observations = Observations(*ids, placement, camera, target, point, uv, sigma)
    order = np.lexsort((observations.camera, observations.point, observations.target, observations.placement))
    same = np.ones(max(len(order) - 1, 0), dtype=bool)
    for key in (observations.placement, observations.target, observations.point, observations.camera):
        same &= key[order[1:]] == key[order[:-1]]
    if same.any():
        pair = np.flatnonzero(same)[np.argmin(order[1:][same])]
        first, again = int(order[pair]) + 2, int(order[pair + 1]) + 2
        raise InputError(Phrase("error-dot-twice", {"file": table.path, "line": again, "first": first}))
    return observations


def _header_problem(path: Path, found: str) -> Phrase:
    values = {"file": path, "columns": COLUMNS, "found": found, "optional": SIGMA_COLUMNS}
    return Phrase("error-table-header", values)


def write_observations(path: Path, observations: Observations) -> None:
    """Write observations.csv; numbers keep their full precision."""
    write_file_whole(path, observations_bytes(observations))


def observations_bytes(observations: Observations) -> bytes:
    """The contents of observations.csv; numbers keep their full precision."""
    o = observations
    columns: list[list[str]] = [
        [o.placements[i] for i in o.placement.tolist()],
        [o.cameras[i] for i in o.camera.tolist()],
        list(map(str, o.target.tolist())),
        [o.points[i] for i in o.point.tolist()],
        *(list(map(repr, column.tolist())) for column in o.uv.T),
    ]
    header = COLUMNS
    if o.sigma is not None:
        columns += [list(map(repr, column.tolist())) for column in o.sigma.T]
        header += SIGMA_COLUMNS
    lines = [",".join(header), *map(",".join, zip(*columns, strict=True))]
    return ("\n".join(lines) + "\n").encode()


def _check_inside(table: Table, uv: FloatArray, size: FloatArray) -> None:
    """Raise InputError for an image point that is well outside its image."""
    margin = MARGIN * size.max(axis=1, initial=0.0, keepdims=True)
    good, exchanged = ((some >= -margin) & (some <= size - 1 + margin) for some in (uv, uv[:, ::-1]))

    def problem(row: int) -> Phrase:
        own = table.columns["camera"] == table.columns["camera"][row]
        named = "problem-axes-exchanged" if exchanged[own].all() else "problem-outside-image"
        return Phrase(named, {"width": float(size[row, 0]), "height": float(size[row, 1])})

    for k, column in enumerate("uv"):
        table.check(good[:, k], column, problem)
