"""BLAS and OpenCV on one thread, where several threads of the process ask for it."""

from contextlib import ExitStack

import cv2
import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from spherecal.base.threads import one_blas_thread
from spherecal_boards.board import calibrate_board
from spherecal_boards.board_start import ONE_OPENCV_THREAD
from spherecal_sim.simulated_boards import simulate_board


def blas_threads() -> set[int]:
    import scipy.linalg  # noqa: F401

    return {pool.num_threads for pool in ThreadpoolController().select(user_api="blas").lib_controllers}


@pytest.fixture
def two_blas_threads():
    with ThreadpoolController().limit(limits=2, user_api="blas"):
        if blas_threads() != {2}:
            pytest.skip("this machine's BLAS has one thread")
        yield


def test_blocks_that_overlap_keep_to_one_thread_until_the_last_one_ends(two_blas_threads):
    """As with a window's plan of the next placement while another thread calibrates."""
    first, second = ExitStack(), ExitStack()
    first.enter_context(one_blas_thread())
    second.enter_context(one_blas_thread())
    assert blas_threads() == {1}
    first.close()
    assert blas_threads() == {1}, "the second block still runs"
    second.close()
    assert blas_threads() == {2}


def test_an_error_in_a_block_lifts_the_limit(two_blas_threads):
    with pytest.raises(ValueError, match="inside"), one_blas_thread():
        raise ValueError("inside")
    assert blas_threads() == {2}


def test_opencv_keeps_to_one_thread_until_the_last_block_ends():
    before = cv2.getNumThreads()
    first, second = ExitStack(), ExitStack()
    first.enter_context(ONE_OPENCV_THREAD.block())
    second.enter_context(ONE_OPENCV_THREAD.block())
    assert cv2.getNumThreads() == 1
    first.close()
    assert cv2.getNumThreads() == 1, "the second block still runs"
    second.close()
    assert cv2.getNumThreads() == before


@pytest.mark.skipif(cv2.getNumThreads() < 2, reason="OpenCV has one thread on this machine")
def test_a_board_gives_the_same_bits_each_time():
    """`cv2.calibrateCamera` on several threads gave other last digits in each run."""
    session = simulate_board("demo", 3, 16, rows=6, columns=8).session
    found = [np.concatenate([c.intrinsics for c in calibrate_board(session).rig.cameras]).tobytes() for _ in range(4)]
    assert len(set(found)) == 1
