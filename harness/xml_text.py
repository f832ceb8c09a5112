"""XML as elements."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, fromstring

from vfoa.errors import VfoaError


def parse_xml(data: bytes, path: Path) -> Element:
    """The outermost element of a file's content.

    Raises
    ------
    VfoaError
        If it is no XML (with the line), or names an encoding that there is none of.
    """
    try:
        return fromstring(data)
    except ParseError as error:
        raise VfoaError(f"{path}:{error.position[0]}: not XML: {error}") from None
    except (LookupError, ValueError) as error:
        raise VfoaError(f"{path}:1: not XML: {error}") from None
