"""Definitions of messages as files hold them: bounded, then parsed by rosbags (extra `record`).

Its parsers take a time that is exponential in the depth of brackets, and constants of any size; its
generators write a line of code for each element of an array of messages.
"""

import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from contactfusion.errors import RecordingError

if TYPE_CHECKING:
    from rosbags.interfaces import MessageDefinition
    from rosbags.typesys.store import Typestore

Types = dict[str, Any]
"""By the names of types: their constants and their fields, as rosbags holds them."""
RULE: Final = 80 * "=" + "\n"
"""The separator of the parts of a definition."""
LONGEST_MSG: Final = 2**18
"""The greatest length of a definition in .msg with those of its parts [characters]."""
LONGEST_IDL: Final = 2**16
"""Likewise in .idl, whose parser is slower."""
MOST_ELEMENTS: Final = 2**14
"""The greatest sum of the lengths of arrays of messages and of text; numbers are not counted."""
DIGITS: Final = re.compile(r"\w{100}")
"""A word, such as a number, that is longer than any."""
IDLE: Final = re.compile(
    r"""^IDL:[^\n]* | /\*.*?\*/ | //[^\n]* | "(?:\\.|[^"\\])*" | '(?:\\.|[^'\\])*'
    | \d[\d.]*[eE][+-]?\d+""",
    re.DOTALL | re.MULTILINE | re.VERBOSE,
)
"""What is no expression in IDL: names of parts, comments, texts, numbers with an exponent."""
ANNOTATION: Final = re.compile(r"@\w+\s*\(([^()]*)\)")
"""An annotation of IDL with its arguments."""
OPERATOR: Final = re.compile(r"[*/%&|^~+()]|<<|\w\s*-")
"""What makes an expression of numbers."""


@lru_cache(maxsize=256)
def parsed(definition: "MessageDefinition", msgtype: str) -> Types:
    """The types that a definition defines.

    Args:
        definition: in .msg or .idl, with those of its parts.
        msgtype: its type.

    Raises:
        RecordingError: it can't be parsed, or is larger than any.
    """
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import get_types_from_msg

    text = definition.data
    is_msg = definition.format == MessageDefinitionFormat.MSG
    if problem := _bounded(text, is_msg):
        raise RecordingError(f"the definition of {msgtype} is refused: {problem}")
    try:
        types = get_types_from_msg(text, msgtype) if is_msg else _types_in_idl(text)
    except Exception as error:  # of many kinds
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise RecordingError(f"the definition of {msgtype} can't be parsed: {reason}") from None
    if (elements := sum(map(_elements, types.values()))) > MOST_ELEMENTS:
        raise RecordingError(
            f"the definition of {msgtype} is refused: its arrays of messages and text have "
            f"{elements} elements, more than {MOST_ELEMENTS}"
        )
    return types


def store_of(types: Types, msgtype: str) -> "Typestore":
    """A store of types, in which the type of a message is whole.

    Args:
        types: without those of ROS that are built in.
        msgtype: the type.

    Raises:
        RecordingError: a part of it is not defined, or contradicts another.
    """
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.EMPTY)
    try:
        store.register(types)
        store.get_msgdef(msgtype)
    except Exception as error:  # of many kinds
        raise RecordingError(f"the definition of {msgtype} is not whole: {error}") from None
    return store


def _bounded(text: str, is_msg: bool) -> str:
    """The clause on a text that is larger than any; empty for others."""
    longest = LONGEST_MSG if is_msg else LONGEST_IDL
    if len(text) > longest:
        return f"it has {len(text)} characters, more than {longest}"
    if found := DIGITS.search(text):
        return f"it holds a word of over 100 characters, '{found[0][:20]}…'"
    code = "" if is_msg else ANNOTATION.sub(r" \1 ", IDLE.sub(" 0 ", text))
    if found := OPERATOR.search(code):
        return f"it computes constants ('{found[0]}'), and only numbers are taken"
    return ""


def _elements(type_: tuple[Any, list[tuple[str, Any]]]) -> int:
    """The sum of the lengths of the arrays of a type that are of messages or text."""
    from rosbags.interfaces import Nodetype

    return sum(
        of[1]
        for _, (node, of) in type_[1]
        if node == Nodetype.ARRAY and (of[0][0] == Nodetype.NAME or of[0][1][0] == "string")
    )


def _types_in_idl(text: str) -> Types:
    from rosbags.typesys import get_types_from_idl

    if not text.startswith(f"{RULE}IDL: "):
        return get_types_from_idl(text)
    types: Types = {}
    for part in text.split(RULE)[1:]:
        types.update(get_types_from_idl(part.split("\n", 1)[1]))
    return types
