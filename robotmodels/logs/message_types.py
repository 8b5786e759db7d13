"""Types of messages: how they are decoded, one by one or many at once."""

import json
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from robotmodels.logs.message_layout import MessageLayout, message_layout
from robotmodels.logs.optional_library import optional_library


@dataclass(frozen=True, eq=False)
class RosType:
    """A type of ROS 1 or 2.

    Attributes
    ----------
    store : Typestore
        Types of messages, of rosbags.
    kind : str
        Name of the type.
    cdr : bool
        Whether messages are in CDR, as those of ROS 2.
    """

    store: Any
    kind: str
    cdr: bool

    def decode(self, raw: bytes) -> Any:
        """Return a message as an object."""
        decode = self.store.deserialize_cdr if self.cdr else self.store.deserialize_ros1
        return decode(raw, self.kind)

    def layout(self, raw: bytes) -> MessageLayout | None:
        """Return where the numbers of a message lie."""
        return message_layout(self.store, self.kind, raw, cdr=self.cdr)


class JsonType:
    """Messages in JSON."""

    def decode(self, raw: bytes) -> Any:
        """Return a message as an object."""
        return json.loads(raw, object_hook=lambda members: SimpleNamespace(**members))

    def layout(self, raw: bytes) -> None:
        """Return nothing: numbers have no places in JSON."""


MessageType = RosType | JsonType


def standard_types() -> Any:
    """Return the types that come with ROS 2."""
    typesys = optional_library("rosbags.typesys", "messages of ROS")
    return typesys.get_typestore(typesys.Stores.LATEST)


def defined_type(name: str, definition: str, *, cdr: bool) -> RosType:
    """Return a type as a file defines it, with the types of its parts."""
    typesys = optional_library("rosbags.typesys", "messages of ROS")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    register(store, name, definition)
    return RosType(store, full_name(name), cdr)


def register(store: Any, name: str, definition: str) -> None:
    """Add types of a definition that a store does not have."""
    typesys = optional_library("rosbags.typesys", "messages of ROS")
    types = typesys.get_types_from_msg(definition, full_name(name))
    store.register({each: fields for each, fields in types.items() if each not in store.types})


def full_name(name: str) -> str:
    """Return the name of a type as ROS 2 writes it, ``package/msg/Type``."""
    package, _, tail = name.rpartition("/")
    return name if package.endswith("/msg") else f"{package}/msg/{tail}"
