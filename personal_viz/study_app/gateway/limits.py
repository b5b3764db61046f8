"""Limits per client address; addresses are kept in memory only and are never written anywhere."""

import contextlib
import ipaddress
from collections import Counter, OrderedDict
from collections.abc import Hashable, Iterator

from .filter import RateLimit

GUESSES = (10 / 60, 10)
"""Wrong tokens per address: ten at once, ten a minute. A right token is accepted after any number of wrong ones."""
JOINS = (10 / 60, 30)
"""Newcomers on the open link per address: a class may come at once from behind one router."""
DOWNLOADS = (10 / 60, 10)
"""Measurements by `study doctor` per address."""
LOOPBACK = "loopback"
_MOST_ADDRESSES = 10_000


def client_address(peer: str | None, forwarded_for: list[str], proxy: str | None) -> str:
    """The client's address for limits.

    Args:
        peer: Address at the other end of the connection.
        forwarded_for: Values of the request's X-Forwarded-For headers, in order.
        proxy: Address of the trusted reverse proxy; headers about forwarding from anybody else are ignored.

    Returns:
        `loopback`; an IPv4 address; the /64 of an IPv6 address, which belongs to one household; or an empty text when
        it is not an address. A trusted proxy that does not say for whom it asks counts as one address.
    """
    return forwarded_address(peer, forwarded_for, proxy) or _key(peer)


def forwarded_address(peer: str | None, forwarded_for: list[str], proxy: str | None) -> str | None:
    """The client's address as the trusted proxy names it; None when somebody else asks, or the proxy names nobody."""
    if proxy is None or _key(peer) != _key(proxy):
        return None
    return _key(",".join(forwarded_for).rpartition(",")[2].strip()) or None


class AddressLimit:
    """A token bucket per address; forgets the addresses that have been silent longest."""

    def __init__(self, rate: float, burst: int) -> None:
        """Starts without addresses; each gets `rate` tries a second on average and `burst` at once."""
        self._rate, self._burst = rate, burst
        self._buckets: OrderedDict[str, RateLimit] = OrderedDict()

    def allows(self, address: str, now_s: float) -> bool:
        """Takes one try, and returns whether one was left."""
        bucket = self._buckets.setdefault(address, RateLimit(self._rate, self._burst))
        self._buckets.move_to_end(address)
        while len(self._buckets) > _MOST_ADDRESSES:
            self._buckets.popitem(last=False)
        return bucket.allows(now_s)


class Holds:
    """Counts the open things of each key."""

    def __init__(self) -> None:
        """Starts with nothing open."""
        self._counts: Counter[Hashable] = Counter()

    def __len__(self) -> int:
        """Number of keys that have something open."""
        return len(self._counts)

    def __contains__(self, key: Hashable) -> bool:
        """Whether the key has something open."""
        return key in self._counts

    @contextlib.contextmanager
    def one(self, key: Hashable, most: int | None) -> Iterator[bool]:
        """Holds one more until the end of the block; yields False and holds nothing when the key has `most` already."""
        if most is not None and self._counts[key] >= most:
            yield False
            return
        self._counts[key] += 1
        try:
            yield True
        finally:
            self._counts[key] -= 1
            if self._counts[key] <= 0:
                del self._counts[key]


def _key(address: str | None) -> str:
    """The key that an address counts under; empty when the text holds no address."""
    try:
        ip = ipaddress.ip_address(address or "")
    except ValueError:
        return ""
    if isinstance(ip, ipaddress.IPv6Address):
        if ip.ipv4_mapped is not None:
            return _key(str(ip.ipv4_mapped))
        return LOOPBACK if ip.is_loopback else str(ipaddress.ip_network((ip, 64), strict=False))
    return LOOPBACK if ip.is_loopback else str(ip)
