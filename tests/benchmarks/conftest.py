"""The programs in benchmarks/ import each other by their bare names, as programs beside each other do."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
_ORDER = (
    "_campaign", "_fault_measures", "_fault_table", "_fault_page", "fault_campaign", "_atlas_page",
    "_soaking",
)  # fmt: skip
"""Each after what it imports."""


@pytest.fixture(scope="session")
def program() -> Callable[[str], ModuleType]:
    """A module of benchmarks/ by its name."""
    for name in _ORDER:
        if name not in sys.modules:
            spec = importlib.util.spec_from_file_location(name, BENCHMARKS / f"{name}.py")
            assert spec is not None and spec.loader is not None
            module = importlib.util.module_from_spec(spec)
            sys.modules[name] = module
            spec.loader.exec_module(module)
    return lambda name: sys.modules[name]
