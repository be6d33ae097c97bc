"""Every built-in kind of reading is complete."""

from typing import Any

import pytest

from contactfusion.readings import BUILT_IN
from contactfusion.readings.codec import Codec
from contactfusion.testing import check_codec

pytest.importorskip("rosbags")


@pytest.mark.parametrize("codec", BUILT_IN, ids=lambda codec: codec.name)
def test_every_kind_is_complete(codec: Codec[Any]) -> None:
    check_codec(type(codec))
    assert codec.messages
