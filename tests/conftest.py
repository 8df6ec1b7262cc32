"""What holds for all tests."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

from picktree.files import restart  # picktree before numpy: it chooses numpy's kernels
from picktree.files.disk_cache import VARIABLE

from .needs import left_out
from .other_process import OtherProcess
from .recorded_runs import chromium, log_path, picked, sample, troubled_log

if TYPE_CHECKING:
    from xdist.remote import Producer
    from xdist.scheduler import LoadFileScheduling

__all__ = ["chromium", "log_path", "picked", "sample", "troubled_log"]

# The same examples everywhere, and none is refused because a machine is slow.
settings.register_profile(
    "picktree",
    derandomize=True,
    deadline=None,
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("picktree")

# Tests neither fill the user's cache nor depend on it; their processes share one.
os.environ[VARIABLE] = str(Path(__file__).parents[1] / ".pytest_cache" / "picktree")


@pytest.fixture(scope="session")
def elsewhere() -> Iterator[OtherProcess]:
    """Another process with another hash seed, for comparisons."""
    process = OtherProcess()
    yield process
    process.close()


def pytest_configure(config: pytest.Config) -> None:
    """Start the tests once more where the C library was told to compute with other kernels.

    Ctrl-C and a closed terminal mean what they mean at a terminal, also where whoever started the tests
    ignores them, as a shell or `nohup` does in the background; what tests start inherits that."""
    capture = config.pluginmanager.getplugin("capturemanager")
    restart(lambda: capture.suspend_global_capture() if capture else None)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect without looking for garbage: all that comes to be stays until the end.

    Afterwards garbage is looked for more seldom than usual: it took a tenth of the time.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(10_000, 10, 10)
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that have most slow tests, then those with a browser, which take long, too.

    So no worker waits for another at the end.
    """
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    browsing = {item.path for item in items if "chromium" in getattr(item, "fixturenames", ())}
    items.sort(key=lambda item: (-slow[item.path], item.path not in browsing))
    _keep_hypothesis_from_reading_our_sources()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadFileScheduling | None:
    """Hand one file after the other to whichever worker is free, in the order of the tests.

    Files stay whole: what the tests of a module share is made once. The usual way begins with a sixteenth of
    all tests for each of four workers: all slow files for the first.
    """
    if config.getoption("dist") != "load":
        return None
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)


def _keep_hypothesis_from_reading_our_sources() -> None:
    """Hypothesis also tries constants that it finds in the sources of modules that happen to be loaded.

    In a fresh checkout that takes each worker eleven seconds, and the examples of a test depend on what was
    imported before it. There is no setting for it.
    """
    if "hypothesis" in sys.modules:
        from hypothesis.internal.conjecture import providers

        providers._get_local_constants = lambda: providers._local_constants


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say which tests wait for something that this machine lacks."""
    skipped = [report.longrepr for report in terminalreporter.getreports("skipped")]
    if line := left_out(reason[2] for reason in skipped if isinstance(reason, tuple)):
        terminalreporter.write_line(line)
