"""A plug-in of pytest that records, for each test, its CPU time and the lines of some sources that it runs.

What a fixture of a module, a package or the session does serves many tests, but is done once: it is recorded
under a name of its own, with the tests that use it.
"""

from __future__ import annotations

import json
import os
import resource
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mutant_site.sitecustomize import CONTEXT, RECORDING, started_coverage

import pytest

FIXTURE = "fixture "
"""Contexts of fixtures begin so; those of tests are their node ids."""


@dataclass
class _Span:
    """CPU time of a test or a fixture, without that of the fixtures within it."""

    name: str
    began: float = field(default_factory=lambda: cpu())
    within: float = 0.0


def cpu() -> float:
    """CPU time of this process and of those that it has waited for, s."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


class Recorder:
    """Records in one process of pytest."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._coverage: Any = started_coverage()
        self._spans: list[_Span] = []
        self._costs: dict[str, float] = {}
        self._fixtures: dict[str, list[str]] = {}
        self._bad: set[str] = set()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        self._fixtures[item.nodeid] = _shared_fixtures(item)
        with_span = self._enter(item.nodeid)
        try:
            return (yield)
        finally:
            self._leave(with_span)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef[Any], request: pytest.FixtureRequest
    ) -> Generator[None, object, object]:
        if fixturedef.scope == "function":
            return (yield)
        span = self._enter(_name(fixturedef, getattr(request, "param_index", 0)))
        try:
            return (yield)
        finally:
            self._leave(span)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if not report.passed:
            self._bad.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        self._coverage.stop()
        self._coverage.save()
        os.environ.pop(CONTEXT, None)
        rows = {
            "costs": {name: round(seconds, 4) for name, seconds in self._costs.items()},
            "fixtures": self._fixtures,
            "bad": sorted(self._bad),
        }
        (self._folder / f"tests-{os.getpid()}.json").write_text(json.dumps(rows), encoding="utf-8")

    def _enter(self, name: str) -> _Span:
        self._spans.append(_Span(name))
        self._switch()
        return self._spans[-1]

    def _leave(self, span: _Span) -> None:
        assert self._spans.pop() is span
        whole = cpu() - span.began
        self._costs[span.name] = self._costs.get(span.name, 0.0) + whole - span.within
        if self._spans:
            self._spans[-1].within += whole
        self._switch()

    def _switch(self) -> None:
        name = self._spans[-1].name if self._spans else ""
        self._coverage.switch_context(name)
        os.environ[CONTEXT] = name


def _shared_fixtures(item: pytest.Item) -> list[str]:
    """Names of the fixtures of wider scope that a test uses."""
    info = getattr(item, "_fixtureinfo", None)
    indices = getattr(getattr(item, "callspec", None), "indices", {})
    return [
        _name(definitions[-1], indices.get(name, 0))
        for name, definitions in (info.name2fixturedefs.items() if info is not None else ())
        if definitions[-1].scope != "function"
    ]


def _name(fixture: pytest.FixtureDef[Any], index: int) -> str:
    return f"{FIXTURE}{fixture.baseid}::{fixture.argname}[{index}]"


def pytest_configure(config: pytest.Config) -> None:
    """Record in the processes that run tests: with xdist, its workers."""
    if hasattr(config, "workerinput") or not config.getoption("numprocesses", 0):
        config.pluginmanager.register(Recorder(Path(os.environ[RECORDING]).parent))
