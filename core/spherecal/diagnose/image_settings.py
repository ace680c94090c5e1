"""Images of a camera that their files say were taken by another one, or with another size or region of its sensor."""

from functools import lru_cache
from itertools import pairwise
from pathlib import Path

from spherecal.base.errors import InputError
from spherecal.base.messages.values import Phrase
from spherecal.data.findings import Finding
from spherecal.data.session import Session
from spherecal.targets.image_facts import ImageFacts, image_facts

_Setting = tuple[int, int] | str


def image_settings(session: Session) -> list[Finding]:
    """A finding for each camera whose images state different sizes, regions or serial numbers, from which one on.

    A lens and a pose are those of one region of one sensor: shifted by 8 px in mid-recording it passed for a move.
    """
    found = []
    for camera in session.cameras:
        places = [p for p in (*session.placements, *session.bar_poses) if camera.id in p.images]
        shown = [(p.id, facts) for p in places if (facts := _facts(p.images[camera.id])) is not None]
        for kind in ("image-serial", "image-size", "image-offset"):
            change = _change([(place, getattr(facts, kind.removeprefix("image-"))) for place, facts in shown])
            if change is not None:
                place, before, now = change
                what = {"before": _words(before), "now": _words(now)}
                values = {"camera": camera.id, "place": place, "what": Phrase(kind, what)}
                found.append(Finding("image-settings", "warning", values, (camera.id, place)))
                break
    return found


def _change(shown: list[tuple[str, _Setting | None]]) -> tuple[str, _Setting, _Setting] | None:
    """The first place at which a fact differs from the one before, and both; None where all that is stated is alike."""
    known = [(place, fact) for place, fact in shown if fact is not None]
    return next(((at, a, b) for (_, a), (at, b) in pairwise(known) if a != b), None)


def _words(fact: _Setting) -> str:
    return fact if isinstance(fact, str) else " x ".join(map(str, fact))


def _facts(path: Path) -> ImageFacts | None:
    """What an image's file says; None where there is no such image: recorded observations need none."""
    try:
        stat = path.stat()
        return _read(path, stat.st_size, stat.st_mtime_ns)
    except (OSError, InputError):
        return None


@lru_cache(maxsize=4096)
def _read(path: Path, size: int, changed_ns: int) -> ImageFacts:
    """The facts of a file as it is: repairs ask for them several times."""
    del size, changed_ns
    return image_facts(path)
