"""Checks of plug-ins: encoders, map builders, grounders, phrase sources. Each returns its problems, one line each."""

from .answers import check_encoder as check_encoder
from .answers import check_grounder as check_grounder
from .answers import check_phrases as check_phrases
from .images import check_image_encoder as check_image_encoder
from .maps import check_map_builder as check_map_builder
