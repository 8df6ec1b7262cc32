"""The fingerprint of a run: one number that is the same exactly when the same was simulated."""

from __future__ import annotations

import hashlib


class Digest:
    """A chain of SHA-256 over (topic, time, payload). The link is all the state that it has."""

    def __init__(self, link: bytes = bytes(32)) -> None:
        self._link = link

    def add(self, topic: str, time: int, payload: bytes) -> None:
        """`time` in simulated ns."""
        name = topic.encode()
        head = len(name).to_bytes(2, "little") + name + time.to_bytes(8, "little")
        self._link = hashlib.sha256(self._link + head + payload).digest()

    @property
    def hex(self) -> str:
        return self._link.hex()
