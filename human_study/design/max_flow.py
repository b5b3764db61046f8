"""Maximum flow over named nodes (scipy's Dinic), for drawing and assigning episodes under limits."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_flow


def flow_of(edges: Sequence[tuple[str, str, int]], *, source: str, sink: str) -> dict[tuple[str, str], int]:
    """A largest possible flow as amounts > 0 by (tail, head).

    The edges are (tail, head, capacity > 0), each pair once. The choice among equal flows depends only on the order in
    which nodes first appear.
    """
    numbers: dict[str, int] = {}
    for name in (source, sink, *(name for edge in edges for name in edge[:2])):
        numbers.setdefault(name, len(numbers))
    tails = [numbers[tail] for tail, _, _ in edges]
    heads = [numbers[head] for _, head, _ in edges]
    capacities = np.array([capacity for _, _, capacity in edges], np.int32)
    shape = (len(numbers), len(numbers))
    graph = csr_array((capacities, (tails, heads)), shape=shape)
    flow = maximum_flow(graph, numbers[source], numbers[sink], method="dinic").flow.tocoo()
    names = list(numbers)
    return {
        (names[tail], names[head]): int(amount)
        for tail, head, amount in zip(flow.coords[0], flow.coords[1], flow.data, strict=True)
        if amount > 0
    }
