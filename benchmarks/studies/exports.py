"""Round trips of every export format: what an independent program reads projects as the rig does."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.studies.export_readers import READERS, python_for, read
from benchmarks.studies.report import Report
from spherecal.data.rig import Rig
from spherecal_documents.export.file_cameras import MM_PER
from spherecal_documents.export.write_export import FORMATS, Exported, check_points, export_rig
from tests.export_rigs import make_rig

GOAL_PX = 1e-6


@dataclass(frozen=True)
class RoundTrip:
    """One rig through one format and one reader; px.

    `to_rig_px` is the reader's largest difference from the rig, `to_ours_px` from what this program reads in the file:
    the two differ by what a refit costs.
    """

    reader: str
    exported: Exported
    to_rig_px: float
    to_ours_px: float

    @property
    def exact(self) -> bool:
        return not self.exported.losses


def round_trip(rig: Rig, reader: str, folder: Path) -> RoundTrip:
    """Export, read with the independent reader, project 1,000 points into every camera."""
    form = FORMATS[READERS[reader][0]]
    path = folder / form.name
    exported = export_rig(rig, form.name, path, max_loss_px=np.inf)
    ids = exported.ids
    checked = {name: check_points(camera, rig) for name, camera in zip(ids, rig.cameras, strict=True)}
    points = {name: world / MM_PER[exported.unit] for name, (world, _) in checked.items()}
    found = read(reader, path, points)
    ours = {camera.id: camera.project(points[camera.id]) for camera in form.read(path)}
    return RoundTrip(
        reader,
        exported,
        max(float(np.abs(found[name] - checked[name][1]).max()) for name in ids),
        max(float(np.abs(found[name] - ours[name]).max()) for name in ids),
    )


def report(_runs: int | None = None) -> Report:
    """All readers that are there, for lenses of 5, 8 and 12 coefficients."""
    page = Report("Exports read by other programs", "python3 dev.py studies exports")
    page.text(
        "Twelve cameras with machine-vision lenses, 1,000 points all over each image at 0.5 to 2 times the rig's size. "
        "The reader's column tells whose code reads and projects; px are the largest differences in u or v. "
        "Where a format has fewer coefficients than the lens, the lens is refitted: *to the rig* then holds the loss "
        "(at these points; the columns after it: over the whole image) and *to ours* the agreement of the two readings."
    )
    present = [reader for reader in READERS if python_for(reader) is not None]
    for count in (5, 8, 12):
        rig = make_rig(count)
        with tempfile.TemporaryDirectory() as folder:
            trips = [round_trip(rig, reader, Path(folder)) for reader in present]
        page.heading(f"Lenses with {count} distortion coefficients")
        header = (
            "format",
            "reader",
            "unit",
            "to the rig px",
            "to ours px",
            "refit max px",
            "refit rms px",
            "turned deg",
        )
        page.table(header, [_row(trip) for trip in trips])
        exact = [trip.to_rig_px for trip in trips if trip.exact]
        both = [trip.to_ours_px for trip in trips]
        page.verdict(
            f"{GOAL_PX:g} px where the format carries {count} coefficients",
            max(exact) <= GOAL_PX,
            f"{max(exact):.2g} px over {len(exact)} readers",
        )
        page.verdict(
            f"{GOAL_PX:g} px between the two readings of every file",
            max(both) <= GOAL_PX,
            f"{max(both):.2g} px over {len(both)} readers",
        )
        page.text("")
    if absent := sorted(set(READERS) - set(present)):
        page.text(f"Not installed, not run: {', '.join(absent)} (a Python that has them: SPHERECAL_READERS).")
    return page


def _row(trip: RoundTrip) -> tuple[object, ...]:
    losses = trip.exported.losses.values()
    loss = [max(values) for values in zip(*((o.max_px, o.rms_px, o.turned_deg) for o in losses), strict=True)]
    shown = [f"{value:.2g}" for value in loss] or ["-", "-", "-"]
    difference = (f"{trip.to_rig_px:.2g}", f"{trip.to_ours_px:.2g}")
    return (trip.exported.format.name, trip.reader, trip.exported.unit, *difference, *shown)
