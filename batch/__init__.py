"""Batches: plans of many runs, the workers that carry them out, results, statistics and reports.

The module can be called: `picktree.batch(mission, seeds=range(20))` is `picktree.api.batches.batch`.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Any


class _CallableRoom(ModuleType):
    """Module that is called as the function of its name."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Run a mission with every seed and every setting; see `picktree.api.batches.batch`."""
        # By name: what is called stands on a floor above this one.
        return import_module("picktree.api.batches").batch(*arguments, **options)


sys.modules[__name__].__class__ = _CallableRoom
