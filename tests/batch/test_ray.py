"""A batch on a Ray cluster gives what it gives on local workers, whatever happens to foremen and nodes."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.apps.batch import Batch, BatchPlan, Executor, LocalExecutor, RayExecutor, ray_executor
from picktree.apps.batch.ray_executor import Installation, difference, installed
from picktree.apps.cli import answer
from picktree.files import PicktreeError
from picktree.logs import install_command

from ..benchmarks.test_campaign import BENCHMARKS, PROGRAM
from ..commands import until
from ..needs import RAY, needs
from .processes import alive, below, name
from .ray_nodes import NODES, head, node
from .watching import Remembering

pytestmark = needs(RAY)

ONE_PICK = Path(__file__).parents[2] / "examples/one_pick.yaml"
PLAN = BatchPlan("test", (ONE_PICK,), (0, 1, 2), backend="kinematic", keep="all")
TABLE = "SELECT seed, status, digest, items_sorted, attempts FROM jobs ORDER BY number"
TROUBLE = """\
from picktree.trees import Skill, Steps
from picktree.robot import World
from pathlib import Path
import os, signal, time

HERE = Path({here!r})


def once(seed):
    marker = HERE / f"tried-{{seed}}"
    first = not marker.exists()
    marker.touch()
    return first


def above(pid):
    return int(Path(f"/proc/{{pid}}/stat").read_text().rpartition(")")[2].split()[1])


class Trouble(Skill):
    \"\"\"What a skill should not do.\"\"\"

    def run(self, world: World) -> Steps:
        for _ in range(5):
            yield
        seed = world.streams.seed
        {doing}
        yield


