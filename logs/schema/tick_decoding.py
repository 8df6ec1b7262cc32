"""Decoding of ticks by their differences: most nodes report the same as in the tick before.

A deep mission has hundreds of nodes, of which a few change in a tick. A log of another form, or another
program, is decoded as a whole.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import compress, count
from operator import ne

from .json_records import decode
from .records import NodeStatusRecord, Tick

_NODES = b',"nodes":[{"path":'
"""Begin of the nodes. No text can hold it: quotation marks in texts are escaped."""
_BETWEEN = b'},{"path":'
_CHANGES = b'}],"writes":['
_CHANGES_OFFSET = len(b"}],")
"""Offset of the changes behind the end of the nodes."""


class TickDecoder:
    """Decoder of one tick after the other, which decodes only the nodes that report something else."""

    def __init__(self) -> None:
        self._texts: list[bytes] = []
        self._nodes: list[NodeStatusRecord] = []

    def tick(self, data: bytes) -> Tick:
        """Return the tick. Raises ValueError when a field is missing or has another type."""
        begin, end = data.find(_NODES), data.rfind(_CHANGES)
        if 0 <= begin < end:
            try:
                rest = decode(Tick, b'%b,"nodes":[],%b' % (data[:begin], data[end + _CHANGES_OFFSET :]))
                return replace(rest, nodes=self._changed(data[begin + len(_NODES) : end].split(_BETWEEN)))
            except ValueError:  # a text of an old or a foreign log, or evidence that looks like nodes
                self._texts = []
        return decode(Tick, data)

    def _changed(self, texts: list[bytes]) -> tuple[NodeStatusRecord, ...]:
        before, self._texts = self._texts, []
        if len(texts) != len(before):
            self._nodes = [_node(text) for text in texts]
        else:
            for number in compress(count(), map(ne, texts, before)):
                self._nodes[number] = _node(texts[number])
        self._texts = texts
        return tuple(self._nodes)


def changes_of(data: bytes) -> Tick:
    """Return the tick without its nodes. Raises ValueError as `TickDecoder.tick` does."""
    begin, end = data.find(_NODES), data.rfind(_CHANGES)
    if 0 <= begin < end:
        try:
            return decode(Tick, b'%b,"nodes":[],%b' % (data[:begin], data[end + _CHANGES_OFFSET :]))
        except ValueError:
            pass
    return replace(decode(Tick, data), nodes=())


def _node(text: bytes) -> NodeStatusRecord:
    return decode(NodeStatusRecord, b'{"path":%b}' % text)
