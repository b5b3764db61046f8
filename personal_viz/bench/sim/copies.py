"""The benchmark's figures of browser copies: time to make one, its size, and the error of clicks on it."""

import time

import numpy as np
from numpy.typing import NDArray

from sim.copies.browser_glb import browser_glb, whole_glb
from sim.copies.cut import storey_mesh
from sim.mesh import VERTEX_COLOURS, Scene, TriangleMesh
from sim.render.raycast import Raycaster
from sim.scans.glb import load_glb
from sim.walk.floor_grid import floor_grid_from_mesh

from ..harness import empty_cache
from .scenes import bench_mesh


def browser_figures(scene: Scene, floor_y: float, *, num_clicks: int, seed: int) -> dict[str, float]:
    """Makes the copy of one storey in an empty cache and clicks on it from above.

    Args:
        scene: The home.
        floor_y: One of its storey heights, metres.
        num_clicks: Rays from random eyes 3 to 12 m above the storey to random places on its floor.
        seed: Seed of the rays.

    Returns:
        `build_s`, CPU seconds to make the copy with nothing cached; its `faces` and `megabytes`; `click_median_mm` and
        `click_p99_mm`, the distance between a ray's hit on the copy, which the person sees, and on the cut storey,
        which the server uses; `click_lost`, the share of rays that hit only one of the two, among rays that hit either.
    """
    with empty_cache() as folder:
        browser_glb(_small_scene(), 0.0)  # fetches compiled code from numba's cache
        before = time.process_time()
        content = browser_glb(scene, floor_y)
        build_s = time.process_time() - before
        path = folder / "copy.glb"
        path.write_bytes(content)
        copy = load_glb(path, up="y")
    origins, directions = _clicks(copy.vertices, floor_y, num_clicks, np.random.default_rng(seed))
    seen = Raycaster(copy).cast(origins, directions)
    asked = Raycaster(storey_mesh(scene, floor_y)).cast(origins, directions)
    both = (seen.face_ids >= 0) & (asked.face_ids >= 0)
    either = (seen.face_ids >= 0) | (asked.face_ids >= 0)
    error_mm = np.linalg.norm(seen.positions[both] - asked.positions[both], axis=1) * 1e3
    return {
        "build_s": build_s,
        "faces": len(copy.faces),
        "megabytes": len(content) / 1e6,
        "click_median_mm": float(np.median(error_mm)),
        "click_p99_mm": float(np.quantile(error_mm, 0.99)),
        "click_lost": float(1 - both.sum() / either.sum()),
    }


def soup_figures(num_faces: int, *, seed: int) -> dict[str, float]:
    """Makes the copy of a loose soup: the cluttered house as vertex-coloured triangles, of which no two share a corner.

    Returns:
        `build_s`, `faces` and `megabytes`, as `browser_figures`.
    """
    house = bench_mesh(num_faces, cluttered=True, seed=seed, texture_size=4, num_textures=1)
    rng = np.random.default_rng(seed)
    corners = house.vertices[house.faces].reshape(-1, 3)
    soup = TriangleMesh(
        vertices=(corners + rng.normal(0, 0.002, corners.shape)).astype(np.float32),
        faces=np.arange(len(corners), dtype=np.int32).reshape(-1, 3),
        face_rgb=house.face_rgb,
        face_instance=house.face_instance,
        face_texture=np.full(len(house.faces), VERTEX_COLOURS, np.int16),
        face_uv=np.zeros_like(house.face_uv),
        textures=(),
        vertex_rgb=rng.integers(0, 256, corners.shape).astype(np.uint8),
    )
    with empty_cache() as folder:
        browser_glb(_small_scene(), 0.0)  # fetches compiled code from numba's cache
        before = time.process_time()
        content = whole_glb(soup)
        build_s = time.process_time() - before
        path = folder / "copy.glb"
        path.write_bytes(content)
        return {"build_s": build_s, "faces": len(load_glb(path, up="y").faces), "megabytes": len(content) / 1e6}


def _small_scene() -> Scene:
    mesh = bench_mesh(20_000, cluttered=False, texture_size=64, num_textures=2)
    return Scene("small", "invented", mesh, (), floor_grid_from_mesh(mesh), "small")


def _clicks(
    vertices: NDArray[np.float32], floor_y: float, num: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Origins and directions (N, 3) of rays to places over the mesh's ground plan."""
    low, high = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)
    aims, eyes = rng.uniform(low, high, (num, 3)), rng.uniform(low, high, (num, 3))
    aims[:, 1] = floor_y
    eyes[:, 1] = floor_y + rng.uniform(3, 12, num)
    return eyes, aims - eyes
