"""The kind of reading and its generator keep the contracts, and say what they should."""

import numpy as np
from contactfusion_microphones import Sound, SoundCodec, TapConfig, TapGenerator

from contactfusion import Grid, State, check_codec, check_generator


def test_they_keep_the_contracts() -> None:
    """The kits have nothing to say against them."""
    check_codec(SoundCodec)
    check_generator(TapGenerator)


def test_a_tap_is_at_the_loudest_microphone() -> None:
    """The likelihood is half at the threshold."""
    tap = TapGenerator("shell", TapConfig(threshold=2.0))
    state = State(now=0.0, grid=Grid("base", 0.005))
    levels = np.array([0.1, 2.0])
    sound = Sound(stamp=0.0, frame="base", levels=levels, positions=np.eye(3)[:2])
    (cloud,) = tap.generate(sound, state)
    assert cloud.positions.tolist() == [[0.0, 1.0, 0.0]] and cloud.likelihoods.tolist() == [0.5]
