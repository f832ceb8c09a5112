"""Decode messages: ROS 1 and ROS 2 (rosbags), protobuf, JSON."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import mcap_protobuf.decoder
from mcap.records import Schema
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from harness.sources.recordings.message_types import BY_NAME, MessageType
from vfoa.errors import VfoaError

_PLAIN_CDR = (b"\0\0", b"\0\1")
"""First bytes of a message in XCDR1: big-endian, little-endian (OMG DDS-XTypes 1.3, table 59)."""


def fields_of(kind: MessageType, data: bytes, where: str) -> Callable[[str], Any]:
    """Decode a message; the returned function gives its fields by name, in the spelling of ROS 2.

    ROS 1 and Foxglove write the matrices of a calibration in capitals; bytes in JSON are base64.
    """
    message = _decode(kind, data)
    if kind.message_encoding == "json" and not isinstance(message, dict):
        raise TypeError(f"expected an object, found {type(message).__name__}")

    def field(name: str) -> Any:
        for spelling in (name, name.upper()):
            if kind.message_encoding == "json" and spelling in message:
                value = message[spelling]
                return base64.b64decode(value, validate=True) if name == "data" else value
            if kind.message_encoding != "json" and hasattr(message, spelling):
                return getattr(message, spelling)
        raise VfoaError(f"{where}: a {kind.name} without {name!r}; found {', '.join(_names(message))}")

    return field


@contextmanager
def reading(kind: MessageType, where: str) -> Iterator[None]:
    """Turn every error in the block into one: the message does not match its topic's schema.

    Raises
    ------
    VfoaError
        In place of any other exception.
    """
    try:
        yield
    except VfoaError:
        raise
    except Exception as error:  # errors of the decoders, and of fields that are missing or of another kind
        text = (str(error) or type(error).__name__).splitlines()[0]
        raise VfoaError(f"{where}: not a {kind.name} in {kind.message_encoding}: {text}") from None


def _names(message: Any) -> list[str]:
    if isinstance(message, dict):
        return list(message)
    return [name for name in dir(message) if not name.startswith("_")]


def _decode(kind: MessageType, data: bytes) -> Any:
    # rosbags supports only XCDR1; it would misread the other encapsulations, whose alignment differs
    if kind.message_encoding == "cdr" and data[:2] not in _PLAIN_CDR:
        raise ValueError(f"encapsulation {data[:2].hex()}; expected 0000 or 0001 (plain CDR)")
    return _decoder(kind)(data)


@lru_cache(maxsize=64)
def _decoder(kind: MessageType) -> Callable[[bytes], Any]:
    if kind.message_encoding == "json":
        return json.loads
    if kind.is_ros:
        return _ros_decoder(kind)
    schema = Schema(id=1, name=kind.name, encoding=kind.schema_encoding, data=kind.schema)
    decoder = mcap_protobuf.decoder.DecoderFactory().decoder_for(kind.message_encoding, schema)
    if decoder is None:
        raise ValueError(f"no decoder for a schema in {kind.schema_encoding!r}")
    return decoder


def _ros_decoder(kind: MessageType) -> Callable[[bytes], Any]:
    if kind.schema_encoding == BY_NAME:
        store = get_typestore(Stores.LATEST)
        if kind.name not in store.types:
            raise ValueError(f"the recording has no definition of {kind.name}")
    else:
        store = get_typestore(Stores.EMPTY)
        text = kind.schema.decode()
        is_idl = kind.schema_encoding == "ros2idl"
        found = get_types_from_idl(text) if is_idl else get_types_from_msg(text, kind.name)
        store.register({name: fields for name, fields in found.items() if name not in store.types})
    deserialize = store.deserialize_ros1 if kind.message_encoding == "ros1" else store.deserialize_cdr

    def decode(data: bytes) -> Any:
        return deserialize(data, kind.name)

    return decode
