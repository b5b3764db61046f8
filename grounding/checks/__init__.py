"""Checks of plug-ins: encoders, map builders, grounders, phrase sources, perception. Each returns its problems."""

from .answers import check_encoder as check_encoder
from .answers import check_grounder as check_grounder
from .answers import check_phrases as check_phrases
from .images import check_image_encoder as check_image_encoder
from .maps import check_map_builder as check_map_builder
from .perception import check_detector as check_detector
from .perception import check_scorer as check_scorer
from .perception import check_segmenter as check_segmenter
