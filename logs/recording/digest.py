"""Digest of a run: a hash that is equal exactly when the same was simulated."""

from __future__ import annotations

import hashlib


class Digest:
    """SHA-256 chain over (topic, time, payload). The link is its complete state."""

    def __init__(self, link: bytes = bytes(32)) -> None:
        self._link = link

    def add(self, topic: str, time: int, payload: bytes) -> None:
        """Add a message; `time` in simulated ns."""
        name = topic.encode()
        head = len(name).to_bytes(2, "little") + name + time.to_bytes(8, "little")
        self._link = hashlib.sha256(self._link + head + payload).digest()

    @property
    def hex(self) -> str:
        return self._link.hex()
