"""Bags in SQLite that compute what is read of them, or hold other values than bags do."""

import sqlite3
from pathlib import Path

import pytest

from contactfusion.errors import RecordingError
from contactfusion.inspect.inspection import inspect_recording
from contactfusion.recordings.opening import open_recording
from contactfusion.recordings.ros import sqlite as bounded
from tests import ros_bags
from tests.ros_bags import wrench

UNTYPED = """
ALTER TABLE {0} RENAME TO old;
CREATE TABLE {0} ({1});
INSERT INTO {0} SELECT * FROM old;
DROP TABLE old;
"""
MESSAGES = UNTYPED.format("messages", "id INTEGER PRIMARY KEY, topic_id, timestamp, data")
TOPICS = UNTYPED.format(
    "topics",
    "id, name, type, serialization_format, offered_qos_profiles, type_description_hash",
)
COMPUTED = """
ALTER TABLE messages RENAME TO old;
CREATE TABLE messages (
    id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data AS ({0}) VIRTUAL
);
INSERT INTO messages (id, topic_id, timestamp) SELECT id, topic_id, timestamp FROM old;
DROP TABLE old;
"""
VIEW = "ALTER TABLE {0} RENAME TO old; CREATE VIEW {0} AS SELECT * FROM old;"
VIRTUAL = """
ALTER TABLE messages RENAME TO old;
CREATE VIRTUAL TABLE messages USING rtree (id, timestamp, data);
"""
ENDLESS = "printf('%.*c', 40000, 'a') LIKE '%a%a%a%a%a%a%a%a%b'"


def changed(folder: Path, script: str, count: int = 6) -> Path:
    """Write a bag in SQLite, and run a script of SQL on it."""
    path = ros_bags.sqlite(folder, [("/wrist", i, wrench(i)) for i in range(count)])
    file = sqlite3.connect(path)
    file.executescript(script)
    file.close()
    return path


def refused(path: Path) -> str:
    """Return why a file can't be read."""
    with pytest.raises(RecordingError) as error:
        inspect_recording(path)
    return str(error.value).removeprefix(f"{path} can't be read: ")


@pytest.mark.parametrize("expression", ["zeroblob(300000000)", ENDLESS, "topic_id"])
def test_messages_that_a_file_computes_are_refused_before_they_are(
    tmp_path: Path, expression: str
) -> None:
    path = changed(tmp_path, COMPUTED.format(expression))
    assert refused(path) == "its table 'messages' has columns that are computed"


@pytest.mark.parametrize("table", ["messages", "topics", "message_definitions"])
def test_a_view_in_place_of_a_table_is_refused(tmp_path: Path, table: str) -> None:
    path = changed(tmp_path, VIEW.format(table))
    assert refused(path) == f"its '{table}' is no table but is computed"


def test_a_virtual_table_is_refused(tmp_path: Path) -> None:
    assert refused(changed(tmp_path, VIRTUAL)) == "its 'messages' is no table but is computed"


@pytest.mark.parametrize(
    ("cell", "found"),
    [
        ("data = NULL", "integer, integer, null"),
        ("data = 5", "integer, integer, integer"),
        ("data = 'abc'", "integer, integer, text"),
        ("data = 1.5", "integer, integer, real"),
        ("timestamp = 'x'", "text, integer, blob"),
        ("timestamp = NULL", "null, integer, blob"),
        ("topic_id = 'x'", "integer, text, blob"),
    ],
)
def test_a_cell_of_another_type_is_refused_by_its_row(
    tmp_path: Path, cell: str, found: str
) -> None:
    path = changed(tmp_path, f"{MESSAGES} UPDATE messages SET {cell} WHERE id = 3;")
    assert refused(path) == (
        "row 3 of its table 'messages' has timestamp, topic_id and data of the types "
        f"{found}, not integer, integer, blob"
    )


@pytest.mark.parametrize("column", ["name", "type", "serialization_format"])
@pytest.mark.parametrize("value", ["x'ff00'", "NULL", "5", "printf('%.*c', 5000, 'a')"])
def test_names_of_a_topic_are_short_texts(tmp_path: Path, column: str, value: str) -> None:
    path = changed(tmp_path, f"{TOPICS} UPDATE topics SET {column} = {value};")
    assert refused(path) == (
        "row 1 of its table 'topics' has names that are no text of at most 4096 characters"
    )


def test_the_definition_of_a_message_is_text(tmp_path: Path) -> None:
    script = "UPDATE message_definitions SET encoded_message_definition = x'ff00';"
    assert refused(changed(tmp_path, script)) == (
        "its table 'message_definitions' has none in text for row 1 of 'topics'"
    )


def test_topics_of_one_id_are_refused(tmp_path: Path) -> None:
    path = changed(tmp_path, f"{TOPICS} INSERT INTO topics SELECT * FROM topics;")
    assert refused(path) == "its table 'topics' has several rows of one id"


def test_a_message_may_be_so_long(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = changed(tmp_path, "INSERT INTO messages SELECT 7, 1, 7, zeroblob(200000);")
    assert inspect_recording(path).problem == ""
    monkeypatch.setattr(bounded, "LONGEST_MESSAGE", 100_000)
    assert inspect_recording(path).problem.startswith(f"{path} is damaged after ")


def test_what_takes_more_work_than_the_size_of_the_file_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = changed(tmp_path, "", count=2000)
    assert inspect_recording(path).problem == ""
    monkeypatch.setattr(bounded, "FEW", 0)
    monkeypatch.setattr(bounded, "PER_BYTE", 0)
    assert refused(path) == "it takes SQLite more work than files of its size do"


def test_an_index_that_holds_other_values_than_its_table_is_an_error(tmp_path: Path) -> None:
    made, named = "(timestamp, topic_id, id)", "(timestamp, topic_id, data)"
    path = changed(
        tmp_path,
        f"""
        DROP INDEX timestamp_idx;
        CREATE INDEX timestamp_idx ON messages {made};
        PRAGMA writable_schema = ON;
        UPDATE sqlite_master SET sql = replace(sql, '{made}', '{named}');
        """,
    )
    assert inspect_recording(path).problem.startswith(
        f"{path} is damaged after 0 messages (an index "
    )


def test_indices_on_expressions_change_nothing(tmp_path: Path) -> None:
    path = changed(tmp_path, "CREATE INDEX i ON messages (hex(data)) WHERE hex(data) LIKE '%0%';")
    assert len(list(open_recording(path).readings())) == 6


def test_a_stamp_before_1970_is_damage(tmp_path: Path) -> None:
    path = changed(tmp_path, "UPDATE messages SET timestamp = -5 WHERE id = 3")
    with pytest.raises(
        RecordingError, match="damaged after 0 messages .a message has the stamp -5"
    ):
        list(open_recording(path).readings())
