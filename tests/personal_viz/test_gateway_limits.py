"""Client addresses, and the number of tries that each has."""

import pytest

from personal_viz.study_app.gateway.limits import AddressLimit, Holds, client_address, forwarded_address

PROXY = "10.0.0.9"


@pytest.mark.parametrize(
    ("peer", "forwarded_for", "address"),
    [
        ("192.0.2.7", [], "192.0.2.7"),
        ("127.0.0.1", [], "loopback"),
        ("::1", [], "loopback"),
        ("::ffff:127.0.0.1", [], "loopback"),
        ("::ffff:192.0.2.7", [], "192.0.2.7"),
        ("2001:db8:1:2:3::4", [], "2001:db8:1:2::/64"),
        ("192.0.2.7", ["198.51.100.1"], "192.0.2.7"),
        ("127.0.0.1", ["198.51.100.1"], "loopback"),
        (PROXY, ["198.51.100.1"], "198.51.100.1"),
        (PROXY, ["127.0.0.1, 198.51.100.1"], "198.51.100.1"),
        (PROXY, ["203.0.113.5", "198.51.100.1"], "198.51.100.1"),
        (PROXY, ["2001:db8::1"], "2001:db8::/64"),
        (PROXY, [], PROXY),
        (PROXY, ["nonsense"], PROXY),
        (PROXY, ["198.51.100.1,"], PROXY),
        (None, [], ""),
    ],
)
def test_only_the_named_proxy_may_say_for_whom_it_asks(
    peer: str | None, forwarded_for: list[str], address: str
) -> None:
    assert client_address(peer, forwarded_for, PROXY) == address


def test_a_proxy_that_is_silent_is_noticed() -> None:
    assert forwarded_address(PROXY, ["198.51.100.1"], PROXY) == "198.51.100.1"
    assert forwarded_address(PROXY, [], PROXY) is None
    assert forwarded_address("192.0.2.7", ["198.51.100.1"], PROXY) is None
    assert forwarded_address(PROXY, ["198.51.100.1"], None) is None


def test_each_address_has_ten_tries_a_minute() -> None:
    limit = AddressLimit(10 / 60, 10)
    assert sum(limit.allows("a", 100.0) for _ in range(30)) == 10
    assert not limit.allows("a", 100.0)
    assert limit.allows("b", 100.0)
    assert sum(limit.allows("a", 160.0) for _ in range(30)) == 10


def test_many_addresses_do_not_fill_the_memory() -> None:
    limit = AddressLimit(10 / 60, 10)
    while limit.allows("first", 100.0):
        pass
    for number in range(9_999):
        limit.allows(str(number), 100.0)
    assert not limit.allows("first", 100.0)
    for number in range(10_000):
        limit.allows(str(number), 100.0)
    assert limit.allows("first", 100.0), "of more than 10,000 addresses the oldest is forgotten"


def test_holds_are_given_back_and_counted_by_key() -> None:
    holds = Holds()
    with holds.one("a", 2) as first, holds.one("a", 2) as second, holds.one("a", 2) as third, holds.one("b", 2):
        assert (first, second, third) == (True, True, False)
        assert len(holds) == 2
        assert "a" in holds
    assert len(holds) == 0
    assert "a" not in holds
