"""Images in the log look as they were taken."""

import numpy as np
import pytest

from picktree.logs.recording import decode_colour, decode_depth
from picktree.logs.recording.foxglove_messages import encode_colour, encode_depth


def test_colours_stay_within_what_the_sensor_resolves() -> None:
    image = np.full((48, 64, 3), 190, np.uint8)
    image[10:30, 20:40] = (217, 25, 25)
    found = decode_colour(encode_colour(image))
    assert np.abs(found.astype(int) - image)[16:24, 24:32].max() <= 3
    assert np.abs(found.astype(int) - image).mean() < 1


def test_depth_keeps_the_millimetre_and_the_unknown() -> None:
    depth = np.array([[0.0, 0.7004, 0.7006], [np.nan, 1.2, 99.0]], np.float32)
    np.testing.assert_allclose(
        decode_depth(encode_depth(depth)), [[0, 0.700, 0.701], [0, 1.2, 65.535]], atol=1e-5
    )


@pytest.mark.parametrize("decode", [decode_colour, decode_depth])
def test_what_is_no_image_is_refused(decode: object) -> None:
    assert callable(decode)
    with pytest.raises(ValueError, match="not a"):
        decode(b"no image")
