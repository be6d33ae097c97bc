"""The example that fuses by hand shows each verdict, and why sources disagree."""

import runpy
import sys
from pathlib import Path

import pytest

from contactfusion import Fusion

EXAMPLE = Path(__file__).parents[1] / "examples" / "fuse_by_hand.py"


@pytest.fixture
def fusion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Fusion:
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), str(tmp_path)])
    found: Fusion = runpy.run_path(str(EXAMPLE))["fusion"]
    return found


def test_each_verdict_is_to_be_seen(fusion: Fusion) -> None:
    assert set(map(str, fusion.space.verdicts)) == {"contact", "nulled", "support_only"}


def test_the_line_of_action_is_in_doubt_until_free_space_rules_its_other_end_out(
    fusion: Fusion,
) -> None:
    (contact,) = fusion.contacts
    assert all(contact.shares[source] > 0.0 for source in ("skin", "wrench", "camera"))
    assert len(fusion.without("camera/free").contacts) == 2
