"""What a servo keeps without power, as bytes and in words."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from drivers.servos.register import Access, ByteOrder, Register


@dataclass(frozen=True, slots=True)
class Flash:
    """The bytes that are kept."""

    settings: bytes
    """The table as it comes back with the power; its volatile bytes count for nothing."""
    defaults: bytes = b""
    """What a factory reset brings back, where a servo can be told."""


class Kept:
    """Which bytes of a table are kept and may be written, and what their registers are called."""

    def __init__(self, registers: Iterable[Register], addresses: Iterable[int], order: ByteOrder) -> None:
        kept = frozenset(addresses)
        self._order = order
        self._registers = {r.name: r for r in registers if r.access is Access.READ_WRITE and r.address in kept}
        named = {r.address + i for r in self._registers.values() for i in range(r.size)}
        self._nameless = sorted(kept - named)

    def words(self, settings: bytes) -> dict[str, int]:
        """The registers by name."""
        return {
            name: r.decode(settings[r.address : r.address + r.size], self._order) for name, r in self._registers.items()
        }

    def nameless(self, settings: bytes) -> dict[int, int]:
        """The bytes that no register has, by address; those that are 0 are left out."""
        return {at: settings[at] for at in self._nameless if settings[at]}

    def settings(self, base: bytes, words: Mapping[str, int], nameless: Mapping[int, int]) -> bytes:
        """``base`` with these registers and bytes. Raises ValueError for one that is not kept, or does not fit."""
        unknown = [*sorted(words.keys() - self._registers.keys()), *sorted(nameless.keys() - set(self._nameless))]
        if unknown:
            raise ValueError(f"it keeps no {', '.join(map(str, unknown))}")
        result = bytearray(base)
        for name, value in words.items():
            register = self._registers[name]
            result[register.address : register.address + register.size] = register.encode(value, self._order)
        for at in self._nameless:
            result[at] = nameless.get(at, 0)
        return bytes(result)
