"""Fixtures that several tests of the simulator share."""

from functools import partial

import pytest

from sim.render.raycast import Raycaster

from .raycasters import has_embree


@pytest.fixture(params=["embree", "open3d"])
def make_raycaster(request):
    """`Raycaster` with one backend that finds hits; the test runs once for each."""
    if request.param == "embree" and not has_embree():
        pytest.skip("Embree's packets cannot be used here")
    return partial(Raycaster, backend=request.param)
