"""Slice: a part of the studio with calls, watches and routes over the shared workspace and jobs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from starlette.routing import BaseRoute

from .jobs import Jobs
from .workspace import Workspace


@dataclass(frozen=True)
class Studio:
    """Shared parts of one server, given to each slice."""

    workspace: Workspace
    jobs: Jobs


class Slice:
    """Part of the studio. The page uses its methods that are declared with `call` or `watch`."""

    def routes(self) -> Sequence[BaseRoute]:
        """Return the addresses that it serves over HTTP."""
        return ()

    async def close(self) -> None:
        """Release its resources at the end of the server."""
