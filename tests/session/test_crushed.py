"""What fingers crush is told in the result of the run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from picktree.session.session import RunRequest, Session

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_a_crushed_item_is_in_the_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    request = RunRequest(EXAMPLES / "one_pick.yaml", backend="kinematic", scene="sort_small", out=tmp_path)
    session = Session(request)
    hardware = session.execution.hardware
    truth = hardware.truth
    monkeypatch.setattr(
        hardware,
        "truth",
        lambda: tuple(replace(body, crushed=65.0 if body.kind == "can" else 0.0) for body in truth()),
    )
    (crushed,) = session.run().crushed
    assert (crushed.kind, crushed.force, crushed.limit) == ("can", 65.0, 60.0)
