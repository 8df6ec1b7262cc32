"""What holds for all tests."""

import signal

import pytest

from .needs import left_out


def pytest_configure() -> None:
    """Ctrl-C and a closed terminal mean what they mean at a terminal, also where whoever started the tests
    ignores them, as a shell or `nohup` does in the background; what tests start inherits that."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes long begins first, so that no worker waits for another at the end."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say which tests wait for something that this machine lacks."""
    skipped = [report.longrepr for report in terminalreporter.getreports("skipped")]
    if line := left_out(reason[2] for reason in skipped if isinstance(reason, tuple)):
        terminalreporter.write_line(line)
