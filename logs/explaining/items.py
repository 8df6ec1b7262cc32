"""What happened to each item, as the robot believed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .explanation import FailureStory, ItemStory

if TYPE_CHECKING:
    from ..run import Run


def items_of(run: Run, failures: Sequence[FailureStory]) -> tuple[ItemStory, ...]:
    del run, failures
    return ()
