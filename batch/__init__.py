"""Batches: plans of many runs, the workers that carry them out, results, statistics and reports.

The module can be called: `picktree.batch(mission, seeds=range(20))` is `picktree.api.batches.batch`.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from inspect import Signature


class _CallableRoom(ModuleType):
    """Module that is called as the function of its name."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Run a mission with every seed and every setting; see `picktree.api.batches.batch`."""
        return _function()(*arguments, **options)

    @property
    def __signature__(self) -> Signature:
        """Signature of the function, for `inspect.signature` and notebooks."""
        from inspect import signature

        return signature(_function())


def _function() -> Callable[..., Any]:
    """Return the function by its name: it is on a floor above this one."""
    return import_module("picktree.api.batches").batch


sys.modules[__name__].__class__ = _CallableRoom
