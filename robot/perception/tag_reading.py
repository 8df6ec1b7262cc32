"""ArUco tags in colour pictures."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from picktree.world import Array

from .camera_geometry import PosedCamera

TAG_MAGNIFICATION = 3
"""Factor by which a picture is enlarged before tags are read: modules are 3 pixels wide at 0.85 m."""
MAX_TAG_WINDOW, MIN_TAG_PERIMETER = 53, 0.02
"""Greatest window of the adaptive threshold, enlarged pixels, and least perimeter of a tag, as a share of the
picture's longer side."""


def read_tags(
    sight: PosedCamera, depth: Array, colour: NDArray[np.uint8], corner: tuple[int, int] = (0, 0)
) -> Iterator[tuple[int, Array]]:
    """Yield number and middle (3,) in the world of each ArUco tag that a picture shows.

    Depth (h, w), m, 0 where it is not known, and `colour` (h, w, 3) are a part of the camera's picture. It
    begins at `corner`, a column and a row. The brightest channel sets the black square apart from any
    saturated colour about it.
    """
    times = TAG_MAGNIFICATION
    bright = np.ascontiguousarray(colour.max(axis=2))
    large = cv2.resize(bright, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
    settings = cv2.aruco.DetectorParameters()
    settings.adaptiveThreshWinSizeMax, settings.minMarkerPerimeterRate = MAX_TAG_WINDOW, MIN_TAG_PERIMETER
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    outlines, numbers, _ = cv2.aruco.ArucoDetector(known, settings).detectMarkers(large)
    # Without a tag there are no numbers, not even an empty array.
    found = np.ravel(np.asarray(numbers)).tolist() if len(outlines) else ()
    for outline, number in zip(outlines, found, strict=True):
        middle = (np.asarray(outline, np.float64).reshape(4, 2).mean(axis=0) + 0.5) / times - 0.5
        column, row = (round(float(c)) for c in middle)
        near = depth[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]
        if (near > 0).any():
            ray = sight.directions(middle[None] + np.array(corner))[0]
            yield int(number), sight.origin + ray * float(np.median(near[near > 0]))
