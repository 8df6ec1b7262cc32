"""What holds for all tests."""

import signal

import pytest

from picktree.world.arithmetic import restart  # picktree before numpy: it chooses numpy's kernels


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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes long begins first, so that no worker waits for another at the end."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
