"""Whatever a job does costs itself alone, and is named: the other jobs give what they give alone."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.apps.batch import Batch, BatchPlan, Executor, LocalExecutor
from picktree.session import RunRequest, Session

from .trouble import troubled
from .watching import Remembering

ENDS = {
    1: "time.sleep(5); ctypes.string_at(0)",  # what is older than a second is in the log
    2: "os.abort()",
    3: "os._exit(7)",
    4: "sys.exit(3)",
    5: "raise KeyboardInterrupt",
    6: "raise ValueError('no such luck')",
    7: "os.kill(os.getpid(), signal.SIGKILL)",
    8: "hoard = bytearray(900_000_000); time.sleep(600)",
    9: "while True: print('x' * 10**6), time.sleep(0.01)",
    10: "with open(HERE / 'elsewhere', 'wb') as file:\n    while True: file.write(b'x' * 10**7)",
}
"""What a job does by its seed. 11 goes on for ever, 0 and 12 do nothing."""
OUTSIDE = "the signal came from outside: a person sent it, or the machine ran out of memory"
FOUND = {
    0: ("success", "", 1),
    1: ("crashed", "its process was ended by SIGSEGV, at trouble.py:24 in trouble_1", 2),
    2: ("crashed", "its process was ended by SIGABRT, at trouble.py:27 in trouble_2", 2),
    3: ("crashed", "its process ended with exit code 7", 2),
    4: ("crashed", "it called sys.exit(3)", 2),
    5: ("crashed", "the job was interrupted, by its own code or from outside", 2),
    6: ("failure", "ValueError while Trouble was ticked: no such luck (trouble.py, line 39)", 1),
    7: ("crashed", f"its process was ended by SIGKILL; {OUTSIDE}", 2),
    8: ("crashed", "the job took more than 700 MB of memory, at trouble.py:45 in trouble_8", 2),
    9: ("crashed", "the job wrote more than 50 MB to the disk, at trouble.py:48 in trouble_9", 2),
    10: ("failure", "OSError while Trouble was ticked: [Errno 27] File too large (trouble.py, line 52)", 1),
    11: ("timeout", "", 1),
    12: ("success", "", 1),
}


@pytest.mark.slow
def test_jobs_that_end_their_process_cost_themselves_alone(tmp_path: Path, workers: LocalExecutor) -> None:
    mission = troubled(tmp_path, ENDS, endless=11, picking=True)
    asked = BatchPlan(
        "trouble",
        (mission,),
        tuple(FOUND),
        backend="kinematic",
        memory=700_000_000,
        disk=50_000_000,
        limit=60.0,
    )
    seen = Remembering()
    with Batch.create(tmp_path / "batch", asked) as batch:
        assert batch.run(workers, seen)
        rows = batch.store.query("SELECT seed, status, message, attempts FROM jobs").rows
        lost = batch.store.query("SELECT seed, attempt, reason FROM crashes JOIN jobs USING (job)").rows
    assert {seed: tuple(rest) for seed, *rest in rows} == FOUND
    crashed = {seed: message for seed, (status, message, _) in FOUND.items() if status == "crashed"}
    assert sorted(lost) == [(seed, attempt, crashed[seed]) for seed in crashed for attempt in (1, 2)]
    assert sorted(seen.again) == sorted(crashed.values())
    found = {ended.job.seed: ended.row for ended in seen.ends}
    for seed in crashed:
        with Run(tmp_path / "batch" / found[seed].folder) as run:
            assert found[seed].last_tick == (len(run.ticks) - 1 if run.ticks else None)
    assert found[1].last_tick == 4
    alone = [
        Session(RunRequest(mission, seed=seed, backend="kinematic", out=tmp_path / "alone")).run().digest
        for seed in (0, 12)
    ]
    assert [found[seed].digest for seed in (0, 12)] == alone
    assert not list((tmp_path / "batch/jobs").glob("*/tmp"))


@pytest.mark.slow
def test_a_job_that_hangs_is_ended_and_says_where(tmp_path: Path, worker: Executor) -> None:
    """Its second try gives what it gives alone; `test_jobs_that_end_their_process` has two lost tries."""
    hanging = 'if not (HERE / "hung").exists():\n    (HERE / "hung").touch()\n    time.sleep(600)'
    mission = troubled(tmp_path, {1: hanging})
    asked = BatchPlan("trouble", (mission,), (1,), backend="kinematic", wall_limit=10.0)
    seen = Remembering()
    with Batch.create(tmp_path / "batch", asked) as batch:
        assert batch.run(worker, seen)
    (row,) = [ended.row for ended in seen.ends]
    reason = "the job took more than 10 s of wall time, at trouble.py:26 in trouble_1"
    assert (seen.again, row.status, row.attempts) == ([reason], "success", 2)


RAISE = """\
if (HERE / "none").exists():
    raise RuntimeError("no licence\\nto be had")
