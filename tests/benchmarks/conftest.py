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
    "_campaign_results", "_campaign", "_fault_measures", "_fault_table", "_fault_page",
    "fault_campaign",
    "_atlas_page",
    "_soaking", "_soak_report", "machines", "speed", "_explanation_cases", "explanations",
    "_situation_drawing", "_situation_labels", "_situation_score", "situations",
)  # fmt: skip
"""Each after what it imports."""


@pytest.fixture(scope="session")
def program() -> Callable[[str], ModuleType]:
    """A module of benchmarks/ by its name."""
    programs: dict[str, ModuleType] = {}
    for name in _ORDER:
        path = BENCHMARKS / f"{name.replace('.', '/')}.py"
        known = sys.modules.get(name)
        if known is None or known.__file__ != str(path):  # a checkout may be called like a program
            spec = importlib.util.spec_from_file_location(name, path)
            assert spec is not None and spec.loader is not None
            known = importlib.util.module_from_spec(spec)
            sys.modules.setdefault(name, known)
            spec.loader.exec_module(known)
        programs[name] = known
    return programs.__getitem__