NODES = (Trouble,)
"""


def troubled(folder: Path, doing: str, seeds: tuple[int, ...]) -> BatchPlan:
    """A mission whose only skill does that after five ticks."""
    (folder / "trouble.py").write_text(TROUBLE.format(here=str(folder), doing=doing))
    mission = folder / "mission.yaml"
    mission.write_text(
        "picktree: 1\nkind: mission\nname: trouble\nscene: sort_small\ngoal: left >= 0\n"
        "plugins: [trouble.py]\ntrees:\n  Main: Trouble\n"
    )
    return BatchPlan("trouble", (mission,), seeds, backend="kinematic", keep="all")


def run(plan: BatchPlan, folder: Path, executor: Executor) -> tuple[tuple[object, ...], ...]:
    """The table that comes of it."""
    with Batch.create(folder, plan) as batch:
        assert batch.run(executor, Remembering())
        return batch.store.query(TABLE).rows


@pytest.fixture(scope="module")
def cluster() -> Generator[str]:
    """Address of one cluster for all tests: to start one takes the longest."""
    with head(3) as address, pytest.MonkeyPatch.context() as patch:
        for name, value in NODES.items():
            patch.setenv(name, value)
        yield address


def all_workers(executor: RayExecutor, count: int) -> None:
    """Wait until `count` workers are there. On a busy machine they come one after the other."""

    def all_there() -> bool:
        executor.wait(0.1)
        return executor.slots == count

    until(all_there, f"worker {count}")


@pytest.fixture(scope="module")
def two(cluster: str) -> Generator[RayExecutor]:
    """Two workers of the cluster."""
    with RayExecutor(2, cluster) as executor:
        all_workers(executor, 2)
        yield executor


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory, workers: LocalExecutor) -> tuple[tuple[object, ...], ...]:
    return run(PLAN, tmp_path_factory.mktemp("local") / "batch", workers)


@pytest.mark.parametrize("shared", [True, False], ids=["one folder", "no folder in common"])
def test_the_table_is_that_of_local_workers(
    tmp_path: Path,
    two: RayExecutor,
    table: tuple[tuple[object, ...], ...],
    shared: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if not shared:  # as on another machine: what the batch puts there is not what the worker looks for
        monkeypatch.setattr(ray_executor, "TOKEN", ".of-another-machine")
    folder = tmp_path / "batch"
    assert run(PLAN, folder, two) == table
    kept = sorted(path.name for path in (folder / "jobs").rglob("*") if path.is_file())
    assert kept == ["log.mcap"] * 3 + ["result.json"] * 3 + ["rows.json"] * 3
    for log in folder.glob("jobs/*/*/log.mcap"):
        with Run(log) as kept:
            assert (kept.recovered, kept.log.run.files["mission.yaml"].partition(" ")[2]) == (
                "",
                str(ONE_PICK),
            )


def test_a_worker_that_is_lost_costs_its_job_one_try(
    tmp_path: Path, two: RayExecutor, workers: LocalExecutor
) -> None:
    doing = """
        if seed == 1 and once(seed):
            os.kill(os.getpid(), signal.SIGKILL)
        if seed == 2 and once(seed):
            os.kill(above(above(os.getpid())), signal.SIGKILL)  # that of Ray
            time.sleep(600)"""
    plan = troubled(tmp_path, doing, (0, 1, 2, 3))
    seen = Remembering()
    with Batch.create(tmp_path / "batch", plan) as batch:
        assert batch.run(two, seen)
        rows = batch.store.query(TABLE).rows
    undisturbed = run(plan, tmp_path / "undisturbed", workers)
    assert [row[:4] for row in rows] == [row[:4] for row in undisturbed]
    assert [row[4] for row in rows] == [1, 2, 2, 1]
    assert len(seen.again) == 2
    assert [reason for reason in seen.again if re.fullmatch(r"its worker on the node [\d.]+ is gone", reason)]


def test_a_stopped_batch_breaks_its_jobs_off_and_goes_on_later(tmp_path: Path, two: RayExecutor) -> None:
    doing = """
        (HERE / f"pid-{seed}").write_text(str(os.getpid()))
        while not (HERE / "go").exists():
            time.sleep(0.02)  # the run's own limit of time is far away
            yield"""
    plan = troubled(tmp_path, doing, (0, 1, 2))

    class Impatient(Remembering):
        def waiting(self) -> None:
            if all((tmp_path / f"pid-{seed}").exists() for seed in (0, 1)):
                batch.stop()

    with Batch.create(tmp_path / "batch", plan) as batch:
        assert not batch.run(two, Impatient())
    assert not alive({int((tmp_path / f"pid-{seed}").read_text()) for seed in (0, 1)})
    assert not (tmp_path / "pid-2").exists()
    (tmp_path / "go").touch()
    with Batch.resume(tmp_path / "batch") as batch:
        assert batch.run(two, Remembering())
        assert [row[1] for row in batch.store.query(TABLE).rows] == ["success"] * 3


def test_a_node_with_another_picktree_is_refused(
    cluster: str, two: RayExecutor, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = installed()
    edited = replace(here, sources={**here.sources, "skills/grasp.py": "0"})
    monkeypatch.setattr(ray_executor, "installed", lambda: edited)
    with pytest.raises(PicktreeError) as refused:
        RayExecutor(address=cluster)
    assert re.fullmatch(
        r"the node [\d.]+: its picktree differs from the one here in skills/grasp\.py", str(refused.value)
    )
    assert two.slots == 2


def test_a_campaign_runs_on_a_cluster(cluster: str, tmp_path: Path) -> None:
    squares = tmp_path / "squares.py"
    squares.write_text(PROGRAM.format(benchmarks=str(BENCHMARKS), place=str(tmp_path)))
    options = ["--ray", cluster, "--workers", "1", "--out", str(tmp_path / "results")]
    done = subprocess.run([sys.executable, squares, *options], capture_output=True, text=True, check=False)
    assert done.stdout == "[0, 1]\n", done.stderr
    lines = (tmp_path / "results" / "results.jsonl").read_text().splitlines()
    assert [json.loads(line)["row"] for line in lines] == [{"seed": n, "square": n * n} for n in range(2)]


def test_the_sources_of_a_worker_are_those_of_its_runs_and_of_batches() -> None:
    found = set(installed().sources)
    assert {"apps/batch/local_executor.py", "apps/batch/cluster.py", "analysis/resim.py"} <= found
    assert {
        "analysis/explain/run_explanation.py",
        "skills/grasp.py",
        "robot/control/control_loop.py",
    } <= found
    assert [
        path
        for path in found
        if path.startswith(("apps/cli/", "apps/batch/report.py", "analysis/render/films.py"))
    ] == []


def test_what_sets_two_machines_apart_is_said() -> None:
    here = Installation({"numpy": "2.4.6", "python": "3.11"}, {"skills/grasp.py": "a", "world/clock.py": "b"})
    there = Installation({"numpy": "2.3.0"}, {"skills/grasp.py": "b"})
    assert difference(here, here) == ""
    assert difference(here, there) == "it has numpy 2.3.0, here 2.4.6; python missing, here 3.11"
    same = replace(there, versions=here.versions)
    assert (
        difference(here, same) == "its picktree differs from the one here in skills/grasp.py, world/clock.py"
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--address", "auto"], "--address names a Ray cluster: add --executor ray"),
        (["--executor", "ray", "--address", "127.0.0.1:9"],
         "no Ray cluster answers at 127.0.0.1:9: connection refused"),
        (["--executor", "ray", "--address", "ray://head:10001"],
         "--address ray://head:10001: the address of a Ray cluster is HOST:PORT, or auto"),
    ],
)  # fmt: skip
def test_a_cluster_that_is_not_there_is_said_before_there_is_a_batch(
    tmp_path: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["batch", "run", "--mission", str(ONE_PICK), "--out", str(tmp_path / "batch"), *options]
    assert answer(given) == 2
    assert capsys.readouterr().err == f"{message}\n"
    assert not (tmp_path / "batch").exists()


def test_without_the_extra_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray_executor, "find_spec", dict[str, object]().get)
    with pytest.raises(PicktreeError) as missing:
        RayExecutor()
    assert str(missing.value) == f"A batch on a Ray cluster needs the extra 'ray': {install_command('ray')}"


def test_ray_is_loaded_in_processes_of_its_own_alone() -> None:
    load = (
        "import sys, picktree.apps.cli.app, picktree.apps.batch.ray_executor; sys.exit('ray' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", load], check=False).returncode == 0


@pytest.mark.slow
def test_nothing_is_left_of_a_batch_that_is_killed_whose_cluster_was_on_the_loopback(tmp_path: Path) -> None:
    short = Path(tempfile.mkdtemp(prefix="t-", dir="/tmp"))  # Ray's sockets have no room in longer paths
    plan = troubled(tmp_path, "once(seed); time.sleep(600)", (0, 1))
    options = ["--mission", str(plan.missions[0]), "--seeds", "0:2", "--backend", "kinematic"]
    options += ["--executor", "ray", "--workers", "2", "--out", str(tmp_path / "batch")]
    batch = subprocess.Popen(
        [sys.executable, "-m", "picktree", "batch", "run", *options], env={**os.environ, "TMPDIR": str(short)}
    )
    try:
        until(lambda: (tmp_path / "tried-0").exists() and (tmp_path / "tried-1").exists())
        everything = below(batch.pid)
        assert {"gcs_server", "raylet", "ray::NodeWorker"} <= {name(pid) for pid in everything}
        assert _listening(everything) == {"127.0.0.1"}
    finally:
        batch.kill()
        batch.wait()
    until(lambda: not alive(everything))
    until(lambda: not list(short.glob("picktree-ray-*")))
    shutil.rmtree(short)


def _listening(pids: set[int]) -> set[str]:
    """IP addresses at which the processes can be reached by TCP."""
    inodes = {
        os.readlink(link) for pid in pids for link in Path(f"/proc/{pid}/fd").iterdir() if link.is_symlink()
    }
    found: set[str] = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and f"socket:[{words[9]}]" in inodes:
                found.add(_ip(words[1].partition(":")[0]))
    return found


def _ip(words: str) -> str:
    """As the kernel writes it: 32-bit words, each in the machine's order."""
    last = bytes.fromhex(words[-8:])[::-1]
    return ".".join(map(str, last))


