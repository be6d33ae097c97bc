"""What a user chooses by name."""

import pytest

from contactfusion.errors import ConfigurationError
from contactfusion_lab.trials.choices import trial_named

TRIALS = ("skin/tuned/box-1", "skin/tuned/chair-1", "lidar/tuned/box-1")


def test_a_trial_is_found_by_the_end_of_its_name_the_first_of_several() -> None:
    assert trial_named("chair-1", TRIALS) == "skin/tuned/chair-1"
    assert trial_named("box-1", TRIALS) == "skin/tuned/box-1"
    assert trial_named("lidar/tuned/box-1", TRIALS) == "lidar/tuned/box-1"


@pytest.mark.parametrize("name", ["ox-1", "tuned", "", "box-1/"])
def test_parts_of_names_are_no_names(name: str) -> None:
    with pytest.raises(ConfigurationError, match=f"record: unknown trial '{name}'"):
        trial_named(name, TRIALS)


def test_of_many_trials_one_is_reported() -> None:
    many = [f"a/{number:03d}" for number in range(31)]
    with pytest.raises(ConfigurationError, match="unknown trial '7'; one is '000'"):
        trial_named("7", many)


def test_a_name_that_is_written_wrong_is_reported_with_the_nearest_of_as_many_parts() -> None:
    with pytest.raises(ConfigurationError, match="unknown trial 'chair-2'; did you mean 'chair-1'"):
        trial_named("chair-2", TRIALS)
    with pytest.raises(ConfigurationError, match="did you mean 'tuned/chair-1'"):
        trial_named("tunde/chair-1", TRIALS)
