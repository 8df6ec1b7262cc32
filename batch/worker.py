"""The worker's side: one process that carries out one order after the other."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import traceback
from multiprocessing.connection import Connection

from ..logs.resimulation.recipe_file import RecipeFile
from ..logs.session import Session
from ..world.errors import PicktreeError
from .executor import Event, Failed, Finished, Order, Stopped
from .harvest import harvest

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
"""What tells the numerical libraries how many threads they may start."""
READY = "ready"
"""What a worker says once it has loaded all that it needs; its time counts from then."""
_PR_SET_PDEATHSIG = 1


def serve(orders: Connection) -> None:
    """Carry out what comes, until the other side is closed."""
    _die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the batch to deal with
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # outside of a run there is nothing to break off
    orders.send(READY)
    while True:
        try:
            order: Order = orders.recv()
        except EOFError:
            return
        orders.send(carry_out(order))


def carry_out(order: Order) -> Event:
    """Run it and write the result's rows. Never raises for what a run does."""
    try:
        order.folder.mkdir(parents=True, exist_ok=True)
        with RecipeFile(order.recipe) as kept:
            session = Session(kept.recipe(order.seed), out=order.folder)
            result = session.run()
            if result.status == "interrupted":
                return Stopped(order)
            rows = harvest(session, result.folder, order.attempt)
        _write_whole(order, rows.to_json())
    except KeyboardInterrupt:
        return Stopped(order)
    except PicktreeError as error:
        return Failed(order, str(error))
    except Exception as error:  # noqa: BLE001 - one job's fault must not cost another
        traceback.print_exc(file=sys.stderr)
        return Failed(order, f"{type(error).__name__}: {error}")
    return Finished(order)


def _write_whole(order: Order, data: bytes) -> None:
    beside = order.result.with_suffix(".part")
    try:
        with beside.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(order.result)
    except OSError as error:
        raise PicktreeError(f"{order.result}: the result cannot be written: {error.strerror}") from None


def _die_with_parent() -> None:
    """A worker whose batch is gone has nobody to answer to. Linux only; elsewhere it ends after its job."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
