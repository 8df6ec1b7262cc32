"""What is seen of the coloured squares of a calibration target."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TileSeen:
    """A square in a picture. Pixels (column u, row v) are those of `Intrinsics`."""

    index: int
    """Of the square among those of the target."""
    pixel: tuple[float, float]
    """Centroid of its area in the picture."""
    depth: float
    """Along the optical axis where the ray of `depth_pixel` meets it, m: harmonic mean over its inside."""
    depth_pixel: tuple[float, float]
    depth_sigma: float
    """Standard error of that depth, from the scatter, m."""
    area: int
    """Pixels."""
