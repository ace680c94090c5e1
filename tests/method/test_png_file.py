"""PNG files as the program writes them, read by two others."""

import io

import cv2
import numpy as np
import pytest
from PIL import Image

from spherecal_files.png_file import png_bytes


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("size", [(1, 1), (2, 3), (33, 40), (65, 641)])
def test_every_pixel_comes_back(kind, size):
    rng, top = np.random.default_rng(3), np.iinfo(kind).max
    noise = rng.normal(top / 3, top / 50, size).astype(kind)  # as a sensor's
    rare = ((rng.random(size) < 0.001) * top).astype(kind)  # codes as unlike in length as they come
    for image in (noise, rare, rng.integers(0, top + 1, size).astype(kind), np.full(size, top, kind)):
        data = png_bytes(image)
        np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(data))), image)
        read = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert read is not None and read.dtype == kind
        np.testing.assert_array_equal(read, image)


def test_part_of_an_image_is_written_as_such():
    whole = np.random.default_rng(4).integers(0, 2**12, (80, 90)).astype(np.uint16)
    assert png_bytes(whole[3:50, 10:60]) == png_bytes(whole[3:50, 10:60].copy())


def test_sensor_noise_takes_no_more_room_than_by_deflate():
    """As OpenCV writes it with the same filter and Huffman codes only."""
    image = np.random.default_rng(5).normal(9000, 40, (480, 641)).astype(np.uint16)
    how = [
        cv2.IMWRITE_PNG_STRATEGY,
        cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
        cv2.IMWRITE_PNG_FILTER,
        cv2.IMWRITE_PNG_FILTER_UP,
    ]
    assert len(png_bytes(image)) < 1.02 * len(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1, *how])[1])