"""
BUILT = """\
    def bind(self, *given: object) -> None:
        super().bind(*given)
        if (HERE / "none").exists():
            raise RuntimeError("no licence\\nto be had")

    def run"""


@pytest.mark.parametrize(
    ("before", "after", "reason"),
    [
        (
            "class Trouble",
            f"{RAISE}\n\nclass Trouble",
            "mission/mission.yaml:6:11: plugins[0]: the plug-in 'trouble.py' cannot be imported: "
            "RuntimeError: no licence",
        ),
        ("    def run", BUILT, "RuntimeError: no licence, at trouble.py:18 in bind"),
    ],
)
def test_a_job_that_cannot_be_made_says_why_in_a_line(
    tmp_path: Path, worker: Executor, before: str, after: str, reason: str
) -> None:
    mission = troubled(tmp_path, {})
    plugin = tmp_path / "trouble.py"
    plugin.write_text(plugin.read_text().replace(before, after))
    seen = Remembering()
    with Batch.create(tmp_path / "batch", BatchPlan("no", (mission,), (0,), backend="kinematic")) as batch:
        (tmp_path / "none").touch()
        assert batch.run(worker, seen)
    (row,) = [ended.row for ended in seen.ends]
    assert (row.status, row.message, seen.again) == ("crashed", reason, [reason])
    assert "to be had" in (tmp_path / "batch" / row.folder / "output.txt").read_text()


CHANGES = """\
os.chdir("/")
os.environ.clear()
os.umask(0o777)
locale.setlocale(locale.LC_ALL, "C")
random.seed(1)
np.random.seed(1)
sys.path.clear()
sys.setrecursionlimit(60 + len(__import__("inspect").stack()))
signal.signal(signal.SIGTERM, signal.SIG_IGN)
builtins.sorted = None
np.float64 = np.float32
World.left_behind = True
threading.Thread(target=time.sleep, args=(600,)).start()
"""
LEAVES = """\
(HERE / "left").write_text(str(subprocess.Popen(["sleep", "600"], start_new_session=True).pid))
os.fork() == 0 and time.sleep(600)
"""
PRINTS = """\
print("from Python")
print("to stderr", file=sys.stderr)
ctypes.CDLL(None).puts(b"from C")
os.system("echo from a child")
assert sys.stdin.read() == ""
"""
LOOKS = """\
assert os.getcwd() == {here!r} and "PATH" in os.environ and not hasattr(World, "left_behind")
"""


def test_a_job_finds_nothing_of_what_the_one_before_it_changed(
    tmp_path: Path, worker: Executor, capfd: pytest.CaptureFixture[str]
) -> None:
    doings = {0: CHANGES, 1: LOOKS.format(here=os.getcwd()), 2: LEAVES, 3: PRINTS}
    mission = troubled(tmp_path, doings, picking=True)
    seen = Remembering()
    asked = BatchPlan("trouble", (mission,), (0, 1, 2, 3), backend="kinematic", keep="all")
    with Batch.create(tmp_path / "batch", asked) as batch:
        assert batch.run(worker, seen)
        left = int((tmp_path / "left").read_text())
        assert not Path(f"/proc/{left}").exists()
    found = {ended.job.seed: ended.row for ended in seen.ends}
    assert [found[seed].status for seed in (1, 2, 3)] == ["success"] * 3
    alone = Session(RunRequest(mission, seed=1, backend="kinematic", out=tmp_path / "alone")).run()
    assert found[1].digest == alone.digest
    printed = {seed: (tmp_path / "batch" / row.folder).parent / "output.txt" for seed, row in found.items()}
    assert sorted(printed[3].read_text().splitlines()) == [
        "from C", "from Python", "from a child", "to stderr",
    ]  # fmt: skip
    assert printed[2].read_text() == "2 processes that the job left behind were ended\n"
    assert not printed[1].exists()
    assert capfd.readouterr() == ("", "")
