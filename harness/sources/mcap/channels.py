"""Description of an MCAP channel's messages."""

from __future__ import annotations

from mcap.records import Channel, Schema

from harness.sources.recordings.message_types import MessageType, ros_name


def message_type(channel: Channel, schema: Schema | None) -> MessageType:
    """Return the type of a channel's messages; a channel may have no schema."""
    name = "no schema" if schema is None else schema.name
    return MessageType(
        message_encoding=channel.message_encoding,
        schema_encoding="" if schema is None else schema.encoding,
        name=ros_name(name) if channel.message_encoding == "ros1" else name,
        schema=b"" if schema is None else schema.data,
    )
