"""A limit on how often clients are served, of which each active client has the same share."""

from collections.abc import Hashable
from typing import Final

ACTIVE_S: Final = 1.0
"""A client that has asked within this time counts as active."""


class FairRate:
    """Each client has tokens, spends one each time that it is served, and gets them back at its share of the rate."""

    def __init__(self, per_second: float, burst: int) -> None:
        """``per_second``: of all clients together; ``burst``: of one client that has not asked for a while."""
        self._per_second = per_second
        self._burst = burst
        self._clients: dict[Hashable, tuple[float, float]] = {}
        """By client: its tokens, and when it asked last."""

    def allows(self, client: Hashable, now_s: float) -> bool:
        """Return whether a client that asks now is served."""
        known = self._clients
        if client not in known:  # time enough to forget the others
            self._clients = known = {who: at for who, at in known.items() if now_s - at[1] <= ACTIVE_S}
        active = sum(now_s - asked_s <= ACTIVE_S for who, (_, asked_s) in known.items() if who != client) + 1
        tokens, asked_s = known.get(client, (float(self._burst), now_s))
        tokens = min(tokens + (now_s - asked_s) * self._per_second / active, float(self._burst))
        served = tokens >= 1.0
        known[client] = (tokens - served, now_s)
        return served
