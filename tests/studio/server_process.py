"""A studio as a user starts it: `picktree studio FOLDER` as a process of its own, which can be killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from picktree.apps.studio.workspace import Workspace

from .conftest import PATIENCE, Served


@dataclass
class ServerProcess:
    """A command `picktree studio` that serves."""

    process: subprocess.Popen[str]
    served: Served

    @property
    def address(self) -> str:
        """Address of the page without the token."""
        return f"http://127.0.0.1:{self.served.port}/"

    def kill(self) -> None:
        """End it at once, as the kernel does when memory is short."""
        self.process.kill()
        self.process.wait(PATIENCE)

    def end(self) -> None:
        """End it as Ctrl-C does."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(PATIENCE)
            finally:
                self.process.kill()
        if self.process.stdout is not None:
            self.process.stdout.close()


@contextmanager
def studio_process(folder: Path, port: int = 0) -> Generator[ServerProcess]:
    """Serve a folder by the command, with the state in `XDG_STATE_HOME`. Port 0: any that is free."""
    process = subprocess.Popen(
        [sys.executable, "-m", "picktree", "studio", str(folder), "--no-browser", "--port", str(port)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    lines = [process.stdout.readline() for _ in range(2)]
    link = lines[1].strip()
    assert link.startswith("http://127.0.0.1:"), lines
    found = int(link.removeprefix("http://127.0.0.1:").split("/")[0])
    started = ServerProcess(process, Served(folder, Workspace(folder), found, link))
    try:
        yield started
    finally:
        started.end()
