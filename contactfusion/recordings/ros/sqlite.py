"""Bags in SQLite as rosbags reads them, bounded (extra `record`).

A file of SQLite may hold programs: views, generated columns and virtual tables compute what is read
of them, of any size and for any time. Any cell may hold a value of any type.
"""

from collections.abc import Callable, Iterator
from functools import cache, partial, partialmethod
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

LONGEST_MESSAGE: Final = 2**29
"""The greatest length of a message, and of any other value [bytes]."""
LONGEST_NAME: Final = 2**12
"""The greatest length of the name of a topic or of a type [characters]."""
TABLES: Final = ("messages", "topics", "message_definitions", "schema")
"""The tables that are read."""
EACH: Final = 10_000
"""The instructions of SQLite between two looks at what is left of them; they take about 1 ms."""
FEW: Final = 10**7
"""The instructions that reading a small file once may take."""
PER_BYTE: Final = 10
"""Those that each byte of the file adds; of 40 bytes a message, 0.5 are taken."""
COMPUTED: Final = f"""
SELECT name FROM sqlite_master WHERE type IN ('table', 'view') AND lower(name) IN {TABLES}
AND (type = 'view' OR sql NOT LIKE 'CREATE TABLE %')
"""
"""Those of them that are views or virtual; SQLite refuses a file where `sql` is not of `type`."""
WRONG: Final = """
SELECT CAST(id AS INTEGER), typeof(timestamp), typeof(topic_id), typeof(data) FROM messages
WHERE typeof(timestamp) != 'integer' OR typeof(topic_id) != 'integer' OR typeof(data) != 'blob'
LIMIT 1
"""
"""The first message with cells of other types than messages have."""


@cache
def bound_sqlite() -> None:
    """Bound what the reader of rosbags does with a file of SQLite, and check what it reads."""
    module: Any = import_module("rosbags.rosbag2.storage_sqlite3")
    apsw, reader = module.apsw, module.Sqlite3Reader
    module.apsw = SimpleNamespace(
        Connection=partial(_connected, apsw),
        Error=apsw.Error,
        SQLITE_OPEN_READONLY=apsw.SQLITE_OPEN_READONLY,
        SQLITE_OPEN_URI=apsw.SQLITE_OPEN_URI,
    )
    reader._open = partialmethod(_open, reader._open)
    reader.messages = partialmethod(_messages, reader.messages)


def _connected(apsw: Any, *args: Any, **options: Any) -> Any:
    """A connection whose values and work are bounded."""
    connection = apsw.Connection(*args, **options)
    connection.limit(apsw.SQLITE_LIMIT_LENGTH, LONGEST_MESSAGE)
    _bound_work(connection)
    return connection


def _bound_work(connection: Any) -> int:
    """Bound what SQLite does from now on by the size of the file, which is returned [bytes].

    It calls Python now and then, so that Ctrl-C is heard, too.
    """
    size = Path(connection.filename).stat().st_size
    left = iter(range((FEW + PER_BYTE * size) // EACH))

    def spend() -> bool:
        if next(left, None) is None:
            raise ValueError("it takes SQLite more work than files of its size do")
        return False

    connection.set_progress_handler(spend, EACH)
    return size


def _open(reader: Any, read: Callable[[Any], None]) -> None:
    """Detect the topics of a file whose tables are ordinary and hold what those of bags do.

    Args:
        reader: of rosbags, with its connection.
        read: detects them.

    Raises:
        ValueError: a table is computed, or a cell is of another type or too long.
    """
    run = reader.dbconn.execute
    for (table,) in run(COMPUTED):
        raise ValueError(f"its '{table}' is no table but is computed")
    for table in TABLES:
        if any(hidden for *_, hidden in run(f"PRAGMA table_xinfo({table})")):
            raise ValueError(f"its table '{table}' has columns that are computed")
    read(reader)
    for number, *types in run(WRONG):
        raise ValueError(
            f"row {number} of its table 'messages' has timestamp, topic_id and data of the types "
            f"{', '.join(types)}, not integer, integer, blob"
        )
    if run("SELECT id FROM topics GROUP BY id HAVING count(*) > 1").fetchone():
        raise ValueError("its table 'topics' has several rows of one id")
    for link in reader.connections:
        names = link.topic, link.msgtype, link.ext.serialization_format
        if not all(isinstance(name, str) and len(name) <= LONGEST_NAME for name in names):
            raise ValueError(
                f"row {link.id} of its table 'topics' has names that are no text of at most "
                f"{LONGEST_NAME} characters"
            )
        if not isinstance(link.msgdef.data, str):
            raise ValueError(
                f"its table 'message_definitions' has none in text for row {link.id} of 'topics'"
            )


def _messages(
    reader: Any, read: Callable[..., Iterator[tuple[Any, int, bytes]]], *args: Any
) -> Iterator[tuple[Any, int, bytes]]:
    """The messages that rosbags reads.

    Args:
        reader: of rosbags.
        read: reads them.
        *args: what is read.

    Raises:
        ValueError: an index holds others than the table, which only was checked, or a stamp is
            negative.
    """
    left = _bound_work(reader.dbconn)
    for link, stamp, data in read(reader, *args):
        fits = isinstance(stamp, int) and isinstance(data, bytes) and len(data) <= left
        if not fits:
            raise ValueError("an index does not fit its table")
        if stamp < 0:
            raise ValueError(f"a message has the stamp {stamp} ns, before 1970")
        left -= len(data)
        yield link, stamp, data
