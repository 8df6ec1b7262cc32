"""A recorder that dies at any moment, in the middle of a write too, leaves a log that opens.

`benchmarks/crashes.py` does it ten thousand times with a real run, and kills a hundred real processes.
"""

import importlib.util
import random
import sys
from pathlib import Path
from types import ModuleType

import pytest

from picktree.logs.recording import Recorder
from picktree.world import PlanningScene

MOMENTS = 120


@pytest.fixture(scope="module")
def tapes() -> ModuleType:
    """`benchmarks/_tape.py`."""
    path = Path(__file__).parents[2] / "benchmarks" / "_tape.py"
    spec = importlib.util.spec_from_file_location("_tape", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["_tape"] = module
    spec.loader.exec_module(module)
    return module


def test_every_moment_leaves_a_log_without_at_most_its_last_second(
    sample: ModuleType, tapes: ModuleType, tmp_path: Path
) -> None:
    scene = PlanningScene([sample.TABLE], [sample.BIN])
    with tapes.taped() as tape, Recorder(tmp_path / "log.mcap", sample.RUN) as recorder:
        sample.start(recorder)
        first_tick = tape.length
        for k in range(80):
            sample.step(recorder, scene, k)
            if k % 40 == 20:
                recorder.attach(f"checkpoint-{k}.json", "x" * 3000)
    assert 0 < tape.published <= first_tick
    assert {step.kind for step in tape.steps} == {"seek", "write"}

    rng = random.Random(5)
    boundaries, at = [tape.published], 0
    for step in tape.steps:
        at += step.length
        boundaries += [at - 1, at, at + 1, at + 14]  # 13 bytes into a write, the next whole record begins
    somewhere = [rng.randint(tape.published, tape.length) for _ in range(MOMENTS)]
    moments = sorted({m for m in boundaries if tape.published <= m <= tape.length} | set(somewhere))
    opened = [
        tapes.open_moment(tape, moment, data, tmp_path / "cut.mcap") for moment, data in tape.states(moments)
    ]
    assert len(opened) > MOMENTS
    assert sum(each.stock and not each.recovered for each in opened) > 10
    assert sum(each.recovered for each in opened) > MOMENTS / 2
    assert opened[-1].lost == 0
    assert tape.must_hold(tape.length) > 350


def test_states_are_what_was_on_the_disk(sample: ModuleType, tapes: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with tapes.taped() as tape:
        sample.record(path, ticks=5)
    ((_, last),) = tape.states([tape.length])
    assert last == path.read_bytes()
