"""Lazy import of pyplot, for a library that draws with matplotlib.

toppra imports `matplotlib.pyplot` at its top for three methods that draw, and none of them is called here. It
takes 0.6 s of CPU to import.
"""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

_PACKAGE = "matplotlib"
_PYPLOT = "matplotlib.pyplot"


class _Pyplot(ModuleType):
    """Name `plt` of a module that was imported in `lazy_pyplot`: any attribute is the real pyplot's."""

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(_PYPLOT), name)


@contextmanager
def lazy_pyplot() -> Generator[None]:
    """Let `import matplotlib.pyplot as plt` bind a module that imports pyplot on first use.

    Only modules that are first imported in the block are affected; afterwards `sys.modules` is as it was.
    Where matplotlib is loaded already, the block imports as usual.
    """
    if _PACKAGE in sys.modules:
        yield
        return
    package, pyplot = ModuleType(_PACKAGE), _Pyplot(_PYPLOT)
    setattr(package, "pyplot", pyplot)  # noqa: B010 - a module declares no such attribute
    sys.modules[_PACKAGE], sys.modules[_PYPLOT] = package, pyplot
    try:
        yield
    finally:
        del sys.modules[_PACKAGE], sys.modules[_PYPLOT]
