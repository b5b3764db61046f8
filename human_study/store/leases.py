"""Finds participants who have been away too long, by a steady clock; jumps of the wall clock change nothing.

Leases are kept in memory: a restarted program counts from its start, so a restart takes no participant's place away.
"""

from dataclasses import dataclass


@dataclass(slots=True)
class _Lease:
    num_open: int
    away_since_s: float


class Leases:
    """Open connections of participants, and the start of each absence; for one thread at a time."""

    def __init__(self, lease_s: float) -> None:
        """Starts without participants.

        Args:
            lease_s: Longest absence in seconds; a participant who is away longer has left.
        """
        self._lease_s = lease_s
        self._leases: dict[str, _Lease] = {}

    def here(self, code: str, now_s: float) -> None:
        """A participant opened a connection; the participant's other open connections stay counted."""
        self._lease(code, now_s).num_open += 1

    def left(self, code: str, now_s: float) -> None:
        """A participant's connection ended; the participant is away only if it was the last one."""
        lease = self._lease(code, now_s)
        lease.num_open = max(0, lease.num_open - 1)
        lease.away_since_s = now_s

    def expect(self, code: str, now_s: float) -> None:
        """A participant has begun, so absences count from now on; changes nothing for a known participant."""
        self._lease(code, now_s)

    def forget(self, code: str) -> None:
        """The participant has finished or is out; after a return the count starts again."""
        if code in self._leases and not self._leases[code].num_open:
            del self._leases[code]

    def is_here(self, code: str) -> bool:
        """Whether the participant has an open connection."""
        return code in self._leases and self._leases[code].num_open > 0

    def present(self) -> frozenset[str]:
        """Codes of all participants with an open connection."""
        return frozenset(code for code, lease in self._leases.items() if lease.num_open)

    def away_s(self, code: str, now_s: float) -> float:
        """Seconds since the participant left; 0 for a connected or unknown participant."""
        lease = self._leases.get(code)
        return 0.0 if lease is None or lease.num_open else max(0.0, now_s - lease.away_since_s)

    def expired(self, now_s: float) -> tuple[str, ...]:
        """Codes of participants without an open connection whose lease has ended, in order."""
        return tuple(sorted(code for code in self._leases if self.away_s(code, now_s) > self._lease_s))

    def _lease(self, code: str, now_s: float) -> _Lease:
        return self._leases.setdefault(code, _Lease(0, now_s))
