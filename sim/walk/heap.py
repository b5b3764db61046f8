"""A binary heap of keys with values in two arrays, for compiled searches."""

from sim.compiled import njit


@njit(cache=True, nogil=True)
def push(keys, values, size, key, value):
    """Adds to a binary heap that has room."""
    at = size
    while at > 0:
        up = (at - 1) // 2
        if keys[up] <= key:
            break
        keys[at], values[at] = keys[up], values[up]
        at = up
    keys[at], values[at] = key, value
    return size + 1


@njit(cache=True, nogil=True)
def pop(keys, values, size):
    """Removes the least entry of a binary heap; (value, new size)."""
    least = values[0]
    size -= 1
    key, value = keys[size], values[size]
    at = 0
    while True:
        down = 2 * at + 1
        if down >= size:
            break
        if down + 1 < size and keys[down + 1] < keys[down]:
            down += 1
        if keys[down] >= key:
            break
        keys[at], values[at] = keys[down], values[down]
        at = down
    keys[at], values[at] = key, value
    return least, size
