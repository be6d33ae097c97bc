"""The demo shows what the framework is for."""

from pathlib import Path

import pytest

from contactfusion.demo import STAMP, show, sources
from tests.clouds import fused, verdicts

PNG = b"\x89PNG\r\n\x1a\n"


def test_the_demo_prints_its_contact_with_reasons_and_writes_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    show(tmp_path / "new" / "folder")
    said = capsys.readouterr().out
    assert said.startswith("contact at (0.04") and "without skin: " in said
    picture = tmp_path / "new" / "folder" / "contacts.png"
    assert f"picture: {picture}" in said
    assert picture.read_bytes().startswith(PNG) and picture.stat().st_size > 10_000


def test_in_the_demo_each_verdict_is_to_be_seen() -> None:
    fusion = fused(*sources(), now=STAMP, frame="palm")
    assert set(verdicts(fusion).values()) == {"contact", "nulled", "support_only"}


def test_in_the_demo_the_wrench_alone_would_see_two_contacts_and_all_together_see_one() -> None:
    skin, wrench, camera, free = sources()
    assert len(fused(wrench, now=STAMP, frame="palm").contacts) == 2
    (contact,) = fused(skin, wrench, camera, free, now=STAMP, frame="palm").contacts
    assert all(share > 0.0 for share in contact.shares.values())
