"""Process that computes for the studio's pages."""

from __future__ import annotations

import asyncio
import os
import threading
import time

import pytest

from picktree.studio.missions.worker import Worker


async def close_with_cancelled_requests() -> None:
    worker = Worker()
    assert await worker.run(len, "abc") == 3
    waiting = [asyncio.create_task(worker.run(time.sleep, 60.0)) for _ in range(5)]
    await asyncio.sleep(0.2)
    for each in waiting:
        each.cancel()
    await asyncio.gather(*waiting, return_exceptions=True)
    await asyncio.sleep(0.1)  # the pool hears of it
    await worker.close()


def test_it_ends_in_silence_when_requests_were_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    kill, failed = os.kill, list[threading.ExceptHookArgs]()

    def kill_and_be_slow(pid: int, number: int) -> None:
        kill(pid, number)
        time.sleep(0.2)

    monkeypatch.setattr(os, "kill", kill_and_be_slow)
    monkeypatch.setattr(threading, "excepthook", failed.append)
    before = set(threading.enumerate())
    asyncio.run(close_with_cancelled_requests())
    for each in set(threading.enumerate()) - before:
        each.join(30.0)
    assert not failed
