"""SAM 2 by transformers: the adapter, on a small model of random weights."""

import pickle
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactfusion.errors import ConfigurationError, DependencyError, InvalidReadingError
from contactfusion.segmenters.sam2 import Sam2Config, Sam2Segmenter, innermost, normalised
from tests.pictures import POSE, picture

transformers = pytest.importorskip("transformers")
torch = pytest.importorskip("torch")
SIDE, UNITS = 64, 128


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A model as small as it may be."""
    torch.manual_seed(0)
    hiera = {
        "model_type": "sam2_hiera_det_model",
        "hidden_size": 8,
        "image_size": [SIDE, SIDE],
        "blocks_per_stage": [1, 1, 2, 1],
        "embed_dim_per_stage": [8, 16, 32, 64],
        "num_attention_heads_per_stage": [1, 1, 1, 1],
        "window_size_per_stage": [4, 4, 4, 4],
        "window_positional_embedding_background_size": [4, 4],
        "global_attention_blocks": [3],
    }
    vision = {
        "model_type": "sam2_vision_model",
        "backbone_config": hiera,
        "backbone_channel_list": [64, 32, 16, 8],
        "backbone_feature_sizes": [[SIDE // n, SIDE // n] for n in (4, 8, 16)],
        "fpn_hidden_size": UNITS,
    }
    config = transformers.Sam2VideoConfig(
        vision_config=vision,
        prompt_encoder_config={"hidden_size": UNITS, "image_size": SIDE},
        mask_decoder_config={"hidden_size": UNITS, "mlp_dim": 32, "num_attention_heads": 2},
        image_size=SIDE,
        memory_attention_hidden_size=UNITS,
        memory_attention_num_layers=1,
        memory_attention_feed_forward_hidden_size=32,
        memory_attention_rope_feat_sizes=[SIDE // 16, SIDE // 16],
        memory_encoder_hidden_size=UNITS,
        memory_encoder_output_channels=64,
        memory_fuser_embed_dim=UNITS,
        memory_fuser_intermediate_dim=32,
        memory_fuser_num_layers=1,
        mask_downsampler_embed_dim=UNITS,
        num_maskmem=3,
        max_object_pointers_in_encoder=4,
    )
    folder = tmp_path_factory.mktemp("sam2")
    transformers.Sam2VideoModel(config).save_pretrained(folder)
    yield folder


@pytest.fixture
def segmenter(weights: Path) -> Sam2Segmenter:
    return Sam2Segmenter(Sam2Config(weights=str(weights)))


def test_it_follows_an_object_with_a_memory_that_does_not_grow(segmenter: Sam2Segmenter) -> None:
    for _ in range(8):
        mask = segmenter.segment(picture(), POSE)
        assert mask is None or (mask.shape == (120, 160) and mask.dtype == np.bool_)
    session = segmenter._session
    assert not session.processed_frames
    assert len(session.output_dict_per_obj[0]["non_cond_frame_outputs"]) == 4
    assert len(session.output_dict_per_obj[0]["cond_frame_outputs"]) == 1


def test_it_is_shown_the_pixel_innermost_in_the_nearest_object(segmenter: Sam2Segmenter) -> None:
    image = picture(near=0.35, sides=(0.0, 0.2))
    assert image.mask is not None
    segmenter.segment(image, POSE)
    (shown,) = segmenter._session.point_inputs_per_obj[0].values()
    column, row = shown["point_coords"].ravel().numpy() / SIDE * (160, 120)
    assert (round(row), round(column)) == innermost(image.mask)
    assert shown["point_labels"].tolist() == [[[1]]]


def test_as_long_as_no_object_is_found_there_is_nothing_to_follow(
    segmenter: Sam2Segmenter,
) -> None:
    assert segmenter.segment(picture(near=5.0), POSE) is None
    assert segmenter._session is None
    segmenter.segment(picture(), POSE)
    assert segmenter._session is not None
    segmenter.reset()
    assert segmenter._session is None


def test_equal_images_give_equal_masks_also_in_another_process(segmenter: Sam2Segmenter) -> None:
    def masks(one: Sam2Segmenter) -> list[Any]:
        found = [one.segment(picture(near=0.3 + 0.01 * step), POSE) for step in range(3)]
        return [None if mask is None else mask.tobytes() for mask in found]

    said = masks(segmenter)
    segmenter.reset()
    assert masks(segmenter) == said
    segmenter.reset()
    assert masks(pickle.loads(pickle.dumps(segmenter))) == said


@pytest.mark.parametrize(("score", "mask", "lost"), [(-1.0, 1.0, True), (1.0, 1.0, False)])
def test_what_it_does_not_see_is_lost(
    segmenter: Sam2Segmenter,
    score: float,
    mask: float,
    lost: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = segmenter._model.forward

    def forward(*given: Any, **named: Any) -> Any:
        found = whole(*given, **named)
        found.object_score_logits = torch.full((1, 1), score)
        found.pred_masks = torch.full((1, 1, 16, 16), -1.0)
        found.pred_masks[..., :8, :] = mask
        return found

    monkeypatch.setattr(segmenter._model, "forward", forward)
    found = segmenter.segment(picture(), POSE)
    assert (found is None) == lost
    if found is not None:
        assert found[:56].all() and not found[64:].any()


def test_images_are_scaled_as_in_training() -> None:
    colour = np.full((6, 8, 3), (255, 0, 0), np.uint8)
    pixels = normalised(colour, 4)
    assert pixels.shape == (1, 3, 4, 4) and pixels.dtype == np.float32
    assert pixels[0, :, 0, 0] == pytest.approx([0.515 / 0.229, -0.456 / 0.224, -0.406 / 0.225])


def test_the_innermost_pixel_is_furthest_from_the_rim_of_mask_and_image() -> None:
    mask = np.zeros((9, 20), np.bool_)
    mask[:, 4:13] = True
    assert innermost(mask) == (4, 8)


def test_an_image_without_colour_is_refused(segmenter: Sam2Segmenter) -> None:
    with pytest.raises(InvalidReadingError, match="has no colour for the segmenter 'sam2'"):
        segmenter.segment(replace(picture(), colour=None), POSE)


def test_weights_that_are_not_there_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    with pytest.raises(ConfigurationError, match="weights: SAM 2 cannot be loaded: "):
        Sam2Segmenter(Sam2Config(weights=str(tmp_path / "none")))
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(ConfigurationError, match="weights: SAM 2 cannot be loaded: "):
        Sam2Segmenter(Sam2Config(weights=str(tmp_path)))


def test_without_transformers_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(DependencyError, match=r"pip install 'contactfusion\[sam\]'"):
        Sam2Segmenter(Sam2Config(weights="none"))
