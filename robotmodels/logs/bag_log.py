"""ROS 1 and 2 bags, bare databases of ROS 2 and MCAP: a table for each topic, on its own clock."""

import json
import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress
from robotmodels.data_files.file_guard import library_errors
from robotmodels.logs.log import Log
from robotmodels.logs.optional_library import optional_library
from robotmodels.logs.topic_table import TopicTable

_EVERY = 1000  # messages, from one report of progress to the next


class Message(NamedTuple):
    """A message as it was recorded."""

    topic: str
    log_time: int
    content: Any


def read_bag_log(path: Path, stack: ExitStack, progress: Progress | None = None) -> Log:
    """Read the messages of a bag: a ROS 1 .bag, a ROS 2 folder or bare .db3, or an .mcap file.

    Fields become channels: ``position[shoulder]`` where a message has ``name`` for its arrays, else
    ``position[0]``. Times count from the first message.

    Raises
    ------
    InvalidInput
        If it is no bag, or no topic of it has numbers.
    """
    notes: dict[str, str] = {}
    topics: dict[str, TopicTable] = {}
    errors = library_errors(path, "a bag that rosbags can read", Exception)
    with errors:
        source = _messages(path, notes)
        for count, message in enumerate(source):
            if message.topic not in topics:
                topics[message.topic] = TopicTable(message.content, stack)
            topics[message.topic].append(message.log_time, message.content)
            if progress is not None and count % _EVERY == 0:
                progress(count, 0)
    origin = min((topic.first for topic in topics.values() if topic.first is not None), default=0)
    tables = [
        topic.table(name.strip("/"), origin) for name, topic in topics.items() if topic.columns
    ]
    told = [f"{path.name}: topic {name}: {reason}" for name, reason in notes.items()]
    told += [
        f"{path.name}: topic {name}: {topic.dropped} messages with other fields were dropped"
        for name, topic in topics.items()
        if topic.dropped
    ]
    if not tables:
        reasons = "; ".join(told) or "no message has numbers"
        raise InvalidInput(f"{path}: no topic with numbers in it ({reasons})")
    return Log((path,), tuple(tables), notes=tuple(told))


def _messages(path: Path, notes: dict[str, str]) -> Iterator[Message]:
    if path.suffix.lower() == ".mcap":
        return _mcap_messages(path, notes)
    if path.suffix.lower() == ".db3":
        return _database_messages(path, notes)
    return _bag_messages(path)


def _bag_messages(path: Path) -> Iterator[Message]:
    highlevel = optional_library("rosbags.highlevel", f"{path}: a bag")
    with highlevel.AnyReader([path], default_typestore=_standard_types()) as reader:
        for connection, time, raw in reader.messages():
            yield Message(connection.topic, time, reader.deserialize(raw, connection.msgtype))


def _database_messages(path: Path, notes: dict[str, str]) -> Iterator[Message]:
    """Yield the messages of a .db3 file without its metadata, which rosbags refuses."""
    store = _standard_types()
    address = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as database:
        tables = {row[0] for row in database.execute("select name from sqlite_master")}
        if "message_definitions" in tables:
            rows = (
                "select topic_type, encoding, encoded_message_definition from message_definitions"
            )
            for kind, encoding, text in database.execute(rows):
                if encoding == "ros2msg":
                    _register(store, kind, text)
        topics = {
            number: (name, kind)
            for number, name, kind in database.execute("select id, name, type from topics")
        }
        order = "select topic_id, timestamp, data from messages order by timestamp, id"
        for number, time, raw in database.execute(order):
            name, kind = topics[number]
            if kind in store.types:
                yield Message(name, time, store.deserialize_cdr(raw, kind))
            else:
                notes[name] = f"its type {kind} is not defined in the file; it was passed over"


def _mcap_messages(path: Path, notes: dict[str, str]) -> Iterator[Message]:
    reader = optional_library("mcap.reader", f"{path}: MCAP")
    stores: dict[int, Any] = {}
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages(
            log_time_order=False  # of one writer they are; sorting takes most of the time
        ):
            encoding, kind = channel.message_encoding, schema.name if schema else ""
            if encoding == "json":
                text = json.loads(message.data, object_hook=lambda d: SimpleNamespace(**d))
                yield Message(channel.topic, message.log_time, text)
                continue
            if encoding not in ("cdr", "ros1") or not schema.encoding.endswith("msg"):
                notes[channel.topic] = f"messages in {encoding} are not read"
                continue
            if schema.id not in stores:
                stores[schema.id] = _types_of(schema, encoding)
            store = stores[schema.id]
            decode = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
            yield Message(channel.topic, message.log_time, decode(message.data, _full_name(kind)))


def _types_of(schema: Any, encoding: str) -> Any:
    typesys = optional_library("rosbags.typesys", "messages of ROS")
    stores = typesys.Stores
    store = typesys.get_typestore(stores.ROS1_NOETIC if encoding == "ros1" else stores.LATEST)
    if _full_name(schema.name) not in store.types:
        _register(store, schema.name, schema.data.decode())
    return store


def _standard_types() -> Any:
    typesys = optional_library("rosbags.typesys", "messages of ROS")
    return typesys.get_typestore(typesys.Stores.LATEST)


def _register(store: Any, kind: str, text: str) -> None:
    typesys = optional_library("rosbags.typesys", "messages of ROS")
    types = typesys.get_types_from_msg(text, _full_name(kind))
    store.register({name: each for name, each in types.items() if name not in store.types})


def _full_name(kind: str) -> str:
    package, _, name = kind.rpartition("/")
    return kind if package.endswith("/msg") else f"{package}/msg/{name}"
