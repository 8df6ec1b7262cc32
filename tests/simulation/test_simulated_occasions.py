"""Times of faults: at each start, at intervals, by chance; and faults of the program itself."""

from __future__ import annotations

from collections.abc import Callable, Generator
from pathlib import Path

import pytest

from picktree.simulation import FaultInjector, FaultState, new_states, parse_faults
from picktree.simulation.fault_entries import AtNode, AtTime, FaultFile, Stall
from picktree.simulation.fault_injector import DueFault, FaultSchedule
from picktree.simulation.kinematic import KinematicHardware

from .simulated_cell import cell, panda


def faults(*entries: str) -> FaultFile:
    text = "picktree: 1\nkind: faults\nfaults:\n" + "".join(f"  - {{{entry}}}\n" for entry in entries)
    return parse_faults(text, Path("faults.yaml"))


def test_each_start_counts_from_the_one_that_is_named() -> None:
    occasions, stall = FaultSchedule(1), Stall(AtNode("Grasp", start=2, delay=0.5, each=True))
    state = FaultState()
    for now in (1.0, 2.0, 3.0):
        state = occasions.node_started(0, stall, state, "Main/Grasp", now)
    assert state.dues == (DueFault(2.5, "Main/Grasp"), DueFault(3.5, "Main/Grasp"))
    state = occasions.taken(0, stall, state, 2.5)
    assert (state.dues, state.starts, state.done) == ((DueFault(3.5, "Main/Grasp"),), 3, False)
    once = occasions.node_started(0, Stall(AtNode("Grasp")), FaultState(), "Main/Grasp", 1.0)
    assert occasions.taken(0, Stall(AtNode("Grasp")), once, 1.0).done


def test_again_and_again_leaves_out_what_it_waited_through() -> None:
    occasions, stall = FaultSchedule(1), Stall(AtTime(10.0, every=30.0))
    state = occasions.begun(0, stall)
    assert state.due == 10.0
    assert occasions.taken(0, stall, state, 10.0).due == 40.0
    assert occasions.taken(0, stall, state, 95.0).due == 100.0
    assert occasions.begun(0, stall, since=50.0).due == 70.0
    assert occasions.begun(0, Stall(AtTime(3.0)), since=3.0).done


def test_a_chance_is_drawn_by_seed_and_number_and_by_nothing_else() -> None:
    stall = Stall(AtNode("Grasp", each=True), probability=0.3)

    def taken(seed: int, number: int, starts: int = 400) -> list[int]:
        occasions, state, found = FaultSchedule(seed), FaultState(), list[int]()
        for n in range(starts):
            state = occasions.node_started(number, stall, state, "Grasp", float(n))
            if state.dues:
                found.append(n)
                state = occasions.taken(number, stall, state, float(n))
        return found

    assert taken(1, 0) == taken(1, 0)
    assert taken(1, 0, 100) == [n for n in taken(1, 0) if n < 100]
    assert len({tuple(taken(1, 0)), tuple(taken(1, 1)), tuple(taken(2, 0))}) == 3
    assert 90 < len(taken(1, 0)) < 150
    rare = Stall(AtNode("Grasp"), probability=1e-9)
    never = FaultSchedule(1).node_started(0, rare, FaultState(), "Grasp", 1.0)
    assert (never.done, never.dues) == (True, ())


def test_what_ifs_keep_the_faults_that_stand_in_the_same_place() -> None:
    before = faults(
        "fault: stall, when: {at: 5, every: 10 s}, probability: 50 %", "fault: kill, when: {at: 99}"
    )
    reached = (FaultState(due=65.0, chances=9), FaultState(due=99.0))
    after = faults(
        "fault: stall, when: {at: 5, every: 10 s}, probability: 50 %", "fault: wrench_dead, when: {at: 20}"
    )
    assert new_states(after, 1, 62.0, (before, reached)) == (
        reached[0],
        FaultState(due=20.0, done=True, chances=1),
    )
    assert new_states(None, 1, 62.0, (before, reached)) == ()


