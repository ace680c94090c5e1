"""GigE cameras in network namespaces for tests, or a skip that says what is missing."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from spherecal.base.errors import InputError
from spherecal_gentl.gige.gige_control import GigeCamera, GigeRig
from spherecal_gentl.gige.namespaces import why_not
from spherecal_gentl.producer.build_producer import build_producer

SMALL = (320, 240)


def aravis_producer() -> Path:
    """Its .cti; skips where it cannot be built."""
    pytest.importorskip("harvesters", reason="harvesters is not installed: pip install spherecal[cameras]")
    pytest.importorskip("genicam.gentl", reason="genicam is not installed: pip install spherecal[cameras]")
    try:
        return build_producer(aravis=True)
    except InputError as error:
        pytest.skip(str(error))


@contextmanager
def wired(count: int, size: tuple[int, int] = SMALL) -> Iterator[GigeRig]:
    """A rig of equal cameras, and this thread on its computer; skips where there can be none."""
    with wired_as([GigeCamera(f"GE{i + 1:02d}", *size) for i in range(count)]) as rig:
        yield rig


@contextmanager
def wired_as(cameras: list[GigeCamera]) -> Iterator[GigeRig]:
    """A rig of these cameras, and this thread on its computer; skips where there can be none."""
    aravis_producer()
    if (reason := why_not()) is not None:
        pytest.skip(f"no network namespaces: {reason}")
    if os.geteuid() != 0:
        pytest.skip("only root enters another network namespace from a running program")
    with GigeRig(cameras) as rig, rig.entered():
        yield rig
