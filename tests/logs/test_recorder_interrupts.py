"""Signals come through, but never in the middle of a write."""

import contextlib
import os
import signal

import pytest

from picktree.logs.recording import Interrupts


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_for_the_end_of_a_held_section(number: signal.Signals) -> None:
    done: list[str] = []
    with Interrupts() as interrupts, pytest.raises(KeyboardInterrupt):
        with interrupts.held():
            os.kill(os.getpid(), number)
            done.append("the write is whole")
            with interrupts.held():
                done.append("and what it calls")
        done.append("never reached")
    assert done == ["the write is whole", "and what it calls"]


def test_a_failure_in_a_held_section_goes_before_a_signal() -> None:
    with Interrupts() as interrupts:
        with pytest.raises(ZeroDivisionError), interrupts.held():
            os.kill(os.getpid(), signal.SIGINT)
            _ = 1 / 0
        with pytest.raises(KeyboardInterrupt), interrupts.held():
            pass
        interrupts.settle()
        with interrupts.held():
            pass  # it has been heard


def test_an_interrupt_that_a_library_swallows_comes_again() -> None:
    with Interrupts() as interrupts:
        with contextlib.suppress(KeyboardInterrupt):  # as what a planner in C++ makes of it
            os.kill(os.getpid(), signal.SIGINT)
            signal.pause()
        with pytest.raises(KeyboardInterrupt), interrupts.held():
            pass


def test_outside_of_sections_a_signal_comes_at_once_and_handlers_are_put_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), Interrupts():
        os.kill(os.getpid(), signal.SIGTERM)
        signal.pause()
    assert signal.getsignal(signal.SIGTERM) == before
