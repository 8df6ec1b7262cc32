"""Answer of a command of picktree that runs in a process of its own."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ...files.errors import PicktreeError


async def command_answer(
    words: Sequence[str],
    patience: float,
    *,
    text: str = "",
    folder: Path | None = None,
    codes: tuple[int, ...] = (0,),
) -> bytes:
    """Run `picktree WORDS` and return what it prints. Cancelling kills its process group.

    patience: s. text: its standard input. folder: where it runs. codes: exit codes of success. Raises
    PicktreeError with what the command said when it failed, or when it takes longer than `patience`.
    """
    name = " ".join(words[:2])
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-P", "-m", "picktree", *words,
        cwd=folder,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
        env={**os.environ, "PYTHONSAFEPATH": "1"},
    )  # fmt: skip
    try:
        out, errors = await asyncio.wait_for(process.communicate(text.encode()), patience)
    except TimeoutError:
        raise PicktreeError(f"{name} took longer than {patience:.0f} s") from None
    finally:
        if process.returncode is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            await process.wait()
    if process.returncode not in codes:
        said = errors.decode("utf-8", "replace").strip()[-2000:]
        raise PicktreeError(said or f"picktree {name} failed")
    return out
