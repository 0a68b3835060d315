"""Limit the rate at which client requests are served. All active clients get equal shares."""

from collections.abc import Hashable
from typing import Final

ACTIVE_S: Final = 1.0
"""Time after a client's last request during which the client is considered active, in seconds."""


class FairRate:
    """Token bucket for each client. Serving a request costs one token, and each client regains tokens at its share of
    the rate."""

    def __init__(self, per_second: float, burst: int) -> None:
        """Set the limits.

        Args:
            per_second: Maximum rate of all clients together, in requests per second.
            burst: Number of requests that an idle client may send at once.
        """
        self._per_second = per_second
        self._burst = burst
        self._clients: dict[Hashable, tuple[float, float]] = {}
        """Tokens and time of the last request, keyed by client."""

    def allows(self, client: Hashable, now_s: float) -> bool:
        """Return whether a client's request may be served now."""
        known = self._clients
        if client not in known:  # Also removes inactive clients.
            self._clients = known = {name: entry for name, entry in known.items() if now_s - entry[1] <= ACTIVE_S}
        active = sum(now_s - requested_s <= ACTIVE_S for name, (_, requested_s) in known.items() if name != client) + 1
        tokens, requested_s = known.get(client, (float(self._burst), now_s))
        tokens = min(tokens + (now_s - requested_s) * self._per_second / active, float(self._burst))
        served = tokens >= 1.0
        known[client] = (tokens - served, now_s)
        return served
