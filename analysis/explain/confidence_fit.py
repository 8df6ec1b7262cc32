"""Right root causes of development situations. `python benchmarks/situations.py --fit` writes this module."""

from collections.abc import Mapping
from typing import Final

FITTED: Final[Mapping[tuple[str, bool, bool], tuple[int, int]]] = {
    ("device", False, False): (6, 6),
    ("device", False, True): (7, 7),
    ("device", True, False): (2, 2),
    ("device", True, True): (2, 2),
    ("item", False, False): (3, 4),
    ("item", False, True): (9, 11),
    ("item", True, False): (2, 4),
    ("mission", False, False): (7, 7),
    ("mission", False, True): (7, 7),
}
"""Number of right root causes and of all, by kind, doubt, and whether the ground truth was used."""
