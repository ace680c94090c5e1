"""A GenTL client that is not Harvesters: the producer's exported functions called one by one, as other clients do."""

import ctypes
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from spherecal_gentl.producer.producer_control import ProducerControl, SimulatedCamera
from tests.built_producer import built_producer

WIDTH, HEIGHT, PIXEL_FORMAT, NO_SUCH = 10, 11, 20, 555
NOT_IMPLEMENTED, NOT_AVAILABLE, INVALID_ID = -1003, -1014, -1007
EXCLUSIVE, FOR_EVER = 4, ctypes.c_uint64(2**64 - 1)


class Entry(ctypes.Structure):
    """An information about a buffer that is asked for with others."""

    _pack_ = 1
    _fields_ = (
        ("what", ctypes.c_int32), ("type", ctypes.c_int32), ("out", ctypes.c_void_p), ("size", ctypes.c_size_t),
        ("result", ctypes.c_int32),
    )  # fmt: skip


@pytest.fixture(name="call")
def loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., int]]:
    """Calls an exported function of a producer of this test's own."""
    library = ctypes.CDLL(str(shutil.copy(built_producer(), tmp_path / "own.cti")))

    def call(name: str, *words: Any) -> int:
        return getattr(library, name)(*words)

    with ProducerControl([SimulatedCamera("A1", 320, 240)]) as rig:
        monkeypatch.setenv("SPHERECAL_GENTL_REGION", rig.name)
        assert call("GCInitLib") == 0
        yield call
        assert call("GCCloseLib") == 0


def _opened(call: Callable[..., int]) -> ctypes.c_void_p:
    system, link, device = ctypes.c_void_p(), ctypes.c_void_p(), ctypes.c_void_p()
    assert call("TLOpen", ctypes.byref(system)) == 0
    assert call("TLOpenInterface", system, b"spherecal-simulated-link", ctypes.byref(link)) == 0
    assert call("IFOpenDevice", link, b"SphereCal-B9", EXCLUSIVE, ctypes.byref(device)) == INVALID_ID
    assert call("IFOpenDevice", link, b"SphereCal-A1", EXCLUSIVE, ctypes.byref(device)) == 0
    return device


def test_a_frame_comes_to_a_client_that_never_searched_and_asks_for_many_things_at_once(
    call: Callable[..., int],
) -> None:
    device = _opened(call)
    stream, buffer, event, port = (ctypes.c_void_p() for _ in range(4))
    assert call("DevOpenDataStream", device, b"SphereCal-A1-stream", ctypes.byref(stream)) == 0
    memory = ctypes.create_string_buffer(320 * 240)
    parts, sizes = (ctypes.c_void_p * 1)(ctypes.addressof(memory)), (ctypes.c_size_t * 1)(len(memory) - 1)
    two = ctypes.c_size_t(2)
    assert call("DSAnnounceCompositeBuffer", stream, two, parts, sizes, None, ctypes.byref(buffer)) == NOT_IMPLEMENTED
    one = ctypes.c_size_t(1)
    assert call("DSAnnounceCompositeBuffer", stream, one, parts, sizes, None, ctypes.byref(buffer)) == 0
    assert call("DSQueueBuffer", stream, buffer) == 0
    assert call("GCRegisterEvent", stream, 1, ctypes.byref(event)) == 0
    assert call("DSStartAcquisition", stream, 0, FOR_EVER) == 0
    assert call("DevGetPort", device, ctypes.byref(port)) == 0
    start, four = (ctypes.c_uint32 * 1)(1), ctypes.c_size_t(4)
    assert call("GCWritePort", port, ctypes.c_uint64(0x300), start, ctypes.byref(four)) == 0
    got, size = (ctypes.c_void_p * 2)(), ctypes.c_size_t(16)
    assert call("EventGetData", event, got, ctypes.byref(size), ctypes.c_uint64(5000)) == 0
    assert got[0] == buffer.value

    numbers = (ctypes.c_uint64 * 3)()
    places = [ctypes.addressof(numbers) + 8 * i for i in range(3)]
    asked = (Entry * 4)(
        Entry(WIDTH, 0, places[0], 8, 99),
        Entry(HEIGHT, 0, places[1], 8, 99),
        Entry(PIXEL_FORMAT, 0, places[2], 8, 99),
        Entry(NO_SUCH, 0, None, 0, 99),
    )
    assert call("DSGetBufferInfoStacked", stream, buffer, asked, ctypes.c_size_t(4)) == 0
    assert [entry.result for entry in asked] == [0, 0, 0, NOT_AVAILABLE]
    assert list(numbers) == [320, 240, 0x01080001]
    assert call("DSGetBufferPartInfoStacked", stream, buffer, None, ctypes.c_size_t(0)) == NOT_AVAILABLE
    assert call("DSStopAcquisition", stream, 0) == 0
    assert call("DSClose", stream) == 0
    assert call("DevClose", device) == 0


def test_everything_is_let_go_of_where_a_client_just_ends(call: Callable[..., int]) -> None:
    device = _opened(call)
    stream = ctypes.c_void_p()
    assert call("DevOpenDataStream", device, b"SphereCal-A1-stream", ctypes.byref(stream)) == 0
    assert call("DSStartAcquisition", stream, 0, FOR_EVER) == 0
    time.sleep(0.01)
