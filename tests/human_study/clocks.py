"""The machine's clocks, moved by a test."""

from dataclasses import dataclass

S = 10**9
HOUR_S = 3600


@dataclass
class Clocks:
    """Clocks that stand still until the test moves them."""

    wall_ns: int = 1_790_000_000 * S
    steady_ns: int = 5_000 * S
    boot: str | None = "first boot"
    """Name of the machine's last start; None where the system does not tell it."""

    def pass_s(self, seconds: float) -> None:
        """Time goes on."""
        self.wall_ns += int(seconds * S)
        self.steady_ns += int(seconds * S)

    def reboot(self, *, steady_s: float = 10.0) -> None:
        """Starts the steady clock again, which shows `steady_s` now."""
        self.boot, self.steady_ns = f"boot at {self.wall_ns}", int(steady_s * S)
