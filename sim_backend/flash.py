"""Contents of a servo's flash memory, as bytes and as named registers."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from drivers.servos.register import Access, ByteOrder, Register


@dataclass(frozen=True, slots=True)
class Flash:
    """Bytes that survive power-off."""

    settings: bytes
    """Control table after power-on. The volatile bytes of the table are ignored."""
    defaults: bytes = b""
    """Settings that a factory reset restores, for servos on which they can be changed."""


class Kept:
    """The bytes of a table that survive power-off and can be written, with the names of their registers."""

    def __init__(self, registers: Iterable[Register], addresses: Iterable[int], order: ByteOrder) -> None:
        kept = frozenset(addresses)
        self._order = order
        self._registers = {r.name: r for r in registers if r.access is Access.READ_WRITE and r.address in kept}
        named = {r.address + i for r in self._registers.values() for i in range(r.size)}
        self._nameless = sorted(kept - named)

    def words(self, settings: bytes) -> dict[str, int]:
        """Return the register values, keyed by register name."""
        return {
            name: r.decode(settings[r.address : r.address + r.size], self._order) for name, r in self._registers.items()
        }

    def nameless(self, settings: bytes) -> dict[int, int]:
        """Return the bytes that do not belong to a register, keyed by address. Bytes with the value 0 are omitted."""
        return {at: settings[at] for at in self._nameless if settings[at]}

    def settings(self, base: bytes, words: Mapping[str, int], nameless: Mapping[int, int]) -> bytes:
        """Return a copy of ``base`` with these values. Raises ValueError if a value does not fit in its register, or if
        the register does not survive power-off."""
        unknown = [*sorted(words.keys() - self._registers.keys()), *sorted(nameless.keys() - set(self._nameless))]
        if unknown:
            raise ValueError(f"the servo does not store {', '.join(map(str, unknown))}")
        result = bytearray(base)
        for name, value in words.items():
            register = self._registers[name]
            result[register.address : register.address + register.size] = register.encode(value, self._order)
        for at in self._nameless:
            result[at] = nameless.get(at, 0)
        return bytes(result)
