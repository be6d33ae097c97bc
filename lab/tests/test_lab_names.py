"""What examples and pages take of the laboratory is what it offers."""

from pathlib import Path

import pytest

import contactfusion_lab
from tests.test_public_names import ROOT, SOURCES, documented, taken

PUBLIC = {
    *("GraspConfig", "GraspScene", "PushConfig", "PushEnv", "PushScene", "TouchConfig"),
    *("TouchScene", "grasped", "pushed", "result_of"),
}
"""All that users may rely on: a name more or less is decided here."""
USERS = [path for path in SOURCES if taken(path, "contactfusion_lab")]


def test_there_are_examples_and_pages_with_scenes() -> None:
    assert {path.suffix for path in USERS} == {".md", ".py"}


@pytest.mark.parametrize("path", USERS, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_names_that_examples_and_pages_take_are_public(path: Path) -> None:
    assert taken(path, "contactfusion_lab") <= set(contactfusion_lab.__all__)


def test_the_public_names_are_these() -> None:
    assert contactfusion_lab.__all__ == dir(contactfusion_lab) == sorted(PUBLIC)


@pytest.mark.parametrize("name", contactfusion_lab.__all__)
def test_a_public_name_has_a_docstring(name: str) -> None:
    assert documented(getattr(contactfusion_lab, name), name)


def test_strangers_are_refused() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'PushScenes'"):
        contactfusion_lab.__getattr__("PushScenes")
