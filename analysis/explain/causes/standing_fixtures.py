"""Fixtures that stand around an item or over a bin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....logs.schema.records import Body
from ....world.scene.description import Bin, Fixture
from ....world.shapes import extents
from ..investigation.case import Case

OVER = 0.35
"""Height over a bin's rim, and width around an item, that hand and arm need, m."""


def fixture_above(case: Case, target: Bin) -> str:
    """The fixture that covers a bin, or reaches into the room over it; empty when none does."""
    (x, y, z), (sx, sy, sz) = target.pose.position, target.size
    low, high = (x - sx / 2, y - sy / 2, z + sz), (x + sx / 2, y + sy / 2, z + sz + OVER)
    return next((name for name, fixture in case.fixtures.items() if _overlap(fixture, low, high)), "")


def fixtures_around(case: Case, lies: Body) -> list[str]:
    """Fixtures in the column over an item, the hand's width around it."""
    x, y, z = lies.pose.position
    low, high = (x - OVER / 2, y - OVER / 2, z), (x + OVER / 2, y + OVER / 2, z + 2 * OVER)
    return [name for name, fixture in case.fixtures.items() if _overlap(fixture, low, high)]


def _overlap(fixture: Fixture, low: Sequence[float], high: Sequence[float]) -> bool:
    least, most = extents(fixture.shape, fixture.pose.rotation())
    at = np.array(fixture.pose.position)
    return bool(np.all(at + least < np.array(high)) and np.all(at + most > np.array(low)))
