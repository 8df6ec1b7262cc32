"""picktree run --live and --pace"""

from __future__ import annotations

import socket
import sys
from pathlib import Path
from typing import Any

import pytest

from picktree import session
from picktree.apps.cli import answer
from picktree.logs import install_command

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_a_run_says_where_its_feed_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["run", str(EXAMPLES / "one_pick.yaml"), "--backend", "kinematic", "--out", str(tmp_path)]
    assert answer([*line, "--live", "--live-port", "0", "--pace", "1000"]) == 0
    told = capsys.readouterr()
    assert told.err.startswith("live view at ws://127.0.0.1:")
    assert "success: the goal is reached" in told.out


def test_a_port_that_is_taken_stops_before_anything_moves(
    stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert answer(["run", "m.yaml", "--live", "--live-port", str(port)]) == 2
    assert capsys.readouterr().err == (
        f"no live view on port {port}: something else listens there; give another with --live-port\n"
    )
    assert stage.requests == []


def test_without_the_sdk_the_extra_is_named(
    stage: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delitem(sys.modules, "picktree.session.live_view", raising=False)
    monkeypatch.delitem(vars(session), "LiveServer", raising=False)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    assert answer(["run", "m.yaml", "--live"]) == 2
    assert capsys.readouterr().err == f"A live view needs the extra 'live': {install_command('live')}\n"
    assert stage.requests == []
