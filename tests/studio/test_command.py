"""The command: what it says where the extra, the folder or the port is missing."""

from __future__ import annotations

import socket
import sys
from pathlib import Path

import pytest

from picktree.apps.cli import answer


def test_without_the_extra_it_says_how_to_add_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert answer(["studio", "--no-browser"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("picktree studio needs the extra 'studio': ") and "picktree[studio]" in said


def test_a_folder_or_a_port_that_is_not_there_is_told(
    tmp_path: Path, state_home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(["studio", str(tmp_path / "none"), "--no-browser"]) == 2
    assert "none: no such folder; `picktree studio FOLDER` opens one that exists" in capsys.readouterr().err
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert answer(["studio", str(tmp_path), "--no-browser", "--port", str(port)]) == 2
        assert capsys.readouterr().err == (
            f"port {port} cannot be used: address already in use; --port names another\n"
        )
