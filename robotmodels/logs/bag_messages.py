"""Messages of bags of ROS 1 and 2, bare databases of ROS 2 and MCAP, in the order of the file."""

import io
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from struct import Struct
from typing import Any, BinaryIO, NamedTuple

from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress
from robotmodels.logs.message_types import (
    JsonType,
    MessageType,
    RosType,
    defined_type,
    full_name,
    register,
    standard_types,
)
from robotmodels.logs.optional_library import optional_library

_EVERY = 1000  # messages, from one report of progress to the next
_COUNT = Struct("<I")
_TIME = Struct("<II")
_MCAP_RECORD = Struct("<BQ")
_MCAP_MESSAGE = Struct("<HIQQ")
_MCAP_MESSAGE_RECORD = 5
_MCAP_DEFINITIONS = {3: "Schema", 4: "Channel"}
_SECOND = 1_000_000_000
_CUT_OFF = "it was cut off; what came before was read"
_BAG_1 = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = b"\x02", b"\x05", b"\x07"


class Message(NamedTuple):
    """A message as it was recorded, its time in nanoseconds."""

    topic: str
    log_time: int
    raw: bytes
    type: MessageType


def bag_messages(path: Path, notes: dict[str, str], progress: Progress | None) -> Iterator[Message]:
    """Yield the messages of a bag, a bare database or an MCAP file; notes on topics go to `notes`.

    `progress` is called with what is done and the total, in bytes or messages.
    """
    read = {".mcap": _mcap_messages, ".db3": _database_messages, ".bag": _bag_1_messages}
    report = progress or (lambda done, total: None)
    yield from read.get(path.suffix.lower(), _folder_messages)(path, notes, report)


def _folder_messages(path: Path, notes: dict[str, str], progress: Progress) -> Iterator[Message]:
    """Yield the messages of a folder of ROS 2."""
    highlevel = optional_library("rosbags.highlevel", f"{path}: a bag")
    types: dict[str, RosType] = {}
    with highlevel.AnyReader([path], default_typestore=standard_types()) as reader:
        total = sum(each.message_count for each in reader.readers)
        for count, (connection, time, raw) in enumerate(reader.messages()):
            kind = connection.msgtype
            if kind not in types:
                types[kind] = RosType(reader.typestore, kind, cdr=True)
            yield Message(connection.topic, time, raw, types[kind])
            if count % _EVERY == 0:
                progress(count, total)


def _bag_1_messages(path: Path, notes: dict[str, str], progress: Progress) -> Iterator[Message]:
    """Yield the messages of a bag of ROS 1 chunk by chunk.

    Libraries hold an index of all messages in memory, and refuse bags whose recording was cut off.
    """
    reader = optional_library("rosbags.rosbag1.reader", f"{path}: a bag")
    connections: dict[bytes, tuple[str, RosType]] = {}
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(len(_BAG_1)) != _BAG_1:
            raise InvalidInput(f"{path}: no bag of ROS 1, version 2.0")
        for header, data in _bag_1_records(file, notes):
            operation = header.get(b"op")
            if operation == _CHUNK:
                content = reader.decompressors[header[b"compression"].decode()](data)
                records = list(_bag_1_records(io.BytesIO(content), notes))
                yield from _of_connections(records, connections)
                progress(file.tell(), size)
            elif operation in (_CONNECTION, _MESSAGE):
                yield from _of_connections([(header, data)], connections)


def _of_connections(
    records: list[tuple[dict[bytes, bytes], bytes]],
    connections: dict[bytes, tuple[str, RosType]],
) -> Iterator[Message]:
    """Yield the messages of a chunk in the order of their times, connections noted."""
    messages = []
    for header, data in records:
        number = header.get(b"conn", b"")
        if header[b"op"] == _CONNECTION and number not in connections:
            about = _bag_1_fields(data)
            name, definition = about[b"type"].decode(), about[b"message_definition"].decode()
            kind = defined_type(name, definition, cdr=False)
            connections[number] = header[b"topic"].decode(), kind
        elif header[b"op"] == _MESSAGE:
            seconds, nanoseconds = _TIME.unpack(header[b"time"])
            topic, kind = connections[number]
            messages.append(Message(topic, seconds * _SECOND + nanoseconds, data, kind))
    yield from sorted(messages, key=lambda message: message.log_time)


def _bag_1_records(
    stream: BinaryIO, notes: dict[str, str]
) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    """Yield header and data of records; one that is cut off ends a file."""
    while len(head := stream.read(4)) == 4:
        header = stream.read(_COUNT.unpack(head)[0])
        (size,) = _COUNT.unpack(stream.read(4).ljust(4, b"\0"))
        if len(data := stream.read(size)) < size:
            notes["end"] = _CUT_OFF
            return
        yield _bag_1_fields(header), data


