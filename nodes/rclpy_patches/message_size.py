"""The size of a message in C, found before it is turned into Python.

What turns a message into Python has the interpreter's lock: of a list of numbers to the end, and of 200,000
trajectory points for most of two seconds, in which the control cycles have to share it. The offsets of a message's
fields are those of the introspection type support, whose structures (message_introspection.h of Jazzy) are written
down here.
"""

import ctypes
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np

_INTROSPECTION: Final = b"rosidl_typesupport_introspection_c"
_STRING, _WIDE_STRING, _MESSAGE = 16, 17, 18  # of field_types.h, as the sizes below
_SIZES: Final = {1: 4, 2: 8, 3: 16, 4: 1, 5: 2, 6: 1, 7: 1, 8: 1, 9: 1, 10: 2, 11: 2, 12: 4, 13: 4, 14: 8, 15: 8}
_NO_FIELD: Final = "structure_needs_at_least_one_member"
"""The field in C of a message without fields."""
_WORD: Final = ctypes.sizeof(ctypes.c_size_t)
_SEQUENCE: Final = 3 * _WORD
"""Bytes of a sequence or a string: its data's address, its size and its capacity."""


class _TypeSupport(ctypes.Structure):
    """The beginning of rosidl_message_type_support_t."""

    _fields_ = (("identifier", ctypes.c_char_p), ("data", ctypes.c_void_p))


class _Member(ctypes.Structure):
    """rosidl_typesupport_introspection_c__MessageMember."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("type_id", ctypes.c_uint8),
        ("string_upper_bound", ctypes.c_size_t),
        ("members", ctypes.c_void_p),
        ("is_key", ctypes.c_bool),
        ("is_array", ctypes.c_bool),
        ("array_size", ctypes.c_size_t),
        ("is_upper_bound", ctypes.c_bool),
        ("offset", ctypes.c_uint32),
        ("default_value", ctypes.c_void_p),
        ("functions", ctypes.c_void_p * 6),
    )


class _Members(ctypes.Structure):
    """rosidl_typesupport_introspection_c__MessageMembers, up to the members."""

    _fields_ = (
        ("namespace", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("count", ctypes.c_uint32),
        ("size", ctypes.c_size_t),
        ("has_any_key_member", ctypes.c_bool),
        ("members", ctypes.POINTER(_Member)),
    )


@dataclass(frozen=True, slots=True)
class _Part:
    """A sequence or a string within a message."""

    offset: int
    size: int
    """Bytes of each element."""
    within: "Layout | None" = None
    """The layout of each element, if elements have sequences of their own."""
    inline: int = 0
    """Number of elements of an array that is part of the message itself; 0 for a sequence."""


@dataclass(frozen=True, slots=True)
class Layout:
    """The layout of one message type."""

    names: tuple[str, ...]
    """The names of its fields."""
    size: int
    """Bytes without what is in sequences and strings."""
    parts: tuple[_Part, ...]

    def measured(self, address: int, allowed: int) -> int:
        """Return the bytes of the message at ``address``, or some number above ``allowed`` if there are more."""
        return self.size + self._beside(address, allowed - self.size)

    def _beside(self, address: int, allowed: int) -> int:
        total = 0
        for part in self.parts:
            data, count = address + part.offset, part.inline
            if not part.inline:
                data, count = _words(data, 2)
                total += count * part.size
            if count and part.within is not None and total <= allowed:
                total += part.within.of_all(data, count, allowed - total)
            if total > allowed:
                return total
        return total

    def of_all(self, data: int, count: int, allowed: int) -> int:
        """Return the bytes in the sequences of ``count`` messages, which stand one after the other at ``data``."""
        if all(part.within is None and not part.inline for part in self.parts):
            table = np.array(_words(data, count * self.size // _WORD)).reshape(count, -1)
            return sum(int(table[:, part.offset // _WORD + 1].sum()) * part.size for part in self.parts)
        total = 0
        for place in range(count):
            total += self._beside(data + place * self.size, allowed - total)
            if total > allowed:
                break
        return total


_TEXT: Final = Layout((), _SEQUENCE, (_Part(0, 1),))
_WIDE_TEXT: Final = Layout((), _SEQUENCE, (_Part(0, 2),))


def _words(address: int, count: int) -> Any:
    return (ctypes.c_size_t * count).from_address(address)


@cache
def layout_of(kind: Any) -> Layout:
    """Return the layout of a message type. Raises what ctypes raises, and ValueError if it is not as written here."""
    kind.__class__.__import_type_support__()
    layout = _layout(_introspection(capsule_address(kind._TYPE_SUPPORT)))
    known = tuple(kind.get_fields_and_field_types())
    if layout.names != known:
        raise ValueError(f"{kind.__name__} has the fields {', '.join(layout.names)} and not {', '.join(known)}")
    return layout


def capsule_address(capsule: object) -> int:
    """Return the address in a Python capsule without a name."""
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    return int(get(capsule, None))


def _introspection(support: int) -> int:
    find = ctypes.CDLL("librosidl_runtime_c.so").get_message_typesupport_handle
    find.restype, find.argtypes = ctypes.c_void_p, (ctypes.c_void_p, ctypes.c_char_p)
    found = find(support, _INTROSPECTION)
    if not found:
        raise ValueError(f"there is no {_INTROSPECTION.decode()} for a message type")
    return int(found)


def _layout(support: int) -> Layout:
    data = _TypeSupport.from_address(support).data
    members = _Members.from_address(data)
    fields = [members.members[place] for place in range(members.count)]
    parts = tuple(part for member in fields for part in _parts(member))
    names = tuple(name for member in fields if (name := member.name.decode()) != _NO_FIELD)
    return Layout(names, members.size, parts)


def _parts(member: _Member) -> Iterator[_Part]:
    """The sequences and strings of one field."""
    within = {_STRING: _TEXT, _WIDE_STRING: _WIDE_TEXT}.get(member.type_id)
    if member.type_id == _MESSAGE:
        within = _layout(_introspection(member.members))
    size = _SIZES[member.type_id] if within is None else within.size
    dynamic = within if within is not None and within.parts else None
    if member.is_array and (not member.array_size or member.is_upper_bound):
        yield _Part(member.offset, size, dynamic)
    elif dynamic is not None:
        yield _Part(member.offset, size, dynamic, inline=member.array_size or 1)
