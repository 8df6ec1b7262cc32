"""MCAP writer whose file on disk is complete at every checkpoint, however the process dies after it.

A checkpoint appends the messages so far as one compressed chunk. Summary and footer follow, with which any
reader opens the file. The next checkpoint overwrites these from the end of the data on.

https://mcap.dev/spec
"""

from __future__ import annotations

import errno
import os
import shutil
import struct
import threading
import time
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from picktree.files import PicktreeError, file_system

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None


MIN_FREE_BYTES = 32_000_000
"""Free bytes that a new log demands: ten minutes of a run."""
_ADVICE = "make room there, or give another folder with --out"


class RawFile(Protocol):
    """Unbuffered binary file: written data is with the operating system at once."""

    def seek(self, offset: int, /) -> int: ...
    def write(self, data: memoryview, /) -> int | None: ...
    def truncate(self, size: int, /) -> int: ...
    def fileno(self) -> int: ...
    def close(self) -> None: ...


def open_raw(path: Path) -> RawFile:
    """Open a new, empty file, and lock it until it is closed, where the system has such locks."""
    file = path.open("w+b", buffering=0)
    if fcntl is not None:
        with suppress(OSError):  # some network disks have none
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    return file


def is_written(path: Path) -> bool:
    """Whether a process that still lives has the file open for writing, as far as locks tell."""
    if fcntl is None:
        return False
    try:
        with path.open("rb") as file:
            fcntl.flock(file.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def require_free_space(path: Path) -> None:
    """Raise PicktreeError when a log at `path` would soon fill the disk."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(path.parent).free
    except OSError as error:
        raise _unwritable(path, error) from None
    if free < MIN_FREE_BYTES:
        raise PicktreeError(
            f"{path}: only {free / 1e6:.1f} MB are free there, and a log begins with "
            f"{MIN_FREE_BYTES / 1e6:.0f} MB of "
            f"room; {_ADVICE}"
        )


class TrailerFile:
    """File of growing data, with an ending behind it that each write replaces.

    An ending is never shorter than the one before, so one write replaces it completely. The file has another
    name until `publish`. After the disk has refused, `failure` holds the error, and the file is closed with
    the ending that it had before.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.end = 0
        """Bytes of data so far; offset of the ending."""
        self.failure: PicktreeError | None = None
        self._ending = b""
        self._hidden: Path | None = path.with_name(file_system.fitted(f"{path.name}.part"))
        self._syncing = threading.Lock()
        self._unsynced = False
        self._refused: OSError | None = None
        self._file: RawFile | None = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open_raw(self._hidden)
        except OSError as error:
            raise _unwritable(path, error) from None

    @property
    def closed(self) -> bool:
        return self._file is None

    @property
    def published(self) -> bool:
        return self._hidden is None

    @property
    def size(self) -> int:
        return self.end + len(self._ending)

    def append(self, data: bytes, ending: bytes) -> None:
        """Append data and replace the ending. Raises PicktreeError when the disk refuses, or has refused
        before."""
        file = self._open()
        try:
            if self._refused is not None:
                raise self._refused
            _write(file, data + ending, self.end)
        except OSError as error:
            raise self._given_up(file, error) from None
        self.end += len(data)
        self._ending = ending
        self._unsynced = True

    def publish(self) -> None:
        """Rename the file to its final name, in place of one that had it before."""
        if self._hidden is None:
            return
        file = self._open()
        try:
            self._hidden.replace(self.path)
        except OSError as error:
            raise self._given_up(file, error) from None
        self._hidden = None

    def sync(self) -> None:
        """Wait until the disk has all that the operating system has. Any thread may call it, also during
        writes."""
        with self._syncing:
            if self._file is None or not self._unsynced:
                return
            self._unsynced = False
            try:
                os.fsync(self._file.fileno())
            except OSError as error:
                self._refused = error  # the next append gives the file up

    def finish(self) -> None:
        """Close the file after the disk has everything."""
        self.sync()
        if self._refused is not None and self._file is not None:
            raise self._given_up(self._file, self._refused) from None
        self.close()

    def close(self) -> None:
        with self._syncing:
            file, self._file = self._file, None
            if file is not None:
                file.close()
        if self._hidden is not None:
            self._hidden.unlink(missing_ok=True)
            self._hidden = None

    def _open(self) -> RawFile:
        if self._file is None:
            raise self.failure or PicktreeError(f"{self.path}: the log is closed")
        return self._file

    def _given_up(self, file: RawFile, error: OSError) -> PicktreeError:
        """Put the old ending back, so that the file opens with its former content, and close it."""
        why = error.strerror or str(error)
        if self._hidden is None:
            self.failure = PicktreeError(
                f"{self.path}: the log cannot be written any further: {why}; it keeps what it held until "
                f"then; {_ADVICE}"
            )
        else:
            self.failure = _unwritable(self.path, error)
        try:
            _write(file, self._ending, self.end)
            file.truncate(self.end + len(self._ending))
        except OSError:
            pass  # the reader recovers the file from its chunks
        self.close()
        return self.failure


def _unwritable(path: Path, error: OSError) -> PicktreeError:
    return PicktreeError(f"{path}: the log cannot be written: {error.strerror or error}; {_ADVICE}")


def _write(file: RawFile, data: bytes, offset: int) -> None:
    file.seek(offset)
    view = memoryview(data)
    while view:
        written = file.write(view)
        if not written:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        view = view[written:]


MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "picktree"
"""Name of the writer in a file's header."""
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_HEAD = 22


class SchemaSource(Protocol):
    """Topic, as far as its channel and schema need it."""

    @property
    def name(self) -> str: ...
    @property
    def schema(self) -> str: ...
    @property
    def encoding(self) -> str: ...
    @property
    def schema_encoding(self) -> str: ...
    def schema_data(self) -> bytes: ...


class McapFile:
    """MCAP file that is being written. Times are ns and never decrease.

    All methods raise PicktreeError when the disk refuses or has refused. They may be called from more than
    one thread.

    A checkpoint is due when `checkpoint` seconds have passed in the messages' time or on the wall, or
    `chunk_bytes` are waiting. The file appears under its name with the first checkpoint.
    """

    def __init__(
        self,
        path: Path,
        *,
        checkpoint: float = 1.0,
        chunk_bytes: int = 4 << 20,
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        self.path = path
        self._disk = TrailerFile(path)
        self._lock = threading.RLock()
        self._interval = checkpoint
        self._chunk_bytes = chunk_bytes
        self._wall = wall
        self._crc = 0
        self._compressor = zstandard.ZstdCompressor(level=1)

        self._chunk = bytearray()
        self._index: dict[int, list[tuple[int, int]]] = {}
        self._chunk_start = self._chunk_end = 0
        self._waiting_since = 0.0
        """Wall time of the oldest message that no checkpoint has brought to disk."""

        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._schema_records = bytearray()
        self._channel_records = bytearray()
        self._chunk_indexes = bytearray()
        self._attachment_indexes = bytearray()
        self._metadata_indexes = bytearray()
        self._statistics = Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0)
        self._append(MAGIC + _bytes(Header(profile="", library=LIBRARY)))

    def channel(self, topic: SchemaSource) -> int:
        """Return the number of the topic's channel; the first call creates it."""
        with self._lock:
            known = self._channels.get(topic.name)
            return known if known is not None else self._new_channel(topic)

    def _new_channel(self, topic: SchemaSource) -> int:
        schema = self._schemas.get(topic.schema)
        if schema is None:
            schema = self._schemas[topic.schema] = len(self._schemas) + 1
            record = _bytes(
                Schema(id=schema, name=topic.schema, encoding=topic.schema_encoding, data=topic.schema_data())
            )
            self._schema_records += record
            self._chunk += record
            self._statistics.schema_count += 1
        number = self._channels[topic.name] = len(self._channels) + 1
        record = _bytes(
            Channel(
                id=number, topic=topic.name, message_encoding=topic.encoding, metadata={}, schema_id=schema
            )
        )
        self._channel_records += record
        self._chunk += record
        self._statistics.channel_count += 1
        self._statistics.channel_message_counts[number] = 0
        return number

    def _chunk_due(self, log_time: int) -> bool:
        return bool(self._index) and (
            log_time - self._chunk_start >= self._interval * 1e9
            or len(self._chunk) >= self._chunk_bytes
            or self._wall() - self._waiting_since >= self._interval
        )

    def message(self, channel: int, log_time: int, data: bytes) -> None:
        with self._lock:
            if self._chunk_due(log_time):
                self._write_chunk()
            if self._disk.closed:
                self._append(b"")  # says why
            if not self._index:
                self._chunk_start = log_time
                self._waiting_since = self._wall()
            statistics = self._statistics
            if statistics.message_count == 0:
                statistics.message_start_time = log_time
            self._index.setdefault(channel, []).append((log_time, len(self._chunk)))
            sequence = statistics.channel_message_counts[channel] + 1
            length = _MESSAGE_HEAD + len(data)
            self._chunk += _MESSAGE.pack(
                Opcode.MESSAGE, length, channel, sequence & 0xFFFFFFFF, log_time, log_time
            )
            self._chunk += data
            self._chunk_end = statistics.message_end_time = log_time
            statistics.message_count += 1
            statistics.channel_message_counts[channel] = sequence

    def lacks(self, channel: int, log_time: int) -> bool:
        """Whether the chunk of a message at this time (ns) would hold no message of the channel before it."""
        with self._lock:
            if self._chunk_due(log_time):
                self._write_chunk()
            return channel not in self._index

    def attachment(self, name: str, media_type: str, data: bytes, log_time: int = 0) -> None:
        record = _bytes(
            Attachment(create_time=0, log_time=log_time, name=name, media_type=media_type, data=data)
        )
        with self._lock:
            self._write_chunk()
            index = AttachmentIndex(
                offset=self._disk.end,
                length=len(record),
                log_time=log_time,
                create_time=0,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
            self._attachment_indexes += _bytes(index)
            self._statistics.attachment_count += 1
            self._append(record)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        record = _bytes(Metadata(name=name, metadata=dict(values)))
        with self._lock:
            self._write_chunk()
            index = MetadataIndex(offset=self._disk.end, length=len(record), name=name)
            self._metadata_indexes += _bytes(index)
            self._statistics.metadata_count += 1
            self._append(record)

    def checkpoint(self) -> None:
        """Bring everything so far into the file, which then opens with it."""
        with self._lock:
            self._write_chunk()
            if not self._disk.published:
                self._append(b"")
                self._disk.publish()

    def keep_up(self, age: float) -> None:
        """Make a checkpoint when a message has been waiting for `age` wall seconds; then sync the file."""
        with self._lock:
            if self._index and self._wall() - self._waiting_since >= age:
                self._write_chunk()
        self._disk.sync()

    def finish(self) -> None:
        """Write what is left and close."""
        with self._lock:
            try:
                if not self.closed:
                    self.checkpoint()
                    self._disk.finish()
            finally:
                self._disk.close()

    @property
    def closed(self) -> bool:
        """Whether the file is finished, or given up because the disk refused."""
        return self._disk.closed

    @property
    def failed(self) -> bool:
        """Whether the disk has refused."""
        return self._disk.failure is not None

    @property
    def size(self) -> int:
        """Bytes on disk."""
        return self._disk.size

    def _write_chunk(self) -> None:
        if not self._index:
            return
        data = bytes(self._chunk)
        packed = self._compressor.compress(data)
        chunk = _bytes(
            Chunk(
                compression="zstd",
                data=packed,
                message_start_time=self._chunk_start,
                message_end_time=self._chunk_end,
                uncompressed_crc=zlib.crc32(data),
                uncompressed_size=len(data),
            )
        )
        start = self._disk.end
        indexes = bytearray()
        offsets: dict[int, int] = {}
        for channel, entries in self._index.items():
            offsets[channel] = start + len(chunk) + len(indexes)
            indexes += _bytes(MessageIndex(channel_id=channel, records=entries))
        index = ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=start,
            compression="zstd",
            compressed_size=len(packed),
            message_end_time=self._chunk_end,
            message_index_length=len(indexes),
            message_index_offsets=offsets,
            message_start_time=self._chunk_start,
            uncompressed_size=len(data),
        )
        self._chunk_indexes += _bytes(index)
        self._statistics.chunk_count += 1
        self._append(chunk + indexes)
        self._chunk.clear()
        self._index.clear()

    def _append(self, data: bytes) -> None:
        """Put `data` where the data section ends now, and the ending of the file behind it."""
        crc = zlib.crc32(data, self._crc)
        self._disk.append(data, self._ending(self._disk.end + len(data), crc))
        self._crc = crc

    def _ending(self, start: int, crc: int) -> bytes:
        """DataEnd, summary, footer and magic of a file whose data section ends at `start`."""
        head = _bytes(DataEnd(data_section_crc=crc))
        summary_start = start + len(head)
        summary, offsets = bytearray(), bytearray()
        for opcode, group in (
            (Opcode.SCHEMA, self._schema_records),
            (Opcode.CHANNEL, self._channel_records),
            (Opcode.STATISTICS, _bytes(self._statistics)),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.ATTACHMENT_INDEX, self._attachment_indexes),
            (Opcode.METADATA_INDEX, self._metadata_indexes),
        ):
            if group:
                offsets += _bytes(SummaryOffset(opcode, summary_start + len(summary), len(group)))
                summary += group
        offsets_start = summary_start + len(summary)
        summary += offsets
        # The footer's check sum covers the footer up to itself.
        footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 20, summary_start, offsets_start)
        footer = Footer(summary_start, offsets_start, zlib.crc32(footer_head, zlib.crc32(summary)))
        return head + bytes(summary) + _bytes(footer) + MAGIC


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()
