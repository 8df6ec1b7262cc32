"""What holds for all tests."""

import signal


def pytest_configure() -> None:
    """Ctrl-C means what it means at a terminal, also where whoever started the tests ignores it, as a shell
    does for what it runs in the background; programs that tests start inherit that."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
