"""What a record says of a fault of a plug-in's own code."""

from __future__ import annotations

from pathlib import Path

from picktree.trees.failure_reports import portable_trace
from picktree.trees.loading import load_plugin

PLUGIN = """\
from picktree.trees import Node
from picktree.trees import NodeStatus


class Wave(Node):
    '''Wave a hand.'''

    def on_tick(self):
        raise LookupError(f"no hand in {object()}")


NODES = (Wave,)
"""


def trace_of(folder: Path) -> str:
    folder.mkdir()
    (folder / "wave.py").write_text(PLUGIN)
    (wave,) = load_plugin("wave.py", folder).nodes
    try:
        wave.on_tick(None)  # type: ignore[arg-type]
    except LookupError as error:
        return portable_trace(error)
    raise AssertionError


def test_a_traceback_is_the_same_wherever_the_plug_in_lies(tmp_path: Path) -> None:
    here, there = trace_of(tmp_path / "here"), trace_of(tmp_path / "there")
    assert here == there
    assert here == (
        "Traceback (most recent call last):\n"
        '  File "test_traces.py", line 31, in trace_of\n'
        "    wave.on_tick(None)  # type: ignore[arg-type]\n"
        "    ^^^^^^^^^^^^^^^^^^\n"
        '  File "wave.py", line 9, in on_tick\n'
        '    raise LookupError(f"no hand in {object()}")\n'
        "LookupError: no hand in <object object at 0x…>\n"
    )