def _bag_1_fields(text: bytes) -> dict[bytes, bytes]:
    fields, offset = {}, 0
    while offset + 4 <= len(text):
        end = offset + 4 + _COUNT.unpack_from(text, offset)[0]
        name, _, value = text[offset + 4 : end].partition(b"=")
        fields[name], offset = value, end
    return fields


def _database_messages(path: Path, notes: dict[str, str], progress: Progress) -> Iterator[Message]:
    """Yield the messages of a .db3 file without its metadata, which rosbags refuses."""
    store = standard_types()
    address = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as database:
        tables = {row[0] for row in database.execute("select name from sqlite_master")}
        if "message_definitions" in tables:
            rows = (
                "select topic_type, encoding, encoded_message_definition from message_definitions"
            )
            for kind, encoding, text in database.execute(rows):
                if encoding == "ros2msg":
                    register(store, kind, text)
        topics = {
            number: (name, RosType(store, kind, cdr=True))
            for number, name, kind in database.execute("select id, name, type from topics")
        }
        ((total,),) = database.execute("select count(*) from messages")
        order = "select topic_id, timestamp, data from messages order by timestamp, id"
        for count, (number, time, raw) in enumerate(database.execute(order)):
            name, kind = topics[number]
            if kind.kind in store.types:
                yield Message(name, time, raw, kind)
            else:
                notes[name] = f"topic {name}: its type {kind.kind} is not defined in the file"
            if count % _EVERY == 0:
                progress(count, total)


def _mcap_messages(path: Path, notes: dict[str, str], progress: Progress) -> Iterator[Message]:
    """Yield messages chunk by chunk, without the summary at the end: recordings may be cut off."""
    streams = optional_library("mcap.stream_reader", f"{path}: MCAP")
    exceptions = optional_library("mcap.exceptions", f"{path}: MCAP")
    records = optional_library("mcap.records", f"{path}: MCAP")
    channels = _McapChannels(notes)
    size = path.stat().st_size
    with path.open("rb") as file:
        try:
            for record in streams.StreamReader(file, emit_chunks=True).records:
                if isinstance(record, records.Chunk) and file.tell() < size:  # else it was cut
                    stream, length = streams.get_chunk_data_stream(record)
                    yield from channels.messages(stream.read(length))
                    progress(file.tell(), size)
                elif isinstance(record, records.Message):
                    yield from channels.message(record.channel_id, record.log_time, record.data)
                else:
                    channels.define(record)
        except (exceptions.EndOfFile, struct.error):
            if file.tell() < size:
                raise
            notes["end"] = _CUT_OFF


class _McapChannels:
    """Channels of an MCAP file as far as they were defined."""

    def __init__(self, notes: dict[str, str]) -> None:
        self._records = optional_library("mcap.records", "MCAP")
        self._streams = optional_library("mcap.data_stream", "MCAP")
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, tuple[str, MessageType | None]] = {}
        self._notes = notes

    def define(self, record: Any) -> None:
        """Note a schema or a channel; other records are passed over."""
        if isinstance(record, self._records.Schema):
            self._schemas[record.id] = record
        elif isinstance(record, self._records.Channel) and record.id not in self._channels:
            self._channels[record.id] = record.topic, self._type(record)

    def message(self, number: int, log_time: int, raw: bytes) -> Iterator[Message]:
        """Yield a message, none where its channel is not read."""
        topic, kind = self._channels[number]
        if kind is not None:
            yield Message(topic, log_time, raw, kind)

    def messages(self, chunk: bytes) -> Iterator[Message]:
        """Yield the messages of a chunk."""
        offset = 0
        while offset + _MCAP_RECORD.size <= len(chunk):
            operation, length = _MCAP_RECORD.unpack_from(chunk, offset)
            first = offset + _MCAP_RECORD.size
            offset = first + length
            if operation == _MCAP_MESSAGE_RECORD:
                number, _, time, _ = _MCAP_MESSAGE.unpack_from(chunk, first)
                yield from self.message(number, time, chunk[first + _MCAP_MESSAGE.size : offset])
            elif operation in _MCAP_DEFINITIONS:
                kind = getattr(self._records, _MCAP_DEFINITIONS[operation])
                self.define(
                    kind.read(self._streams.ReadDataStream(io.BytesIO(chunk[first:offset])))
                )

    def _type(self, channel: Any) -> MessageType | None:
        """Return the type of a channel's messages, None where they are not read."""
        encoding, schema = channel.message_encoding, self._schemas.get(channel.schema_id)
        if encoding == "json":
            return JsonType()
        if encoding in ("cdr", "ros1") and schema is not None and schema.encoding.endswith("msg"):
            if not schema.data:
                return RosType(standard_types(), full_name(schema.name), cdr=encoding == "cdr")
            return defined_type(schema.name, schema.data.decode(), cdr=encoding == "cdr")
        self._notes[channel.topic] = f"topic {channel.topic}: messages in {encoding} are not read"
        return None
