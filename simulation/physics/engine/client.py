"""A pybullet client of one's own: a world apart from any other in the process."""

from __future__ import annotations

import weakref

from .pybullet_import import pb


class Client:
    """Closed when the last user is gone, or by `close`. pybullet has 1024 at most."""

    def __init__(self) -> None:
        self.id = pb.connect(pb.DIRECT)
        self.close = weakref.finalize(self, _disconnect, self.id)


def _disconnect(client: int) -> None:
    if pb.isConnected(client):
        pb.disconnect(client)
