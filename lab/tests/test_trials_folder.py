"""The folder of an experiment: names from configurations never lead out of it."""

from pathlib import Path

import pytest

from contactfusion.errors import ConfigurationError
from contactfusion_lab.trials.folder import joined, trial_file


def test_a_trial_lies_in_the_folder_by_the_parts_of_its_name(tmp_path: Path) -> None:
    path = trial_file(tmp_path, "fused/tuned/box-mu1-000", ".npz")
    assert path == tmp_path / "trials" / "fused" / "tuned" / "box-mu1-000.npz"


@pytest.mark.parametrize("name", ["../../../x-000", "/tmp/x", "a//b", "./a", "a\x00b", "a\nb", ""])
def test_a_name_that_leads_elsewhere_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigurationError, match="can't be that of a file"):
        trial_file(tmp_path, name, ".npz")


@pytest.mark.parametrize(("text", "times"), [(b"[", 100_000), (b"[[1, 2]]", 1), (b"\xff", 1)])
def test_settings_that_are_damaged_are_a_sentence(tmp_path: Path, text: bytes, times: int) -> None:
    (tmp_path / "settings.json").write_bytes(text * times)
    with pytest.raises(ConfigurationError, match=r"settings\.json is damaged: give another --out"):
        joined({"a": 1}, tmp_path, (), "trials")
