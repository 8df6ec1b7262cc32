"""picktree: declarative behaviour-tree skills for robot arms that sort many items for hours."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from .logs.result import RunResult

    __version__: str

__all__ = ["__version__", "run"]


def run(
    mission: str | Path,
    *,
    scene: str | None = None,
    seed: int = 0,
    parameters: Mapping[str, str] | None = None,
    faults: str | Path | None = None,
    out: str | Path | None = None,
    backend: Literal["physics", "kinematic"] = "physics",
    verify: bool = False,
) -> RunResult:
    """Run a mission as `picktree run` does, and say what came of it. Raises PicktreeError for bad input."""
    from .logs.session import RunRequest, Session

    request = RunRequest(
        mission=Path(mission),
        scene=scene,
        seed=seed,
        parameters=dict(parameters or {}),
        faults=None if faults is None else Path(faults),
        out=None if out is None else Path(out),
        backend=backend,
        verify=verify,
    )
    return Session(request).run()


def __getattr__(name: str) -> str:
    if name == "__version__":
        from importlib.metadata import version

        return version("picktree")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
