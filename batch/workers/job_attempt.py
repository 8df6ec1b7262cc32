"""One try at a job: the run, and the rows that are taken from it."""

from __future__ import annotations

import os
import re
import sys
import tempfile
import traceback

from ...errors import PicktreeError
from ...session.resume.recipe_archive import RecipeFile
from ...session.session import Session
from . import job_output as output
from .executor import Event, Failed, Finished, Order, Stopped
from .result_rows import harvest


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
    except SystemExit as end:
        return Failed(order, f"it called sys.exit({end.code!r})")
    except PicktreeError as error:
        print(error, file=sys.stderr)
        return Failed(order, _one_line(str(error)))
    except BaseException as error:  # noqa: BLE001 - one job's fault must not cost another
        traceback.print_exc(file=sys.stderr)
        said = _one_line(str(error))
        place = output.place_of(error)
        return Failed(order, f"{type(error).__name__}{f': {said}' if said else ''}, at {place}")
    return Finished(order)


def _one_line(text: str) -> str:
    """The first, without the place to which a recipe was unpacked."""
    unpacked = rf"{re.escape(tempfile.gettempdir())}/picktree-[^/]+/"
    return re.sub(unpacked, "", text.strip().partition("\n")[0])


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