class Skills:
    """A program with one skill."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.runs: str | None = path
        self.bodies: list[Generator[None, None, None]] = []

    def acting(self, path: str = "") -> str | None:
        return self.runs

    def stand_in(self, path: str, body: Callable[[], Generator[None, None, None]]) -> bool:
        if path != self.path:
            return False
        self.bodies.append(body())
        return True


def test_a_skill_hangs_or_raises_from_its_start_on() -> None:
    skills, hardware = Skills("Main/SortOne/Grasp"), KinematicHardware(cell(), panda(), 1)
    file = faults("fault: hang, when: {node: Grasp}", "fault: raise, when: {node: SortOne}")
    injector = FaultInjector(file, hardware, program=lambda: skills)
    injector.node_started("Main/SortOne")
    injector.node_started("Main/SortOne/Grasp")
    assert [next(skills.bodies[0]) for _ in range(3)] == [None] * 3
    happened = injector.tick()
    assert [h.message for h in happened] == [
        "the code of Grasp hangs",
        "the code of Grasp raises an exception",
    ]
    with pytest.raises(RuntimeError, match="the skill's code cannot go on"):
        next(skills.bodies[1])
    assert injector.tick() == ()


def test_a_node_that_has_ended_before_cannot_hang_and_none_that_runs_is_waited_for() -> None:
    skills, hardware = Skills("Main/Grasp"), KinematicHardware(cell(), panda(), 1)
    file = faults("fault: hang, when: {node: Grasp, delay: 10 ms}", "fault: raise, when: {at: 0}")
    injector = FaultInjector(file, hardware, program=lambda: skills)
    skills.runs = ""
    injector.node_started("Main/Grasp")
    for _ in range(12):
        hardware.step()
    assert injector.tick() == ()
    skills.runs = None
    assert [h.message for h in injector.tick()] == [
        "hang: the node had ended before",
        "raise: the node had ended before",
    ]


def test_a_process_is_killed_a_tick_after_the_record_says_so_and_not_by_a_repetition() -> None:
    hardware, killed = KinematicHardware(cell(), panda(), 1), list[float]()
    injector = FaultInjector(
        faults("fault: kill, when: {at: 0}"), hardware, kill=lambda: killed.append(hardware.clock.now)
    )
    assert [h.message for h in injector.tick()] == ["the process is killed"]
    saved = injector.state()
    assert killed == []
    assert (injector.tick(), killed) == ((), [0.0])
    again = FaultInjector(faults("fault: kill, when: {at: 0}"), hardware, kill=lambda: killed.append(9.0))
    again.restore(saved)
    assert (again.tick(), killed) == ((), [0.0])
    repeated = FaultInjector(faults("fault: kill, when: {at: 0}"), hardware)
    assert [h.message for h in (*repeated.tick(), *repeated.tick())] == ["the process is killed"]


def test_slipping_waits_for_something_in_the_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    hardware = KinematicHardware(cell(), panda(), 1)
    injector = FaultInjector(faults("fault: slip, when: {at: 0}, lasts: 100 ms"), hardware)
    assert injector.tick() == ()
    item = hardware.truth()[0].id
    monkeypatch.setattr(hardware, "in_hand", lambda: item)
    assert [h.message for h in injector.tick()] == ["item_00 slips: its friction is 0 for 0.1 s"]
    assert hardware.bodies[item].friction == 0.0
    for _ in range(24):
        hardware.step()
    assert [h.message for h in injector.tick()] == ["item_00 has its own friction again"]
    assert hardware.bodies[item].friction == 0.6


def test_what_becomes_larger_or_appears_waits_for_room() -> None:
    hardware = KinematicHardware(cell(), panda(), 1)
    first, before = hardware.truth()[0], len(hardware.truth())
    x, y, _ = first.pose.position
    injector = FaultInjector(
        faults(
            f"fault: appear, when: {{at: 0}}, kind: can, colour: red, place: [{x}, {y}]",
            "fault: larger, when: {at: 0}, target: {index: 0}, factor: 20",
            "fault: appear, when: {at: 0}, kind: can, colour: red, place: [7, 0]",
            "fault: larger, when: {at: 0}, target: {index: 0}, factor: 1.1",
            "fault: heavier, when: {at: 0}, target: {index: 0}, mass: 2",
        ),
        hardware,
    )
    assert [h.message for h in injector.tick()] == [
        "a red can waits until nothing is in its place",
        "item_00 waits for room to be larger",
        "a red can does not appear: nothing is below (7.000, 0.000)",
        "item_00 is 1.1 times as large now",
        "item_00 weighs 2 kg now",
    ]
    assert injector.tick() == ()
    hardware.remove("item_00")
    assert [h.message for h in injector.tick()][:1] == [f"item_10, a red can, appears at ({x:.3f}, {y:.3f})"]
    assert len(hardware.truth()) == before + 1
