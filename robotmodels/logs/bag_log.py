"""ROS 1 and 2 bags, bare databases of ROS 2 and MCAP: a table for each topic, on its own clock."""

from contextlib import ExitStack
from pathlib import Path

from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress
from robotmodels.data_files.file_guard import library_errors
from robotmodels.logs.bag_messages import bag_messages
from robotmodels.logs.log import Log
from robotmodels.logs.topic_table import TopicTable


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
    with library_errors(path, "a bag that rosbags can read", Exception):
        for message in bag_messages(path, notes, progress):
            if message.topic not in topics:
                topics[message.topic] = TopicTable(message.type, message.raw, stack)
            topics[message.topic].append(message.log_time, message.raw)
        for topic in topics.values():
            topic.flush()
    origin = min((topic.first for topic in topics.values() if topic.first is not None), default=0)
    tables = [
        topic.table(name.strip("/"), origin) for name, topic in topics.items() if topic.columns
    ]
    told = [f"{path.name}: {reason}" for reason in notes.values()]
    told += [
        f"{path.name}: topic {name}: {topic.dropped} messages with other fields were dropped"
        for name, topic in topics.items()
        if topic.dropped
    ]
    if not tables:
        reasons = "; ".join(told) or "no message has numbers"
        raise InvalidInput(f"{path}: no topic with numbers in it ({reasons})")
    return Log((path,), tuple(tables), notes=tuple(told))
