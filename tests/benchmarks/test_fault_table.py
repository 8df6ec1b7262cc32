"""What each column of the fault campaign's table counts, on a made-up batch."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from picktree.apps.batch import RESULTS_FILE, Job, JobRow, Store
from picktree.apps.batch.plan import Variant
from picktree.apps.batch.tables import JobRows
from picktree.simulation.fault_entries import FaultExpectation

Program = Callable[[str], ModuleType]

SLIP = """\
picktree: 1
kind: faults
expect: {causes: [grasp.*], roots: [item.*], lost: 0}
faults: [{fault: slip, when: {at: 1 s}}]
"""
VANISH = """\
picktree: 1
kind: faults
expect: {causes: [grasp.missed], roots: [item.gone], lost: 1}
faults: [{fault: remove, when: {at: 1 s}, target: {index: 0}}]
"""
KILL = """\
picktree: 1
kind: faults
expect: {causes: [], lost: 0}
faults: [{fault: kill, when: {at: 1 s}}]
"""


def _row(status: str, sorted_: int | None, message: str = "") -> JobRows:
    known = sorted_ is not None
    return JobRows(
        JobRow(
            status=status,  # type: ignore[arg-type]
            message=message,
            digest="",
            attempts=1,
            items_total=4 if known else None,
            items_sorted=sorted_,
            items_misplaced=0 if known else None,
            items_left=4 - sorted_ if sorted_ is not None else None,
            picks_tried=4,
            picks_held=4,
            sim_seconds=20.0 if known else None,
            cpu_seconds=5.0,
            wall_seconds=5.0,
            last_tick=None,
        )
    )


@pytest.fixture
def made_up(tmp_path: Path, program: Program) -> Path:
    """A batch of eight jobs, all measured already but one that has no log."""
    measures, failed = program("_fault_measures"), program("_fault_measures").Failed
    files = {"slip": SLIP, "vanish": VANISH, "kill": KILL}
    for name, text in files.items():
        (tmp_path / f"{name}.yaml").write_text(text)
    none: list[tuple[float, str]] = []
    explains = program("_campaign").explaining()
    roots = {
        ("slip", 0): ("item.slipped", "joint.weak"),
        ("slip", 1): ("item.slipped",),
        ("slip", 2): ("joint.weak", "item.slipped"),
        ("vanish", 0): ("item.gone",),
    }
    told: tuple[tuple[str, int, str, int | None, float | None, list[tuple[float, str]], float, str], ...] = (
        # fault, seed, status, sorted, when it struck, failures after and before, force, message
        ("slip", 0, "success", 4, 2.0, [(2.5, "grasp.slipped"), (3.0, "control.tracking")], 20.0, ""),
        ("slip", 1, "success", 4, 2.0, [(1.0, "control.tracking")], 61.0, ""),  # absorbed
        ("slip", 2, "incomplete", 3, 2.0, [(1.0, "grasp.missed"), (2.0, "control.tracking")], 30.0, ""),
        ("slip", 3, "timeout", 2, None, [(5.0, "grasp.missed")], 10.0, ""),  # it never struck
        ("slip", 4, "crashed", None, None, none, 0.0, "its process was ended by SIGSEGV"),
        ("vanish", 0, "incomplete", 3, 2.0, [(2.5, "grasp.slipped")], 10.0, ""),
        ("kill", 0, "crashed", None, None, none, 0.0, "its process was ended by SIGKILL, from outside"),
    )  # fmt: skip
    jobs = [
        Job(
            f"job{number}",
            number,
            Variant(Path("/sort_tirelessly.yaml"), None, tmp_path / f"{fault}.yaml", {}, fault),
            seed,
            "recipe",
        )
        for number, (fault, seed, *_) in enumerate(told)
    ]
    jobs.append(Job("calm", len(jobs), Variant(Path("/sort_plainly.yaml"), None, None, {}, "none"), 0, "r"))
    known = measures.Measured(tmp_path / "measures.jsonl")
    with Store.create(tmp_path / RESULTS_FILE, jobs) as store:
        for job, (fault, seed, status, done, struck, failures, force, message) in zip(
            jobs, told, strict=False
        ):
            store.record(job.id, _row(status, done, message))
            if fault != "kill":
                known.add(
                    measures.Measure(
                        job.id, fault, True, seed, status, message, struck,
                        failures=tuple(failed(time, "Main", cause, "cured") for time, cause in failures),
                        total=None if done is None else 4, sorted=done, seconds=20.0, force=force,
                        beyond=(measures.Beyond("workspace", 0.02, 0.03),) if seed == 1 else
                        (measures.Beyond("joint_limit", 0.02, 0.01),) if seed == 2 else (),
                        roots=roots.get((fault, seed), ()), explains=explains,
                    )
                )  # fmt: skip
        store.record("calm", _row("success", 4))
    place = tmp_path / "killed" / "job6"
    place.mkdir(parents=True)
    (place / "told.json").write_text('{"ended": -9, "result": null}')
    return tmp_path


def test_the_table_of_a_made_up_batch(made_up: Path, program: Program) -> None:
    campaign, text = program("fault_campaign"), program("_fault_table").to_text
    rows = campaign.read(made_up)
    lines = campaign.table(rows, campaign.measure(rows, made_up))
    slip, vanish, kill, calm, everything, _ = lines
    assert (slip.runs, slip.took_effect, slip.detected, slip.reported) == (5, 3, 2, 1)
    assert (slip.to_explain, slip.right) == (2, 1)  # of the absorbed one nothing is to be explained
    assert slip.first_roots == {"item.slipped": 1, "joint.weak": 1}
    assert (slip.absorbed, slip.absorbed_sorted, slip.absorbed_sortable) == (1, 4, 4)
    assert (slip.finished, slip.sorted, slip.sortable) == (3, 13, 20)  # the crashed run has sorted none of 4
    assert (slip.crashed, slip.hung, slip.crossed, slip.beyond) == (1, 1, 2, 1)
    assert (slip.worst_force, slip.above_force) == (61.0, 1)
    assert slip.first_causes == {"grasp.slipped": 1, "control.tracking": 1}
    assert (vanish.sorted, vanish.sortable, vanish.detected) == (3, 3, 1)
    assert (vanish.reported, vanish.to_explain, vanish.right) == (0, 1, 1)
    assert (kill.killed, kill.crashed, kill.took_effect, kill.sorted, kill.sortable) == (1, 0, 1, 0, 4)
    assert (calm.fault, calm.recovery, calm.took_effect, calm.sorted) == ("none", False, 0, 4)
    assert (everything.fault, everything.runs) == ("all faults", 7)
    assert program("_fault_table").total(lines, True) == everything  # a total counts no totals
    assert (everything.sorted, everything.sortable) == (16, 27)
    assert " ".join(text([vanish]).splitlines()[1].split()) == (
        "vanish with 1/1 1/1 (21…100 %) 0/1 (0…79 %) 1/1 (21…100 %) 0 1/1 (21…100 %) 3/3 (44…100 %) "
        "10 N 0 (0) 0, 0 20"
    )


def test_a_killed_run_that_nobody_took_up_is_lost_and_no_crash(made_up: Path, program: Program) -> None:
    campaign = program("fault_campaign")
    measures = campaign.measure(campaign.read(made_up), made_up)
    killed = next(one for one in measures if one.fault == "kill")
    assert (killed.killed, killed.crashed, killed.finished, killed.resumed) == (True, False, False, False)


def test_the_targets_are_of_the_runs_with_recovery_and_a_fault(made_up: Path, program: Program) -> None:
    campaign = program("fault_campaign")
    rows = campaign.read(made_up)
    found = program("_fault_page").targets(campaign.table(rows, campaign.measure(rows, made_up)))
    assert [target.to_text() for target in found] == [
        "MISSED  no crash: 1 in 7 runs",
        "MISSED  no hang: 1 in 7 runs",
        "MISSED  no limit of the monitor exceeded by more than the stopping distance: 1 in 7 runs",
        "MISSED  at least 97 % of the sortable items sorted: 16 of 27 (59.3 %, 40.7 … 75.5 %)",
        "MISSED  the right cause in at least 95 %: 2 of 4 (50.0 %, 15.0 … 85.0 %)",
    ]


def test_a_cause_is_right_by_name_or_by_family(program: Program) -> None:
    is_right = program("_fault_table").is_right
    assert is_right("grasp.slipped", FaultExpectation(("grasp.*",)))
    assert not is_right("grasp.slipped", FaultExpectation(("grasp.missed", "control.*")))
    assert not is_right("grasp.slipped", FaultExpectation(()))


def test_a_limit_may_be_exceeded_by_what_braking_needs(program: Program) -> None:
    """A joint that crosses its limit at 0.4 rad/s, and stands a tick later or goes on."""
    cell = program("_fault_measures").Cell.of("sort_small")
    exceeded = program("_fault_measures").exceeded
    model = cell.model
    at_home = model.named("home")
    speed, braking = 0.4, float(model.acceleration_limit[0])
    for beyond, fine in ((0.01, True), (0.2, False)):
        positions = np.tile(at_home, (3, 1))
        positions[1, 0], positions[2, 0] = model.upper[0] - 0.005, model.upper[0] + 0.01 + beyond
        velocities = np.zeros_like(positions)
        velocities[1, 0] = speed
        found = {each.limit: each for each in exceeded(model, cell.limits, positions, velocities)}
        joint = found["joint_limit"]
        assert joint.most == pytest.approx(beyond)
        assert joint.allowed == pytest.approx(speed**2 / (2 * braking) + speed * 0.05)
        assert (joint.most <= joint.allowed) is fine
    assert not list(exceeded(model, cell.limits, np.tile(at_home, (3, 1)), np.zeros((3, model.n))))