@pytest.mark.slow
def test_a_node_that_is_lost_costs_its_jobs_one_try(tmp_path: Path, cluster: str, two: RayExecutor) -> None:
    """It comes last: the cluster goes on looking for the node for a minute."""
    two.close()  # its workers would take the CPU of a node that joins
    doing = """
        if once(seed):
            while not (HERE / "go").exists():
                time.sleep(0.05)"""
    plan = troubled(tmp_path, doing, (0, 1, 2))
    with node(cluster, 1) as lost, RayExecutor(2, cluster) as executor:
        all_workers(executor, 2)

        class Killing(Remembering):
            there: frozenset[int] = frozenset()

            def waiting(self) -> None:
                if self.there:
                    if not alive(set(self.there)):
                        (tmp_path / "go").touch()
                elif all((tmp_path / f"tried-{seed}").exists() for seed in (0, 1)):
                    self.there = frozenset(below(lost))
                    os.kill(lost, signal.SIGKILL)

        seen = Killing()
        with Batch.create(tmp_path / "batch", plan) as batch:
            assert batch.run(executor, seen)
            rows = batch.store.query(TABLE).rows
    assert [row[1] for row in rows] == ["success"] * 3
    assert sorted(str(row[4]) for row in rows) == ["1", "1", "2"]
    assert len(seen.again) == 1
    assert seen.again[0].endswith(" is gone")
