"""Encoders by name: known names, refused names, and slugs for file names."""

import pytest

from grounding.encoders.by_name import encoder_slug, make_encoder, make_image_encoder, parse_encoder_name
from sim.errors import AgentError


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("hashed", ("hashed", "", False)),
        ("minilm+oracle-perception", ("minilm", "", True)),
        ("clip:openai/clip-vit-large-patch14", ("clip", "openai/clip-vit-large-patch14", False)),
        ("blip2-hidden768:/data/blip2", ("blip2-hidden768", "/data/blip2", False)),
        ("siglip:C:/models/siglip", ("siglip", "C:/models/siglip", False)),
    ],
)
def test_a_name_consists_of_a_space_and_a_source(name: str, expected: tuple[str, str, bool]) -> None:
    assert parse_encoder_name(name) == expected


@pytest.mark.parametrize("name", ["", "hash", "hashed:x", "clip", "clip:", "blip2:Salesforce/x", "+oracle-perception"])
def test_unknown_names_are_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(AgentError, match=r"is not known; expected hashed, minilm, or one of clip:, siglip:, blip2-itc"):
        make_encoder(name)


@pytest.mark.parametrize("name", ["hashed", "minilm", "hashed+oracle-perception"])
def test_text_encoders_are_refused_for_pictures(name: str) -> None:
    with pytest.raises(AgentError, match="cannot see; expected one of clip:"):
        make_image_encoder(name)


def test_a_name_with_the_suffix_of_oracle_perception_gives_the_encoder_of_queries() -> None:
    encoder = make_encoder("hashed+oracle-perception")
    assert encoder.name == "hashed-words-768+oracle-perception"
    assert (encoder.encode_texts(["oak table"]) == make_encoder("hashed").encode_texts(["oak table"])).all()


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("hashed", "hashed"),
        ("clip:openai/clip-vit-large-patch14", "clip-clip-vit-large-patch14"),
        ("siglip:/my models/siglip 2/", "siglip-siglip-2"),
        ("minilm+oracle-perception", "minilm-oracle-perception"),
    ],
)
def test_slugs_can_be_used_as_file_names(name: str, expected: str) -> None:
    assert encoder_slug(name) == expected
