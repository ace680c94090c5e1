"""The simulated GenTL producer for tests, or a skip that says what is missing."""

from pathlib import Path

import pytest

from spherecal.base.errors import InputError
from spherecal_gentl.producer.build_producer import build_producer


def built_producer() -> Path:
    """Its .cti; skips where a library of the cameras or the compiler is not there."""
    pytest.importorskip("harvesters", reason="harvesters is not installed: pip install spherecal[cameras]")
    pytest.importorskip("genicam.gentl", reason="genicam is not installed: pip install spherecal[cameras]")
    try:
        return build_producer()
    except InputError as error:
        pytest.skip(str(error))
