"""The compiled loops behind `Raycaster.cast`: packets of independent rays."""

import numpy as np

from sim.compiled import njit

from .embree import INVALID, trace


@njit(cache=True, nogil=True, error_model="numpy")
def cast_rays(tracer, packets, rays, range_m, face_ids):
    """Fills range (N,) in lengths of the directions, inf for misses, and face (N,), -1 for misses.

    Args:
        tracer: Addresses of scene, arguments and mask for `trace`.
        packets: One packet that no other call uses.
        rays: (N, 6) origins and directions; those that are not finite or have no direction miss.
        range_m: (N,) to fill.
        face_ids: (N,) to fill.
    """
    packet = packets[0]
    width = len(packet.tfar)
    for first in range(0, len(rays), width):
        for i in range(width):
            ray = rays[min(first + i, len(rays) - 1)]
            packet.org_x[i], packet.org_y[i], packet.org_z[i] = ray[0], ray[1], ray[2]
            packet.dir_x[i], packet.dir_y[i], packet.dir_z[i] = ray[3], ray[4], ray[5]
            length = abs(ray[3]) + abs(ray[4]) + abs(ray[5])
            is_ray = length > 0 and np.isfinite(length + abs(ray[0]) + abs(ray[1]) + abs(ray[2]))
            packet.tfar[i] = np.inf if is_ray else -1.0  # Embree skips rays that end before they start
            packet.geom[i] = INVALID
        trace(tracer[0], tracer[1], tracer[2], packets.ctypes.data, width)
        for i in range(min(width, len(rays) - first)):
            is_hit = packet.geom[i] == 0
            range_m[first + i] = packet.tfar[i] if is_hit else np.float32(np.inf)
            face_ids[first + i] = np.int64(packet.prim[i]) if is_hit else -1


@njit(cache=True, nogil=True, error_model="numpy")
def refine_ranges(origins, directions, vertices, faces, range_m, face_ids):
    """Replaces the ranges of hits by those to the planes of their faces, in double precision; all (N,) or (N, 3)."""
    for i in range(len(origins)):
        if face_ids[i] < 0:
            continue
        corners = faces[face_ids[i]]
        along = from_origin = 0.0
        for k in range(3):
            m, n = (k + 1) % 3, (k + 2) % 3
            a, b, c = vertices[corners[0]], vertices[corners[1]], vertices[corners[2]]
            edge_m, edge_n = np.float64(b[m]) - a[m], np.float64(b[n]) - a[n]
            normal = edge_m * (np.float64(c[n]) - a[n]) - edge_n * (np.float64(c[m]) - a[m])
            along += normal * directions[i, k]
            from_origin += normal * (a[k] - origins[i, k])
        exact = from_origin / along
        if abs(exact - range_m[i]) <= 1e-4 * max(1.0, range_m[i]):  # not where the ray runs along its face
            range_m[i] = exact
