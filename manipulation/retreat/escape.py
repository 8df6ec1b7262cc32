"""Out of the narrow, before planning is possible again."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

from ...planning.requests import Scaling
from .clearing import Leaving

if TYPE_CHECKING:
    from ...cell.world import World


def escape(world: World, scaling: Scaling, node: str) -> Generator[None, None, None]:
    """Out of what the arm is believed to be in, slowly, the depths shrinking, and up from what is near.

    Nothing happens where there is no way: whoever plans next is told why. `scaling` is no more than is done
    anyway: ways out are slow.
    """
    del scaling
    leaving = Leaving(world, node)
    yield from leaving.relax()
    if (yield from leaving.out()):
        yield from leaving.up()
